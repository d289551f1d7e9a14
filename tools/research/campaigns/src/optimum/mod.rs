//! `stillpoint-research optimum`: methods of choosing beams against the proved optimum of a small ring, and against each other
//! on the full one.
//!
//! - `subject`: a patient with its doses in memory
//! - `prove`: the best set, proved; `retained`: proofs of earlier runs
//! - `compare`: methods at the same numbers of solves
//! - `paired`: differences of two methods on the same patients
//! - `robust`: the robust game against the nominal one
//! - `networks`: the sets of several networks

mod compare;
mod networks;
mod paired;
mod prove;
mod retained;
mod robust;
mod subject;

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint::{Ended, Exit, Failure, print_json};
use stillpoint_network::patient::{Body, Table};
use stillpoint_network::{Coarseness, Model, Patient};
use stillpoint_plan::beams::Ring;

use compare::{ENTRIES, Entry, run};
use networks::Networks;
use paired::Paired;
use robust::Robust;
use subject::Subject;

/// The method that the others are compared with.
const BASE: &str = "exchange";

/// Coarseness of the doses of heads and necks, and of case files: their targets are large.
const WIDE: Coarseness = Coarseness { bixel_mm: 20.0, ..Coarseness::USUAL };

/// Compare methods of choosing beams at equal numbers of solves.
///
/// With `--ring 18` (every 20 degrees) the best of all 8,568 sets of five beams is proved at first, which takes minutes of
/// processor time a patient, and the table shows by how much each method missed it. With `--ring 90` the table shows how much
/// worse each method is than the best set that any run found. Each cell has the mean over the patients, the worst run, the
/// number of runs that found the best set, and the difference from `exchange`: its mean, patients for which the method is
/// better and worse, and the two-sided probabilities of the sign test and of Wilcoxon's signed-rank test. One thread.
#[derive(Args)]
pub struct Optimum {
    /// Seeds of pelves, with the objectives of comparisons. Without any patients they are 101 and 102.
    #[arg(long, value_delimiter = ',')]
    pelves: Vec<u64>,
    /// Seeds of varied pelves, with the same objectives.
    #[arg(long, value_delimiter = ',')]
    varied: Vec<u64>,
    /// Seeds of heads and necks, with the built-in objectives.
    #[arg(long, value_delimiter = ',')]
    necks: Vec<u64>,
    /// Case files, with the built-in objectives.
    #[arg(long, value_delimiter = ',', value_name = "FILES")]
    cases: Vec<PathBuf>,
    /// Model file of the network; the default is the network that comes with stillpoint.
    #[arg(long, value_name = "FILE")]
    network: Option<PathBuf>,
    /// Number of beams.
    #[arg(long, default_value_t = 5)]
    beams: usize,
    /// Number of runs of the methods that draw, with seeds from 0.
    #[arg(long, default_value_t = 2, value_parser = super::at_least::<u64>(1))]
    seeds: u64,
    /// Number of gantry angles: 18 or 90.
    #[arg(long, default_value_t = 18, value_parser = ring)]
    ring: u16,
    /// Numbers of solves.
    #[arg(long, value_delimiter = ',')]
    solves: Vec<usize>,
    /// Run also the methods that are far behind: games, greedy, column generation, priors alone.
    #[arg(long)]
    all_methods: bool,
    /// Folder in which proved optima are kept, so that another run need not prove them again.
    #[arg(long = "kept", value_name = "DIR")]
    retained: Option<PathBuf>,
    /// Compare the robust game with the nominal one instead: beams for the worst of six set-up errors, shifts of the patient
    /// by so many mm along each axis, against beams for none. Both are judged as planned and under the worst error.
    #[arg(long, value_name = "MM", conflicts_with_all = ["networks", "only_proofs"])]
    set_up_error: Option<f64>,
    /// Compare the sets of these networks instead: the first set of each, and the best of five.
    #[arg(long, value_delimiter = ',', value_name = "FILES")]
    networks: Vec<PathBuf>,
    /// Prove the optima and compare nothing. Only with `--ring 18` and `--kept`.
    #[arg(long, requires = "retained")]
    only_proofs: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A ring with another number of angles.
#[derive(Debug, thiserror::Error)]
#[error("{0}: the ring has 18 or 90 angles")]
struct OtherRing(String);

fn ring(text: &str) -> Result<u16, OtherRing> {
    match text {
        "18" => Ok(18),
        "90" => Ok(90),
        other => Err(OtherRing(other.to_owned())),
    }
}

/// One method for one patient.
struct Row {
    patient: String,
    name: &'static str,
    /// Costs after each number of solves, by seed.
    costs: Vec<Vec<f64>>,
    /// Mean over the seeds.
    cpu_s: f64,
}

impl Optimum {
    /// Executes the measurement.
    pub fn execute(&self) -> Ended {
        let (ring, default): (_, &[usize]) = match self.ring {
            18 => (Ring::new(18, 1), &[35, 60]),
            count => (Ring::new(count, 5), &[1, 5, 10, 35, 120]),
        };
        let ring = ring.map_err(Failure::failed)?;
        ring.check_room(self.beams).map_err(|e| Failure::wrong(e.to_string()))?;
        let at = if self.solves.is_empty() { default.to_vec() } else { self.solves.clone() };
        if !self.networks.is_empty() {
            return self.judge_networks(ring);
        }
        let model = self.model()?;
        if let Some(shift_mm) = self.set_up_error {
            return self.play_robust(&model, ring, shift_mm, &at);
        }
        let (mut rows, mut best_known) = (Vec::new(), Vec::new());
        for patient in self.patients() {
            let subject = Subject::new(&patient, &model, ring, self.beams).map_err(failed)?;
            let mut best = f64::INFINITY;
            if self.ring == 18 {
                best = retained::proved(self.retained.as_deref(), &subject, self.beams).map_err(failed)?.cost;
            }
            if self.only_proofs {
                continue;
            }
            for entry in ENTRIES.iter().filter(|entry| self.all_methods || !entry.seldom) {
                let Some(row) = self.row(&subject, entry, &at)? else { continue };
                best = row.costs.iter().flatten().copied().fold(best, f64::min);
                errln!("{}, {}: {:?}", row.patient, row.name, row.costs);
                rows.push(row);
            }
            best_known.push((subject.name, best));
        }
        if self.only_proofs {
            return Ok(Exit::Done);
        }
        self.report(&at, &rows, &best_known)
    }

    fn model(&self) -> Result<Model, Failure> {
        match &self.network {
            Some(path) => networks::read(path),
            None => Model::shipped().map_err(Failure::failed),
        }
    }

    fn play_robust(&self, model: &Model, ring: Ring, shift_mm: f64, at: &[usize]) -> Ended {
        let mut robust = Robust::default();
        for patient in self.patients() {
            let subject = Subject::new(&patient, model, ring, self.beams).map_err(failed)?;
            robust.play(&subject, self.beams, shift_mm, at)?;
        }
        robust.report();
        Ok(Exit::Done)
    }

    fn judge_networks(&self, ring: Ring) -> Ended {
        let mut networks = Networks::new(&self.networks)?;
        for patient in self.patients() {
            networks.judge(&patient, ring, self.beams)?;
        }
        networks.report();
        Ok(Exit::Done)
    }

    fn patients(&self) -> Vec<Patient> {
        let of = |body, table, coarse| Patient { body, table, coarse };
        let plain = |body| of(body, Table::Plain, Coarseness::USUAL);
        let mut all: Vec<Patient> = self.pelves.iter().map(|seed| plain(Body::Pelvis(*seed))).collect();
        all.extend(self.varied.iter().map(|seed| plain(Body::Varied(*seed))));
        all.extend(self.necks.iter().map(|seed| of(Body::Neck(*seed), Table::Shipped, WIDE)));
        all.extend(self.cases.iter().map(|path| Patient::of_file(path, WIDE)));
        if all.is_empty() {
            all.extend([101, 102].map(|seed| plain(Body::Pelvis(seed))));
        }
        all
    }

    fn row(&self, subject: &Subject, entry: &Entry, at: &[usize]) -> Result<Option<Row>, Failure> {
        let (mut costs, mut cpu_s) = (Vec::new(), 0.0);
        let seeds = if entry.drawn { self.seeds } else { 1 };
        for seed in 0..seeds {
            let Some(ran) = run(subject, entry, self.beams, at, seed).map_err(failed)? else {
                return Ok(None);
            };
            costs.push(ran.best);
            cpu_s += ran.cpu_s / seeds as f64;
        }
        Ok(Some(Row { patient: subject.name.clone(), name: entry.name, costs, cpu_s }))
    }

    fn report(&self, at: &[usize], rows: &[Row], best_known: &[(String, f64)]) -> Ended {
        let best =
            |patient: &str| best_known.iter().find(|(name, _)| name == patient).map_or(f64::NAN, |(_, b)| *b);
        // Percent above the best, the mean over the seeds.
        let over = |row: &Row, place: usize| {
            let each = row.costs.iter().map(|costs| 100.0 * (costs[place] / best(&row.patient) - 1.0));
            each.sum::<f64>() / row.costs.len() as f64
        };
        let base_of = |row: &&Row| rows.iter().find(|b| b.name == BASE && b.patient == row.patient);
        let mut reported = Vec::new();
        for entry in &ENTRIES {
            let of_name = || rows.iter().filter(|row| row.name == entry.name);
            let patients = of_name().count();
            if patients == 0 {
                continue;
            }
            let cpu_s = of_name().map(|row| row.cpu_s).sum::<f64>() / patients as f64;
            let mut by_solves = Vec::new();
            for (place, solves) in at.iter().enumerate() {
                let all: Vec<f64> = of_name().map(|row| over(row, place)).collect();
                let base: Vec<f64> =
                    of_name().map(|row| base_of(&row).map_or(f64::NAN, |base| over(base, place))).collect();
                let runs = || {
                    of_name()
                        .flat_map(|row| row.costs.iter().map(|costs| costs[place] / best(&row.patient) - 1.0))
                };
                by_solves.push(json!({
                    "solves": solves,
                    "mean_percent": all.iter().sum::<f64>() / all.len() as f64,
                    "worst_percent": 100.0 * runs().fold(0.0, f64::max),
                    "runs": runs().count(),
                    "runs_at_best": runs().filter(|over| *over < 1e-5).count(),
                    "against_exchange": Paired::new(&all, &base).reported(),
                }));
            }
            reported.push(json!({
                "method": entry.name, "patients": patients, "cpu_s": cpu_s, "by_solves": by_solves,
            }));
        }
        let best: Vec<_> =
            best_known.iter().map(|(name, best)| json!({ "patient": name, "best": best })).collect();
        let reported = json!({ "ring": self.ring, "beams": self.beams, "seeds": self.seeds, "best": best, "methods": reported });
        if self.json {
            print_json(&reported)?;
            return Ok(Exit::Done);
        }
        let head: String = at.iter().map(|solves| format!(" {solves} solves |")).collect();
        outln!("| method |{head} CPU s |");
        outln!("| --- |{} --- |", " --- |".repeat(at.len()));
        for method in reported["methods"].as_array().map_or(&[][..], Vec::as_slice) {
            let cell = |by: &serde_json::Value| {
                let number = |key: &str| by[key].as_f64().unwrap_or(f64::INFINITY);
                format!(
                    " {:.2} %, worst {:.2}; best {}/{}; {} |",
                    number("mean_percent"),
                    number("worst_percent"),
                    by["runs_at_best"],
                    by["runs"],
                    by["against_exchange"].as_str().unwrap_or_default()
                )
            };
            let cells: String =
                method["by_solves"].as_array().map_or(&[][..], Vec::as_slice).iter().map(cell).collect();
            outln!(
                "| {} |{cells} {:.1} |",
                method["method"].as_str().unwrap_or_default(),
                method["cpu_s"].as_f64().unwrap_or(f64::NAN)
            );
        }
        Ok(Exit::Done)
    }
}

fn failed(error: Box<dyn std::error::Error>) -> Failure {
    Failure::failed(error.to_string())
}
