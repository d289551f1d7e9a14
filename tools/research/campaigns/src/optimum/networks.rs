//! Several networks on the same patients: what their own sets cost.

use std::path::{Path, PathBuf};

use stillpoint::Failure;
use stillpoint_network::game::APART;
use stillpoint_network::{Eye, Model, Patient};
use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, choose, rotations};
use stillpoint_plan::dose::Machine;

use super::failed;
use super::subject::{ANGLES, Subject};

/// Solves of the search that finds the best known set.
const REFERENCE: usize = 60;
/// Sets of each network.
const SETS: usize = 5;

/// What the sets of each network cost, in percent above the best known.
pub struct Networks {
    files: Vec<PathBuf>,
    models: Vec<Model>,
    /// For each network and patient: the first set, the best of five.
    over: Vec<Vec<[f64; 2]>>,
}

impl Networks {
    pub fn new(files: &[PathBuf]) -> Result<Self, Failure> {
        let models = files.iter().map(|file| read(file)).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { files: files.to_vec(), over: vec![Vec::new(); models.len()], models })
    }

    /// Solves the sets of all networks for a patient. The best known set is that of all of them, all rotations and a search.
    pub fn judge(&mut self, patient: &Patient, ring: Ring, beams: usize) -> Result<(), Failure> {
        let Some(first) = self.models.first() else { return Ok(()) };
        let subject = Subject::new(patient, first, ring, beams).map_err(failed)?;
        let (case, requested) = (subject.problem.case(), subject.problem.requested());
        let machine = Machine::shipped().map_err(Failure::failed)?;
        let eye = Eye::of_case(case, requested, &machine, ANGLES, patient.coarse.bixel_mm);
        let eye = eye.map_err(Failure::failed)?;
        let evaluator = |solves| {
            Evaluator::new(&subject.doses[..], subject.problem.goals(), ring, beams, Budget { solves })
        };
        let mut searched = evaluator(REFERENCE);
        let method = Method::Exchange(subject.class.clone());
        let mut best = choose(&method, &mut searched, None, 0).map_err(|e| failed(e.into()))?.best.cost;
        let turned = rotations(ring, beams).map_err(Failure::failed)?;
        let solved = evaluator(turned.len()).evaluate_all(&turned, None).map_err(|e| failed(e.into()))?;
        best = solved.iter().map(|plan| plan.cost).fold(best, f64::min);
        let mut costs = Vec::new();
        for model in &self.models {
            let sets = model.judge(&eye).spread_sets(ring, beams, SETS, APART).map_err(Failure::failed)?;
            let solved = evaluator(SETS).evaluate_all(&sets, None).map_err(|e| failed(e.into()))?;
            let of: Vec<f64> = solved.iter().map(|plan| plan.cost).collect();
            best = of.iter().copied().fold(best, f64::min);
            costs.push(of);
        }
        for (over, costs) in self.over.iter_mut().zip(costs) {
            let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
            let first = costs.first().copied().unwrap_or(f64::NAN);
            over.push([first, least].map(|cost| 100.0 * (cost / best - 1.0)));
        }
        errln!("{}: {:?}", subject.name, self.over.iter().map(|over| over.last()).collect::<Vec<_>>());
        Ok(())
    }

    pub fn report(&self) {
        outln!("| network | first set: mean %, worst | best of {SETS}: mean %, worst | patients |");
        outln!("| --- | --- | --- | --- |");
        for (file, over) in self.files.iter().zip(&self.over) {
            let reported = |place: usize| {
                let values = || over.iter().map(move |of| of[place]);
                let mean = values().sum::<f64>() / over.len().max(1) as f64;
                format!("{mean:.1}, {:.1}", values().fold(0.0, f64::max))
            };
            let name = file.file_stem().unwrap_or_default().to_string_lossy();
            outln!("| {name} | {} | {} | {} |", reported(0), reported(1), over.len());
        }
    }
}

/// The network of a file.
pub fn read(path: &Path) -> Result<Model, Failure> {
    let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
    let bytes = std::fs::read(path).map_err(|e| fault(&e))?;
    Model::from_safetensors(&bytes).map_err(|e| fault(&e))
}
