//! `stillpoint delivered`: the dose that a patient got in a session.
//!
//! - `plan_file`: the beams of a plan folder
//! - `reference`: the set-up that the poses of a session count from
//! - `recorded`: poses and beam-on time of a session
//! - `outcome`: the doses and their figures, and all of it as JSON
//! - `table`: figures for people
//! - `chart`: the histograms as SVG

mod chart;
mod outcome;
mod plan_file;
mod recorded;
mod reference;
mod table;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::Args;
use stillpoint_operator::Registry;
use stillpoint_patient::case::read;
use stillpoint_plan::delivery::BinWidth;
use stillpoint_recorder::Session;

use crate::exit::{Ended, Exit, Failure, print_json};
use crate::out_folder::OutFolder;
use crate::quantity::{quantity, within};
use crate::recorded::with_topics;
use outcome::Outcome;
use plan_file::DeliveredPlan;
use recorded::Recorded;
use reference::Reference;

/// Compute the dose that the patient got: from a plan, and the poses and beam-on time of a session.
///
/// The tracker of the session must have the planning CT as its reference (`reference: { surface: FILE }`): only then a pose
/// is the absolute set-up error. Its motions at the isocentre are put into bins, weighted by beam-on time, and the plan's
/// dose to the patient as he lay in each bin is computed by rays through the moved CT. The planned meterset is spread
/// evenly over beam-on time. The output is a folder with delivered.json and delivered.svg. No dose of this command may be
/// used to treat a patient.
#[derive(Args)]
pub struct Delivered {
    /// The session: a folder of parts, or one file.
    session: PathBuf,
    /// The folder of a plan of `stillpoint plan`, or its plan.json.
    #[arg(long, value_name = "PLAN")]
    plan: PathBuf,
    /// The case file of that plan.
    #[arg(long, value_name = "CASE")]
    case: PathBuf,
    /// Machine file of the plan; the default is the built-in generic 6 MV machine.
    #[arg(long, value_name = "FILE")]
    machine: Option<PathBuf>,
    /// Topic of the poses. Default: the track that the gate judges.
    #[arg(long, value_name = "TOPIC")]
    poses: Option<String>,
    /// Topic of the beam: the state of a far end or of a gate. Default: the far end, else the gate.
    #[arg(long, value_name = "TOPIC")]
    beam: Option<String>,
    /// Beams of the plan that the session delivered, by their angles, such as `72@30,144@30`. Default: all. They need the couch
    /// angle of the session, which is `couch` of its gate.
    #[arg(long, value_name = "ANGLES", allow_hyphen_values = true)]
    beams: Option<String>,
    /// Width of the bins along each axis.
    #[arg(long, value_name = "LENGTH", default_value = "0.5mm")]
    bin: String,
    /// Width of the bins about each axis.
    #[arg(long, value_name = "ANGLE", default_value = "0.5deg")]
    bin_angle: String,
    /// Spacing of the dose grid. Default: that of the plan.
    #[arg(long, value_name = "LENGTH")]
    grid: Option<String>,
    /// Output folder; the default is `delivered/SESSION`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of threads; the dose does not depend on it. Default: all cores.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Delivered {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let width = self.width()?;
        let case = read(&self.case).map_err(Failure::wrong)?;
        let mut plan = DeliveredPlan::read(&self.plan, &case, self.machine.as_deref(), self.grid_mm()?)?;
        if let Some(beams) = &self.beams {
            plan.choose(beams)?;
        }
        let session = with_topics(Session::open_any(&self.session), &self.session)?;
        let reference = Reference::of(&session, registry, self.poses.as_deref(), &case)?;
        plan.check_couch(reference.couch_deg)?;
        let recorded = Recorded::of(&session, &reference, self.beam.as_deref(), &case)?;
        let default = || Path::new("delivered").join(name(&self.session));
        let out = OutFolder::ready(&self.out.clone().unwrap_or_else(default))?;
        let threads = match self.threads {
            Some(threads) => threads,
            None => std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN),
        };
        let outcome = Outcome::new(&case, &plan, &recorded, width, threads, self.json)?;
        let reported = outcome.reported(&plan, &reference, &recorded);
        let svg = chart::histograms(&outcome).map_err(Failure::failed)?;
        let text = serde_json::to_string_pretty(&reported).map_err(Failure::failed)?;
        let files = [out.put("delivered.json", text.as_bytes())?, out.put("delivered.svg", svg.as_bytes())?];
        if self.json {
            print_json(&reported)?;
        } else {
            table::print(&outcome, &plan, &reference, &recorded);
            files.iter().for_each(|file| outln!("{}", file.display()));
        }
        Ok(Exit::Done)
    }

    fn width(&self) -> Result<BinWidth, Failure> {
        Ok(BinWidth {
            shift_mm: within("bin", &self.bin, "mm", [0.05, 10.0])?,
            turn_rad: within("bin-angle", &self.bin_angle, "deg", [0.05, 10.0])?.to_radians(),
        })
    }

    fn grid_mm(&self) -> Result<Option<f64>, Failure> {
        self.grid.as_ref().map(|text| quantity(text, "mm", &format!("--grid {text}"))).transpose()
    }
}

/// The last part of the session's path.
fn name(session: &Path) -> String {
    let path = std::path::absolute(session).unwrap_or_else(|_| session.to_owned());
    path.file_stem().map_or_else(|| "session".to_owned(), |name| name.to_string_lossy().into_owned())
}
