//! `stillpoint plan`: beams and fluence for a case.
//!
//! - `request`: what is asked for, checked
//! - `ground`: the case made ready: goals, dose engines, doses from the cache
//! - `search`: the ways to choose beams, with their progress
//! - `outcome`: what a plan gives
//! - `table`: figures for people
//! - `charts`: histograms and searches as SVG
//! - `export`: RTPLAN and RTDOSE
//! - `folder`: the files of a plan

mod charts;
mod export;
mod folder;
mod ground;
mod outcome;
mod request;
mod search;
mod table;

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use crate::exit::{Ended, Exit, Failure, print_json};
use ground::Ground;
use outcome::Outcome;
use request::Request;
use search::{Run, Way};

/// Choose the beams of a case and their fluence.
///
/// Without a case it plans the pelvis of seed 0 that comes with stillpoint. Beams stand 20 degrees apart or more on a
/// ring of 90 angles. It writes a folder: plan.json, dvh.svg, objective.svg, the dose over the slices through the
/// isocentre (PNG), rtplan.dcm and rtdose.dcm. No plan that it makes may treat a patient.
#[derive(Args)]
pub struct Plan {
    /// The case file; see `stillpoint case`.
    case: Option<PathBuf>,
    /// Number of beams.
    #[arg(long, default_value_t = 5)]
    beams: usize,
    /// Most sets of beams that are solved.
    #[arg(long, default_value_t = 40)]
    budget: usize,
    /// How beams are chosen.
    #[arg(long, value_enum, default_value_t = Way::Exchange)]
    method: Way,
    /// Gantry angles to plan with, like `0,40,80`, degrees: nothing is chosen.
    #[arg(long, conflicts_with_all = ["beams", "budget", "method", "compare"])]
    angles: Option<String>,
    /// Choose by every method, each with the whole budget, and keep the best plan.
    #[arg(long, conflicts_with = "method")]
    compare: bool,
    /// Optimise the mean over set-ups: as planned, and moved by this much along each axis both ways. 3 mm where no
    /// length is given.
    #[arg(long, value_name = "SHIFT", num_args = 0..=1, default_missing_value = "3mm")]
    robust: Option<String>,
    /// A JSON table of objectives that goes before the one that comes with stillpoint.
    #[arg(long, value_name = "FILE")]
    objectives: Option<PathBuf>,
    /// A machine file in place of the generic 6 MV machine that comes with stillpoint.
    #[arg(long, value_name = "FILE")]
    machine: Option<PathBuf>,
    /// Spacing of the dose grid.
    #[arg(long, value_name = "LENGTH", default_value = "5mm")]
    grid: String,
    /// Width of a bixel.
    #[arg(long, value_name = "LENGTH", default_value = "10mm")]
    bixel: String,
    /// The folder to write; `plans/CASE` where none is given.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// The folder in which doses are kept between plans; some 10 MB a beam.
    #[arg(long, value_name = "DIR", default_value = "doses")]
    doses: PathBuf,
    /// Write the patient's name, ID, birth date and sex, from the DICOM folder of the case, into the exported DICOM.
    #[arg(long, value_name = "DICOM_DIR")]
    keep_identity: Option<PathBuf>,
    /// Seed of the methods that draw.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads; any number gives the same plan. All cores where none is given.
    #[arg(long)]
    threads: Option<std::num::NonZeroUsize>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Plan {
    /// Does it.
    pub fn execute(&self) -> Ended {
        let request = Request::new(self)?;
        folder::make_ready(&request.out)?;
        let began = Instant::now();
        let ground = Ground::new(&request)?;
        let ready_s = began.elapsed().as_secs_f64();
        if !self.json {
            ground.tell();
        }
        let runs = search::all(&request, &ground)?;
        let (Some(best), chosen_s) = (best(&runs), began.elapsed().as_secs_f64() - ready_s) else {
            return Err(Failure::failed("no method was run"));
        };
        let outcome = Outcome::new(&request, &ground, best);
        let files = folder::write(&request, &ground, &runs, &outcome)?;
        let seconds = json!({ "doses": ready_s, "choice": chosen_s, "all": began.elapsed().as_secs_f64() });
        if self.json {
            let mut told = outcome.told(&request, &ground, &runs);
            if let Some(told) = told.as_object_mut() {
                told.insert("files".to_owned(), json!(files));
                told.insert("seconds".to_owned(), seconds);
            }
            print_json(&told)?;
        } else {
            table::print(&request, &ground, &runs, &outcome);
            outln!("\ndoses {ready_s:.1} s, choice and fluence {chosen_s:.1} s");
            for file in files {
                outln!("{}", file.display());
            }
        }
        Ok(Exit::Done)
    }
}

/// The run with the least cost, the first among equals.
fn best(runs: &[Run]) -> Option<&Run> {
    runs.iter().reduce(|a, b| if b.choice.best.cost < a.choice.best.cost { b } else { a })
}
