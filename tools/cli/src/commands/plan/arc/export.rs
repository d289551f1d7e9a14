//! RTPLAN, RTDOSE and RTSTRUCT of arcs.

use stillpoint_dicom::{
    Arc, ArcPoint, Beam, Export, ExportError, Exported, Machine, Plan, PlannedDose, dose_file, plan_file,
    structure_file, uids_of,
};
use stillpoint_plan::arc::ArcBeam;

use super::super::request::Request;
use super::outcome::ArcOutcome;

/// The files with their names; the structures where the case did not come from DICOM.
pub fn dicom(
    request: &Request,
    outcome: &ArcOutcome<'_>,
) -> Result<Vec<(&'static str, Exported)>, ExportError> {
    let case = &request.setup.case;
    let uids = uids_of(case, &request.setup.hash);
    let export = Export { uids: &uids, identity: &request.identity };
    let whole = outcome.units();
    let point = |point: &stillpoint_plan::arc::ArcPoint| ArcPoint {
        // To a millionth of a degree, which is an angle below 360, too.
        gantry_deg: (libm::round(1e6 * point.gantry_deg) / 1e6).rem_euclid(360.0),
        given: point.units,
        tips_mm: point.tips_mm.clone(),
    };
    let beam = |(number, beam): (usize, &ArcBeam)| {
        let points: Vec<ArcPoint> = beam.points.iter().map(point).collect();
        Beam {
            // One arc can be there twice.
            name: format!("{} arc {}", number + 1, beam.spec),
            gantry_deg: points.first().map_or(0.0, |point| point.gantry_deg),
            couch_deg: 0.0,
            isocentre_mm: case.isocentre_mm(),
            weight: beam.units() / whole,
            field_mm: beam.field_mm,
            segments: Vec::new(),
            arc: Some(Arc { clockwise: beam.spec.clockwise, mu_per_min: outcome.limits.mu_per_min, points }),
        }
    };
    let beams: Vec<Beam> = outcome.planned.beams.iter().enumerate().map(beam).collect();
    let machine = request.setup.spec.machine.file();
    let plan = plan_file(
        &export,
        &Plan {
            label: &format!("arcs {}", beams.len()),
            machine: Machine {
                name: "stillpoint",
                energy_mv: machine.energy_mv,
                source_axis_mm: machine.sad_mm,
            },
            prescription: case.prescription(),
            fractions: case.fractions().unwrap_or(1),
            position: case.position(),
            leaf_edges_mm: &outcome.collimator.leaf_edges_mm,
            beams: &beams,
        },
    )?;
    let dose =
        dose_file(&export, &PlannedDose { grid: outcome.grid(), gray: &outcome.gray, plan: &plan.uid })?;
    let mut files = vec![("rtplan.dcm", plan), ("rtdose.dcm", dose)];
    if case.uids().is_none() {
        files.push(("rtstruct.dcm", structure_file(&export, case)?));
    }
    Ok(files)
}
