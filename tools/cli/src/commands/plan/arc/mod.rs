//! The plan of one patient in arcs: from the request to the files.
//!
//! - `outcome`: what the arcs give; `export`: their DICOM files; `table`: their figures for people

mod export;
pub mod outcome;
mod table;

use std::path::PathBuf;
use std::time::Instant;

use serde_json::json;
use stillpoint_plan::arc::{ArcOptions, ArcSpec};
use stillpoint_plan::dose::BeamAngles;
use stillpoint_plan::recipe::{ArcPlanError, ArcProgress};

use super::args::PlanArgs;
use super::page::arc as page;
use super::prepared::{bar, notes};
use super::queue::REQUEST;
use super::request::{Patient, Request};
use crate::exit::{Exit, Failure, print_json};
use crate::out_folder::OutFolder;
use crate::picture::{Plane, Wash, wash};
use outcome::ArcOutcome;

/// The upper end of the scale of doses, as a part of the prescription.
const SCALE: f64 = 1.1;
/// Angles by which the method of dose is chosen: every so many control points.
const SEEN: usize = 4;

/// A plan in arcs that was made and written.
pub struct MadeArcs {
    request: Request,
    notes: Vec<String>,
    text: String,
    plan: serde_json::Value,
    files: Vec<PathBuf>,
    is_refused: bool,
    /// Seconds of the search and of its doses, and of all.
    seconds: [f64; 2],
}

/// The arcs of a text of `--arc`.
pub fn read(arcs: &str) -> Result<Vec<ArcSpec>, Failure> {
    ArcSpec::list(arcs).map_err(|e| Failure::wrong(format!("--arc {arcs}: {e}")))
}

/// Plans a patient in the arcs of this text, and writes the files.
pub fn plan(args: &PlanArgs, patient: &Patient<'_>, arcs: &str) -> Result<MadeArcs, Failure> {
    let arcs = read(arcs)?;
    let mut request = Request::new(args, patient)?;
    let angles: Vec<BeamAngles> = arcs
        .iter()
        .flat_map(|arc| arc.control_points_deg().into_iter().step_by(SEEN))
        .map(|gantry_deg| BeamAngles::from(gantry_deg).wrapped())
        .collect();
    let engine = request.setup.engine_of_angles(&angles).map_err(Failure::failed)?;
    request.setup = request.setup.by(engine).map_err(Failure::failed)?;
    let out = OutFolder::ready(&request.out)?;
    let began = Instant::now();
    let options = ArcOptions::default();
    let rounds = bar(options.rounds as u64, "leaves", request.quiet);
    let intervals: usize = arcs.iter().map(|arc| arc.control_points_deg().len() - 1).sum();
    let doses = bar(intervals as u64, "dose of the arcs", request.quiet);
    let planned = request.setup.plan_arcs(&arcs, options, request.threads, |progress| match progress {
        ArcProgress::Doses => {}
        ArcProgress::Round(round, objective) => {
            rounds.set_position(round as u64);
            rounds.set_message(format!("objective {objective:.2}"));
        }
        ArcProgress::Interval => doses.inc(1),
    });
    rounds.finish_and_clear();
    doses.finish_and_clear();
    let planned = planned.map_err(|e| match e {
        ArcPlanError::NoLeaves | ArcPlanError::Robust | ArcPlanError::Blocked { .. } => Failure::wrong(e),
        other => Failure::failed(other),
    })?;
    let planned_s = began.elapsed().as_secs_f64();
    let outcome = ArcOutcome::new(&request, planned, &angles)?;
    let notes = notes(&request);
    let file = outcome.file(&request).map_err(Failure::failed)?;
    // Those of a plan before in this folder are of another plan.
    for name in
        [REQUEST, "objective.svg", "tree.svg", "compare.svg", "rtplan.dcm", "rtdose.dcm", "rtstruct.dcm"]
    {
        out.remove(name)?;
    }
    let mut files = vec![out.put("plan.json", file.to_json().map_err(Failure::failed)?.as_bytes())?];
    files.push(out.put("dvh.svg", page::histograms(&request, &outcome)?.as_bytes())?);
    for plane in Plane::ALL {
        let most_gy = SCALE * request.setup.prescribed_gy();
        let over = Wash { grid: outcome.grid(), gray: &outcome.gray, most_gy, beams: &[] };
        let mut png = Vec::new();
        wash(&request.setup.case, plane, &over).write(&mut png).map_err(Failure::failed)?;
        files.push(out.put(&format!("{}.png", plane.name()), &png)?);
    }
    files.push(out.put("plan.html", page::page(&request, &notes, &outcome)?.as_bytes())?);
    let is_refused = !outcome.checked.faults.is_empty() && request.accept_check.is_none();
    if !is_refused {
        for (name, exported) in export::dicom(&request, &outcome).map_err(Failure::failed)? {
            files.push(out.put(name, &exported.bytes)?);
        }
    }
    let text = table::text(&request, &outcome);
    let plan = serde_json::to_value(file).map_err(Failure::failed)?;
    drop(outcome);
    let seconds = [planned_s, began.elapsed().as_secs_f64()];
    Ok(MadeArcs { request, notes, text, plan, files, is_refused, seconds })
}

impl MadeArcs {
    /// Prints it, for people or as JSON.
    pub fn report(self, as_json: bool) -> Result<Exit, Failure> {
        let [planned_s, all_s] = self.seconds;
        let exit = if self.is_refused { Exit::Refused } else { Exit::Done };
        if as_json {
            let mut reported = self.plan;
            if let Some(reported) = reported.as_object_mut() {
                reported.insert("files".to_owned(), json!(self.files));
                reported.insert("seconds".to_owned(), json!({ "arcs": planned_s, "all": all_s }));
            }
            print_json(&reported)?;
            return Ok(exit);
        }
        for note in &self.notes {
            outln!("note: {note}");
        }
        outln!(
            "{} points with objectives, {:.2} mm apart at the borders of targets",
            self.request.setup.goals.voxels().len(),
            self.request.setup.points_mm()
        );
        out!("{}", self.text);
        outln!("\ntime: arcs {planned_s:.1} s, final dose and files {:.1} s", all_s - planned_s);
        for file in &self.files {
            outln!("{}", file.display());
        }
        Ok(exit)
    }
}
