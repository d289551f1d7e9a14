//! RTPLAN and RTDOSE of a plan.

use stillpoint_dicom::{
    Beam, Export, ExportError, Exported, Machine, Plan, PlannedDose, dose_file, plan_file, uids_of,
};

use super::ground::Ground;
use super::outcome::Outcome;
use super::request::Request;

/// A beam that carries less than this part of the plan has no place in an RTPLAN, where every weight is above zero.
const LEAST_SHARE: f64 = 1e-9;

/// The plan and its dose. Beams without weight are left out.
pub fn dicom(
    request: &Request,
    ground: &Ground,
    outcome: &Outcome<'_>,
) -> Result<[Exported; 2], ExportError> {
    let uids = uids_of(&request.case, &request.hash);
    let export = Export { uids: &uids, identity: &request.identity };
    let beams = beams(request, ground, outcome);
    let machine = request.machine.file();
    let label = format!("{} {}", outcome.run.way.word(), request.beams);
    let plan = plan_file(
        &export,
        &Plan {
            label: &label,
            machine: Machine {
                name: "stillpoint",
                energy_mv: machine.energy_mv,
                source_axis_mm: machine.sad_mm,
            },
            prescription: request.case.prescription(),
            fractions: request.case.fractions().unwrap_or(1),
            position: request.case.position(),
            leaf_edges_mm: &[],
            beams: &beams,
        },
    )?;
    let dose =
        dose_file(&export, &PlannedDose { grid: outcome.grid(), gray: &outcome.gray[0], plan: &plan.uid })?;
    Ok([plan, dose])
}

fn beams(request: &Request, ground: &Ground, outcome: &Outcome<'_>) -> Vec<Beam> {
    let best = &outcome.run.choice.best;
    let whole: f64 = best.plan.weights.iter().sum();
    let half = 0.5 * request.bixel_mm;
    let of = |beam: &u16| {
        let weights = best.weights_of(*beam)?;
        let share = weights.iter().sum::<f64>() / whole;
        let lit =
            || ground.doses.bixels_mm(*beam).iter().zip(weights).filter(|(_, w)| **w > 0.0).map(|(b, _)| b);
        let edge = |axis: usize| {
            let low = lit().map(|b| b[axis]).fold(f64::INFINITY, f64::min);
            let high = lit().map(|b| b[axis]).fold(f64::NEG_INFINITY, f64::max);
            [low - half, high + half]
        };
        let angle = request.ring.angle_deg(*beam);
        (share > LEAST_SHARE).then(|| Beam {
            name: format!("gantry {angle}"),
            gantry_deg: angle,
            isocentre_mm: request.case.isocentre_mm(),
            weight: share,
            // The beam's x is that of the collimator at 0 degrees; its z, to the head, is the collimator's y.
            field_mm: [edge(0), edge(1)],
            segments: Vec::new(),
        })
    };
    best.beams.beams().iter().filter_map(of).collect()
}
