//! `stillpoint plan`: beams and fluence for a case.
//!
//! - `protocol`: limits from protocol files
//! - `request`: what is asked for, checked
//! - `ground`: the case made ready: goals, dose engines, doses from the cache
//! - `guide`: the priors of beams; `learned`: that of a trained network
//! - `leaves`: the segments of a plan
//! - `way`: the names of the methods of choosing beams
//! - `search`: the ways to choose beams, with their progress
//! - `pooled`: doses and solves on a pool of workers
//! - `outcome`: what a plan gives
//! - `table`: figures for people
//! - `page`: plan.html
//! - `compare`: two plans side by side
//! - `charts`: histograms and searches as SVG; `tree`: the sets that a search went through
//! - `export`: RTPLAN, RTDOSE and RTSTRUCT
//! - `folder`: the files of a plan

mod charts;
mod compare;
mod export;
mod folder;
mod ground;
mod guide;
mod learned;
mod leaves;
mod outcome;
mod page;
mod pooled;
mod protocol;
mod request;
mod search;
mod table;
mod tree;
mod way;

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, Subcommand};
use serde_json::json;

use crate::exit::{Ended, Exit, Failure, print_json};
use crate::pool::PoolArgs;
use ground::Ground;
use guide::Guide;
use outcome::Outcome;
use pooled::Pooled;
use request::{Request, RobustBy};
use search::Run;
use way::Way;

pub(super) use charts::percent_curve;
pub(super) use ground::bar;
pub(super) use request::machine as machine_of;

/// Choose the beams of a case and optimise their fluence.
///
/// Without a case, the synthetic pelvis of seed 0 is planned. Beams stand at least 20 degrees apart on a ring of 90 angles.
/// The output is a folder: plan.json, plan.html, dvh.svg, objective.svg, tree.svg where sets were solved from other sets, the dose over the slices through the isocentre (PNG),
/// rtplan.dcm, rtdose.dcm, and rtstruct.dcm where the case did not come from DICOM. No plan of this command may be used to treat a patient.
#[derive(Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct Plan {
    #[command(subcommand)]
    action: Option<Action>,
    /// The case file; see `stillpoint case`.
    case: Option<PathBuf>,
    /// Number of beams.
    #[arg(long, default_value_t = 5)]
    beams: usize,
    /// Maximum number of sets of beams that are solved. Default: 40, and 5 for `--method network`.
    #[arg(long)]
    budget: Option<usize>,
    /// Method of choosing beams.
    #[arg(long, value_enum, default_value_t = Way::Exchange)]
    method: Way,
    /// What is known of a beam before it is solved, for the methods `search`, `prior`, `construction` and `two-player`.
    /// Several, separated by commas, are mixed in equal parts.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "price")]
    prior: Vec<Guide>,
    /// Model file of `--method network` and `--prior network`, made by `stillpoint-research train planner`. Default: the network that
    /// comes with stillpoint.
    #[arg(long, value_name = "FILE")]
    network: Option<PathBuf>,
    /// Gantry angles in degrees, such as `0,90,-40.5`, to 0.01 degrees and as near to each other as you like; no search is run.
    #[arg(long, allow_hyphen_values = true, conflicts_with_all = ["beams", "budget", "method", "compare", "prior"])]
    angles: Option<String>,
    /// Run every method, each with the whole budget, and keep the best plan.
    #[arg(long, conflicts_with = "method")]
    compare: bool,
    /// Plan for several set-ups: the planned one, and the patient shifted by this length along each axis in both
    /// directions. Without a length, the shift is 3 mm.
    #[arg(long, value_name = "SHIFT", num_args = 0..=1, default_missing_value = "3mm")]
    robust: Option<String>,
    /// What is optimised with `--robust`.
    #[arg(long, value_enum, default_value_t = RobustBy::Mean, requires = "robust")]
    robust_by: RobustBy,
    /// JSON table of objectives; its entries take precedence over the built-in table.
    #[arg(long, value_name = "FILE")]
    objectives: Option<PathBuf>,
    /// YAML file of limits that the plan is compared with. Default: the built-in protocol of the site of the case, prostate or
    /// head and neck.
    #[arg(long, value_name = "FILE")]
    protocol: Option<PathBuf>,
    /// Machine file; the default is the built-in generic 6 MV machine.
    #[arg(long, value_name = "FILE")]
    machine: Option<PathBuf>,
    /// Do not sequence the fluence for the leaves of the machine. The RTPLAN then has no segments and no monitor units.
    #[arg(long)]
    fluence_only: bool,
    /// Spacing of the points whose dose is optimised. At the borders of targets it is half of that, and at most a quarter
    /// of a bixel. The reported dose is recomputed on a finer grid.
    #[arg(long, value_name = "LENGTH", default_value = "5mm")]
    grid: String,
    /// Width of a bixel.
    #[arg(long, value_name = "LENGTH", default_value = "10mm")]
    bixel: String,
    /// Output folder; the default is `plans/CASE`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folder in which doses are cached between plans, about 5 MB per beam with 10 mm bixels.
    #[arg(long, value_name = "DIR", default_value = "doses")]
    doses: PathBuf,
    /// Copy the name, ID, birth date and sex of the patient from this DICOM folder into the exported DICOM.
    #[arg(long, value_name = "DICOM_DIR")]
    keep_identity: Option<PathBuf>,
    /// Seed of the random methods.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of threads; the plan does not depend on it. Default: all cores.
    #[arg(long)]
    threads: Option<std::num::NonZeroUsize>,
    #[command(flatten)]
    pool: PoolArgs,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Subcommand)]
enum Action {
    /// Show two plans of one case side by side.
    Compare(compare::Compare),
}

impl Plan {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        if let Some(Action::Compare(compare)) = &self.action {
            return compare.execute();
        }
        let request = Request::new(self)?;
        folder::make_ready(&request.out)?;
        let began = Instant::now();
        let mut pooled = self.pool.open()?.map(Pooled::new);
        let (ground, runs, ready_s) = loop {
            let begun = Instant::now();
            let ground = Ground::new(&request, pooled.as_mut())?;
            let ready_s = begun.elapsed().as_secs_f64();
            if !self.json {
                ground.tell();
            }
            let runs = search::all(&request, &ground, pooled.as_mut())?;
            let Some(pooled) = &mut pooled else { break (ground, runs, ready_s) };
            pooled.tell_news();
            if !pooled.is_in_doubt(&request.doses, &ground.engines)? {
                if !self.json {
                    pooled.tell();
                }
                break (ground, runs, ready_s);
            }
            errln!("pool: the plan is made again without the answers of workers that were shut out");
        };
        let (Some(best), chosen_s) = (best(&runs), began.elapsed().as_secs_f64() - ready_s) else {
            return Err(Failure::failed("no method was run"));
        };
        let outcome = Outcome::new(&request, &ground, best)?;
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
            let rest_s = began.elapsed().as_secs_f64() - ready_s - chosen_s;
            outln!(
                "\ntime: doses {ready_s:.1} s, search and fluence {chosen_s:.1} s, final dose and files {rest_s:.1} s"
            );
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
