//! The dose matrix of a plan as files for other optimisers, and plans of weights of theirs.

use std::io::{BufWriter, Write as _};
use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use npyz::{AutoSerialize, WriterBuilder};
use serde_json::json;
use stillpoint_plan::ByRows;
use stillpoint_plan::beams::Influence;
use stillpoint_plan::dose::BeamAngles;

use super::args::PlanArgs;
use super::patient::{self, Made};
use super::pooled::Pooled;
use super::prepared::Prepared;
use super::request::{Patient, Request};
use super::weights;
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::out_folder::OutFolder;

/// Write the dose matrix of given beams, with their objectives, as files that other programs read.
///
/// The matrix is in three files of NumPy: `dose-data.npy` (float32, gray over all fractions for a weight of 1), `dose-indices.npy`
/// (int32, the bixel) and `dose-starts.npy` (int64), as `scipy.sparse.csr_matrix((data, indices, starts), shape)` takes them. Rows
/// are the points of the optimiser, columns the bixels. `bixels.csv` has the beam and place of each bixel, and `problem.json` the
/// shape, the objectives, and the rows of each structure with their volumes. Arguments of what a plan becomes, such as
/// `--dose-grid`, have no effect here.
#[derive(Args)]
pub struct Export {
    #[command(flatten)]
    args: PlanArgs,
}

/// Make the plan of weights that another program found: figures, check, segments, pages and DICOM, without a solve.
///
/// The bixels are those of `plan export` with the same arguments.
#[derive(Args)]
pub struct Evaluate {
    /// Weights in the order of `bixels.csv`: a file of NumPy (`.npy`, float64 or float32), or text with one number a line.
    #[arg(long, value_name = "FILE")]
    weights: PathBuf,
    #[command(flatten)]
    args: PlanArgs,
}

impl Export {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let patient = only_patient(&self.args, None)?;
        if self.args.robust.is_some() {
            return Err(Failure::wrong("the matrix is of the planned set-up: leave out --robust"));
        }
        let request = Request::new(&self.args, &patient)?;
        let out = OutFolder::ready(&request.out)?;
        let record = self.args.pool_record.as_deref();
        let mut pooled =
            self.args.pool.open()?.map(|pool| Pooled::new(pool, &request.doses, record)).transpose()?;
        let prepared = loop {
            let prepared = Prepared::new(&request, pooled.as_mut())?;
            let Some(pooled) = &mut pooled else { break prepared };
            let is_in_doubt = pooled.is_in_doubt();
            pooled.print_news();
            if !is_in_doubt {
                pooled.adopt_doses()?;
                pooled.write_record()?;
                break prepared;
            }
        };
        let files = write(&out, &request, &prepared)?;
        if self.args.json {
            print_json(&json!({ "files": files }))?;
            return Ok(Exit::Done);
        }
        prepared.print_notes(&request);
        files.iter().for_each(|file| outln!("{}", file.display()));
        Ok(Exit::Done)
    }
}

impl Evaluate {
    /// Executes the subcommand.
    pub fn execute(&self, report: impl FnOnce(Made<'_>, bool) -> Result<(), Failure>) -> Ended {
        let weights = weights::read(&self.weights)?;
        let patient = only_patient(&self.args, Some(weights))?;
        patient::plan(&self.args, &patient, |made| report(made, self.args.json))
    }
}

/// The only patient of the arguments, whose beams are given.
fn only_patient(args: &PlanArgs, weights: Option<Vec<f64>>) -> Result<Patient<'_>, Failure> {
    if args.angles.is_none() {
        return Err(Failure::wrong("give the gantry angles of the beams with --angles"));
    }
    let case = match &args.cases[..] {
        [] => None,
        [case] => Some(case.as_path()),
        cases => return Err(Failure::wrong(format!("{} cases are given: give one", cases.len()))),
    };
    let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    Ok(Patient {
        case,
        out: args.out.clone(),
        threads: args.threads.unwrap_or_else(cores),
        is_quiet: args.json,
        weights,
    })
}

fn write(folder: &OutFolder, request: &Request, prepared: &Prepared) -> Result<Vec<PathBuf>, Failure> {
    let (setup, out) = (&request.setup, &request.out);
    let beams = request.needed_beams();
    let matrices: Vec<_> = beams.iter().map(|beam| prepared.doses.solved.beam(*beam)).collect();
    let ByRows { starts, columns, values } = ByRows::of(&matrices);
    // Matrices without couch angles keep their columns.
    let has_couch = setup.angles(&beams).iter().any(|angles| !angles.is_coplanar());
    let heads = if has_couch { "gantry_deg,couch_deg" } else { "gantry_deg" };
    let mut bixels = format!("bixel,beam,{heads},x_mm,z_mm\n");
    let places = beams.iter().enumerate().flat_map(|(number, beam)| {
        let BeamAngles { gantry_deg, couch_deg } = setup.directions.angles(*beam);
        let angles = if has_couch { format!("{gantry_deg},{couch_deg}") } else { gantry_deg.to_string() };
        prepared.doses.solved.bixels_mm(*beam).iter().map(move |place| (number, angles.clone(), place))
    });
    let mut count = 0;
    for (number, angles, [x, z]) in places {
        bixels += &format!("{count},{number},{angles},{x},{z}\n");
        count += 1;
    }
    let structures = serde_json::to_value(&setup.objective_set.structures).map_err(Failure::failed)?;
    let mut problem = json!({
        "case": setup.case.name(), "hash": setup.hash.to_string(), "engine": setup.engine_name(),
        "prescription": setup.case.prescription(), "fractions": setup.case.fractions(),
        "angles_deg": setup.angles_deg(&beams), "bixel_mm": setup.spec.bixel_mm, "points_mm": setup.points_mm(),
        "shape": [starts.len() - 1, count], "modulation": setup.objective_set.modulation, "structures": structures,
    });
    if has_couch {
        problem["couches_deg"] = json!(setup.directions.couches_deg(&beams));
    }
    let problem = serde_json::to_string_pretty(&problem).map_err(Failure::failed)?;
    Ok(vec![
        array(out.join("dose-data.npy"), &values)?,
        array(out.join("dose-indices.npy"), &columns)?,
        array(out.join("dose-starts.npy"), &starts)?,
        folder.put("bixels.csv", bixels.as_bytes())?,
        folder.put("problem.json", problem.as_bytes())?,
    ])
}

fn array<T: AutoSerialize + Copy>(path: PathBuf, numbers: &[T]) -> Result<PathBuf, Failure> {
    let written = stillpoint_map::publish(&path, |file| {
        let options = npyz::WriteOptions::new().default_dtype().shape(&[numbers.len() as u64]);
        let mut buffer = BufWriter::new(file);
        let mut writer = options.writer(&mut buffer).begin_nd()?;
        writer.extend(numbers.iter().copied())?;
        writer.finish()?;
        buffer.flush()
    });
    written.map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
    Ok(path)
}
