//! `stillpoint bench optimum`: methods of choosing beams against the proved optimum of a small ring, and against each other
//! on the full one.
//!
//! - `pelvis`: a pelvis with its doses in memory
//! - `prove`: the best set, proved; `kept`: proofs of earlier runs
//! - `compare`: methods at the same numbers of solves
//! - `paired`: differences of two methods on the same pelves

mod compare;
mod kept;
mod paired;
mod pelvis;
mod prove;

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint::{Ended, Exit, Failure, print_json};
use stillpoint_plan::beams::Ring;

use compare::{Entry, entries, run};
use paired::Paired;
use pelvis::Pelvis;

/// The method that the others are compared with.
const BASE: &str = "exchange";

/// Compare methods of choosing five beams on synthetic pelves, at equal numbers of solves.
///
/// With `--ring 18` (every 20 degrees) the best of all 8,568 sets of a pelvis is proved at first, which takes minutes of
/// processor time, and the table shows by how much each method missed it. With `--ring 90` the table shows how much worse
/// each method is than the best set that any run found. Each cell has the mean over the pelves, the worst run, the number of
/// runs that found the best set, and the difference from `exchange`: its mean, pelves where the method is better and worse,
/// and the two-sided probabilities of the sign test and of Wilcoxon's signed-rank test. One thread.
#[derive(Args)]
pub struct Optimum {
    /// Seeds of the pelves.
    #[arg(long, value_delimiter = ',', default_values_t = [101, 102])]
    pelves: Vec<u64>,
    /// Number of runs of the methods that draw, with seeds from 0.
    #[arg(long, default_value_t = 2, value_parser = super::at_least::<u64>(1))]
    seeds: u64,
    /// Number of gantry angles: 18 or 90.
    #[arg(long, default_value_t = 18, value_parser = ring)]
    ring: u16,
    /// Numbers of solves.
    #[arg(long, value_delimiter = ',')]
    solves: Vec<usize>,
    /// Folder in which proved optima are kept, so that another run need not prove them again.
    #[arg(long, value_name = "DIR")]
    kept: Option<PathBuf>,
    /// Prove the optima and compare nothing. Only with `--ring 18` and `--kept`.
    #[arg(long, requires = "kept")]
    only_proofs: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

fn ring(text: &str) -> Result<u16, String> {
    match text {
        "18" => Ok(18),
        "90" => Ok(90),
        other => Err(format!("{other}: the ring has 18 or 90 angles")),
    }
}

/// One method on one pelvis, the mean over its seeds.
struct Row {
    pelvis: u64,
    name: &'static str,
    /// Costs after each number of solves, by seed.
    costs: Vec<Vec<f64>>,
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
        let at = if self.solves.is_empty() { default.to_vec() } else { self.solves.clone() };
        let (mut rows, mut best_known) = (Vec::new(), Vec::new());
        for seed in &self.pelves {
            let pelvis =
                Pelvis::new(*seed, ring, NonZeroUsize::MIN).map_err(|e| Failure::failed(e.to_string()))?;
            let mut best = f64::INFINITY;
            if self.ring == 18 {
                let proved = kept::proved(self.kept.as_deref(), &pelvis);
                best = proved.map_err(|e| Failure::failed(e.to_string()))?.cost;
            }
            if self.only_proofs {
                continue;
            }
            for entry in entries() {
                let row = self.row(&pelvis, &entry, &at)?;
                best = row.costs.iter().flatten().copied().fold(best, f64::min);
                errln!("pelvis {seed}, {}: {:?}", row.name, row.costs);
                rows.push(row);
            }
            best_known.push((*seed, best));
        }
        if self.only_proofs {
            return Ok(Exit::Done);
        }
        self.tell(&at, &rows, &best_known)
    }

    fn row(&self, pelvis: &Pelvis, entry: &Entry, at: &[usize]) -> Result<Row, Failure> {
        let (mut costs, mut cpu_s) = (Vec::new(), 0.0);
        let seeds = if entry.drawn { self.seeds } else { 1 };
        for seed in 0..seeds {
            let ran = run(pelvis, entry, 5, at, seed).map_err(|e| Failure::failed(e.to_string()))?;
            costs.push(ran.best);
            cpu_s += ran.cpu_s / seeds as f64;
        }
        Ok(Row { pelvis: pelvis.seed, name: entry.name, costs, cpu_s })
    }

    fn tell(&self, at: &[usize], rows: &[Row], best_known: &[(u64, f64)]) -> Ended {
        let best =
            |pelvis: u64| best_known.iter().find(|(seed, _)| *seed == pelvis).map_or(f64::NAN, |(_, b)| *b);
        // By pelvis: percent above the best, the mean over the seeds.
        let over = |name: &str, place: usize| -> Vec<f64> {
            let of = |row: &Row| {
                let each = row.costs.iter().map(|costs| 100.0 * (costs[place] / best(row.pelvis) - 1.0));
                each.sum::<f64>() / row.costs.len() as f64
            };
            rows.iter().filter(|row| row.name == name).map(of).collect()
        };
        let mut told = Vec::new();
        for entry in entries() {
            let of_name = || rows.iter().filter(|row| row.name == entry.name);
            let cpu_s = of_name().map(|row| row.cpu_s).sum::<f64>() / self.pelves.len() as f64;
            let mut by_solves = Vec::new();
            for (place, solves) in at.iter().enumerate() {
                let all = over(entry.name, place);
                let runs = || {
                    of_name()
                        .flat_map(|row| row.costs.iter().map(|costs| costs[place] / best(row.pelvis) - 1.0))
                };
                by_solves.push(json!({
                    "solves": solves,
                    "mean_percent": all.iter().sum::<f64>() / all.len() as f64,
                    "worst_percent": 100.0 * runs().fold(0.0, f64::max),
                    "runs": runs().count(),
                    "runs_at_best": runs().filter(|over| *over < 1e-5).count(),
                    "against_exchange": Paired::new(&all, &over(BASE, place)).told(),
                }));
            }
            told.push(json!({ "method": entry.name, "cpu_s": cpu_s, "by_solves": by_solves }));
        }
        let best: Vec<_> =
            best_known.iter().map(|(seed, best)| json!({ "pelvis": seed, "best": best })).collect();
        let told = json!({ "ring": self.ring, "seeds": self.seeds, "best": best, "methods": told });
        if self.json {
            print_json(&told)?;
            return Ok(Exit::Done);
        }
        let head: String = at.iter().map(|solves| format!(" {solves} solves |")).collect();
        outln!("| method |{head} CPU s |");
        outln!("| --- |{} --- |", " --- |".repeat(at.len()));
        for method in told["methods"].as_array().map_or(&[][..], Vec::as_slice) {
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
