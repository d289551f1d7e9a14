//! The folder of a plan.

use std::path::PathBuf;

use super::charts;
use super::export;
use super::outcome::Outcome;
use super::page;
use super::prepared::Prepared;
use super::queue::REQUEST;
use super::request::Request;
use super::tree;
use crate::exit::Failure;
use crate::out_folder::OutFolder;
use crate::picture::{Plane, Wash, wash};
use stillpoint_plan::recipe::PlanRun;
use stillpoint_report::chart::ChartError;

/// The upper end of the scale of doses, as a part of the prescription.
const SCALE: f64 = 1.1;

/// Writes it, and says which files it has.
pub fn write(
    folder: &OutFolder,
    request: &Request,
    prepared: &Prepared,
    runs: &[PlanRun],
    outcome: &Outcome<'_>,
) -> Result<Vec<PathBuf>, Failure> {
    folder.remove(REQUEST)?;
    let mut files = Vec::new();
    let plan = outcome.file(request, prepared, runs).map_err(Failure::failed)?;
    files.push(folder.put("plan.json", plan.to_json().map_err(Failure::failed)?.as_bytes())?);
    let svg = |text: Result<String, ChartError>| text.map_err(Failure::failed);
    files.push(folder.put("dvh.svg", svg(charts::histograms(request, outcome))?.as_bytes())?);
    files.push(folder.put("objective.svg", svg(charts::objective(request, outcome.run))?.as_bytes())?);
    if let Some(tree) = tree::drawing(&outcome.run.directions, request.beams, &outcome.run.history) {
        files.push(folder.put("tree.svg", tree.as_bytes())?);
    }
    if runs.len() > 1 {
        files.push(folder.put("compare.svg", svg(charts::comparison(request, runs))?.as_bytes())?);
    }
    for plane in Plane::ALL {
        let over = Wash {
            grid: outcome.grid(),
            gray: &outcome.gray[0],
            most_gy: SCALE * prepared.prescribed_gy,
            beams: &outcome.angles,
        };
        let mut png = Vec::new();
        wash(&request.setup.case, plane, &over).write(&mut png).map_err(Failure::failed)?;
        files.push(folder.put(&format!("{}.png", plane.name()), &png)?);
    }
    files.push(folder.put("plan.html", page::page(request, prepared, outcome)?.as_bytes())?);
    if outcome.is_refused(request) {
        // Those of a plan before in this folder are of another plan.
        for name in ["rtplan.dcm", "rtdose.dcm", "rtstruct.dcm"] {
            folder.remove(name)?;
        }
        return Ok(files);
    }
    let export::Files { plan, dose, structures } =
        export::dicom(request, prepared, outcome).map_err(Failure::failed)?;
    files.push(folder.put("rtplan.dcm", &plan.bytes)?);
    files.push(folder.put("rtdose.dcm", &dose.bytes)?);
    if let Some(structures) = structures {
        files.push(folder.put("rtstruct.dcm", &structures.bytes)?);
    }
    Ok(files)
}
