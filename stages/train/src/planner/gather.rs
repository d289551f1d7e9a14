//! Sets of beams with their costs, found by search, kept in a folder.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::Path;

use serde::{Deserialize, Serialize};
use stillpoint_plan::Rows;
use stillpoint_plan::beams::{BeamSet, Budget, Evaluator, Method, Ring, choose, pelvis_solutions};
use stillpoint_plan::fluence::Goals;

use super::problem::{Coarseness, Problem, plan, ring};
use crate::TrainError;

/// Beams of a plan.
pub const BEAMS: usize = 5;
/// Version of the files of solved cases.
const VERSION: u32 = 1;

/// How many sets of each case are solved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gather {
    /// How coarse doses are.
    pub coarse: Coarseness,
    /// Solves of exchange from the class sets.
    pub exchange: usize,
    /// Solves of annealing.
    pub annealing: usize,
    /// Random sets.
    pub random: usize,
}

impl Default for Gather {
    fn default() -> Self {
        let coarse = Coarseness { grid_mm: 8.0, bixel_mm: 14.0 };
        Self { coarse, exchange: 45, annealing: 0, random: 16 }
    }
}

/// The sets of a case that were solved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolvedCase {
    /// Version of the file.
    pub version: u32,
    /// How they were found.
    pub by: Gather,
    /// Seed of the varied pelvis.
    pub seed: u64,
    /// Cost of the first class set of the pelvis.
    pub class: f64,
    /// Cost of each rotation of equal beams.
    pub rotations: Vec<f64>,
    /// Sets of five beams of the ring of 90, by their numbers, with their costs.
    pub sets: Vec<(Vec<u16>, f64)>,
}

impl SolvedCase {
    /// Least cost.
    pub fn best(&self) -> f64 {
        self.sets.iter().map(|(_, cost)| *cost).fold(f64::INFINITY, f64::min)
    }

    /// Adds sets that are not there yet.
    pub fn add(&mut self, more: impl IntoIterator<Item = (Vec<u16>, f64)>) {
        let mut all: BTreeMap<Vec<u16>, f64> = std::mem::take(&mut self.sets).into_iter().collect();
        for (set, cost) in more {
            all.entry(set).or_insert(cost);
        }
        self.sets = all.into_iter().collect();
    }
}

/// The solved case of a seed: from the folder if it was solved like this before, else solved now and kept there.
pub fn gather(folder: &Path, seed: u64, by: Gather, threads: NonZeroUsize) -> Result<SolvedCase, TrainError> {
    let path = folder.join(format!("pelvis-varied-{seed}.json"));
    if let Ok(bytes) = std::fs::read(&path)
        && let Ok(found) = serde_json::from_slice::<SolvedCase>(&bytes)
        && found.version == VERSION
        && (found.by, found.seed) == (by, seed)
    {
        return Ok(found);
    }
    let solved = solve(seed, by, threads)?;
    keep(folder, &solved)?;
    Ok(solved)
}

/// Keeps a solved case in a folder.
pub fn keep(folder: &Path, solved: &SolvedCase) -> Result<(), TrainError> {
    let path = folder.join(format!("pelvis-varied-{}.json", solved.seed));
    let fault = |e: std::io::Error| TrainError::File { path: path.clone(), why: e.to_string() };
    std::fs::create_dir_all(folder).map_err(fault)?;
    let text = serde_json::to_vec(solved).map_err(plan)?;
    let part = path.with_extension("part");
    std::fs::write(&part, text).and_then(|()| std::fs::rename(&part, &path)).map_err(fault)
}

fn solve(seed: u64, by: Gather, threads: NonZeroUsize) -> Result<SolvedCase, TrainError> {
    let problem = Problem::of_seed(seed, by.coarse)?;
    let ring = ring()?;
    let doses = problem.doses(ring, threads)?;
    let goals = &problem.goals;
    let run = |method: Method, solves: usize| run(&doses, goals, ring, threads, &method, solves, seed);
    let class = pelvis_solutions(BEAMS);
    let first = run(Method::Class(class.first().cloned().unwrap_or_default()), 1)?;
    let rotations = run(Method::Equidistant, usize::from(ring.count()))?;
    let mut solved = SolvedCase {
        version: VERSION,
        by,
        seed,
        class: first.first().map_or(f64::NAN, |(_, cost)| *cost),
        rotations: rotations.iter().map(|(_, cost)| *cost).collect(),
        sets: Vec::new(),
    };
    solved.add(first);
    solved.add(rotations);
    for (method, solves) in [
        (Method::Exchange(class), by.exchange),
        (Method::Annealing, by.annealing),
        (Method::Random, by.random),
    ] {
        if solves > BEAMS {
            solved.add(run(method, solves)?);
        }
    }
    Ok(solved)
}

fn run(
    doses: &[Rows],
    goals: &Goals,
    ring: Ring,
    threads: NonZeroUsize,
    method: &Method,
    solves: usize,
    seed: u64,
) -> Result<Vec<(Vec<u16>, f64)>, TrainError> {
    let mut evaluator = Evaluator::new(doses, goals, ring, BEAMS, Budget { solves }).with_threads(threads);
    choose(method, &mut evaluator, None, seed).map_err(plan)?;
    let five = evaluator.history().iter().filter(|p| p.beams.beams().len() == BEAMS);
    Ok(five.map(|p| (p.beams.beams().to_vec(), p.cost)).collect())
}

/// Costs of these sets of a seed.
pub fn costs(
    seed: u64,
    coarse: Coarseness,
    sets: &[BeamSet],
    threads: NonZeroUsize,
) -> Result<Vec<f64>, TrainError> {
    let problem = Problem::of_seed(seed, coarse)?;
    let ring = ring()?;
    let doses = problem.doses(ring, threads)?;
    let budget = Budget { solves: sets.len() };
    let mut evaluator = Evaluator::new(&doses[..], &problem.goals, ring, BEAMS, budget).with_threads(threads);
    let solved = evaluator.evaluate_all(sets, None).map_err(plan)?;
    Ok(solved.iter().map(|solved| solved.cost).collect())
}
