//! `stillpoint plan recalculate`: the dose of an RTPLAN of any program.
//!
//! - `treatment`: the beams of the file, as fluence on bixels
//! - `outcome`: the dose, its figures, and how far it is from the dose of the other program
//! - `chart`: both histograms as SVG

mod chart;
mod outcome;
mod treatment;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::Args;
use stillpoint_dicom::{DataSet, GivenDose};
use stillpoint_patient::case::read;
use stillpoint_plan::dose::EngineName;

use super::machine_of;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::out_folder::OutFolder;
use crate::quantity::within;
use outcome::Outcome;
use treatment::Treatment;

/// Compute the dose of an RTPLAN that any program wrote, on a case.
///
/// Fields of jaws and leaves (MLCX or MLCY), step and shoot, sliding windows and arcs are read, with any collimator and couch angle. What
/// moves between control points is divided until no leaf moves by more than 2.5 mm and no gantry turns by more than 2 degrees.
/// Wedges, blocks, compensators, boluses and table tops that are tilted are refused. With --dose the figures of the other program's dose
/// are printed, too, with the gamma index at 3 % of its largest dose and 3 mm. Monitor units count as the machine file says: the
/// factor between the two doses is printed. The output is a folder with recalculated.json and
/// recalculated.svg. No dose of this command may be used to treat a patient.
#[derive(Args)]
pub struct Recalculate {
    /// The RTPLAN file.
    plan: PathBuf,
    /// The case file of the patient.
    #[arg(long, value_name = "CASE")]
    case: PathBuf,
    /// RTDOSE of the same plan by another program.
    #[arg(long, value_name = "FILE")]
    dose: Option<PathBuf>,
    /// Machine file; the default is the built-in generic 6 MV machine. Edges of leaves are those of the RTPLAN.
    #[arg(long, value_name = "FILE")]
    machine: Option<PathBuf>,
    /// Method by which dose is computed: `pencil` or `superposition`.
    #[arg(long, default_value_t = EngineName::Superposition)]
    engine: EngineName,
    /// Width of the bixels on which the field is laid.
    #[arg(long, value_name = "LENGTH", default_value = "2.5mm")]
    bixel: String,
    /// Spacing of the dose grid.
    #[arg(long, value_name = "LENGTH", default_value = "3mm")]
    grid: String,
    /// Output folder; the default is `recalculated/PLAN`.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of threads; the dose does not depend on it. Default: all cores.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Recalculate {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let bixel_mm = within("bixel", &self.bixel, "mm", [1.0, 20.0])?;
        let grid_mm = within("grid", &self.grid, "mm", [1.0, 20.0])?;
        let case = read(&self.case).map_err(Failure::wrong)?;
        let machine = machine_of(self.machine.as_deref())?;
        let data = data_set(&self.plan)?;
        let treatment = Treatment::of(&data, &case, &machine, bixel_mm).map_err(|e| at(&self.plan, &e))?;
        let given = match &self.dose {
            None => None,
            Some(path) => Some(GivenDose::read(&data_set(path)?).map_err(|e| at(path, &e))?),
        };
        if let Some(sum) =
            given.as_ref().map(|dose| &dose.sum).filter(|sum| !matches!(&sum[..], "PLAN" | "FRACTION"))
        {
            let path = self.dose.as_deref().unwrap_or(Path::new(""));
            return Err(at(
                path,
                &format!("a dose of the kind `{sum}`: give that of the plan or of a fraction"),
            ));
        }
        let default = || Path::new("recalculated").join(self.plan.file_stem().unwrap_or_default());
        let out = OutFolder::ready(&self.out.clone().unwrap_or_else(default))?;
        let threads = self.threads.or_else(|| std::thread::available_parallelism().ok());
        let threads = threads.unwrap_or(NonZeroUsize::MIN);
        let outcome = Outcome::new(
            &case,
            machine,
            &treatment,
            given.as_ref(),
            self.engine,
            [bixel_mm, grid_mm],
            threads,
        )?;
        let svg = chart::histograms(&outcome).map_err(Failure::failed)?;
        let reported = outcome.reported();
        let text = serde_json::to_string_pretty(&reported).map_err(Failure::failed)?;
        let files =
            [out.put("recalculated.json", text.as_bytes())?, out.put("recalculated.svg", svg.as_bytes())?];
        if self.json {
            print_json(&reported)?;
        } else {
            outcome.print();
            files.iter().for_each(|file| outln!("{}", file.display()));
        }
        Ok(Exit::Done)
    }
}

fn at(path: &Path, why: &dyn std::fmt::Display) -> Failure {
    Failure::wrong(format!("{}: {why}", path.display()))
}

fn data_set(path: &Path) -> Result<DataSet, Failure> {
    let bytes = std::fs::read(path).map_err(|e| at(path, &e))?;
    DataSet::read(&bytes).map_err(|e| at(path, &e))
}
