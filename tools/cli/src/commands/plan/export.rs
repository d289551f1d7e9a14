//! RTPLAN, RTDOSE and RTSTRUCT of a plan: of its segments where it has some, else of its fluence.

use stillpoint_dicom::{
    Beam, Export, ExportError, Exported, LeafSegment, Machine, Plan, PlannedDose, dose_file, plan_file,
    structure_file, uids_of,
};
use stillpoint_plan::dose::BeamAngles;
use stillpoint_plan::leaves::{LeafBeam, Segment};

use super::leaves::Leaves;
use super::outcome::Outcome;
use super::prepared::Prepared;
use super::request::Request;

/// A beam that carries less than this part of the plan has no place in an RTPLAN, where every weight is above zero.
const LEAST_SHARE: f64 = 1e-9;

/// The DICOM files of a plan.
pub struct Files {
    /// RTPLAN.
    pub plan: Exported,
    /// RTDOSE.
    pub dose: Exported,
    /// RTSTRUCT of a case that did not come from DICOM.
    pub structures: Option<Exported>,
}

/// The plan, its dose, and the structures where the case came without. Beams without weight are left out.
pub fn dicom(request: &Request, prepared: &Prepared, outcome: &Outcome<'_>) -> Result<Files, ExportError> {
    let uids = uids_of(&request.setup.case, &request.setup.hash);
    let export = Export { uids: &uids, identity: &request.identity };
    let beams = match &outcome.leaves {
        Some(leaves) => shaped(request, outcome, leaves),
        None => beams(request, prepared, outcome),
    };
    let collimator = request.collimator().filter(|_| outcome.leaves.is_some());
    let gray = outcome.leaves.as_ref().map_or(&outcome.gray[0], |leaves| &leaves.gray);
    let machine = request.setup.spec.machine.file();
    let label = format!("{} {}", outcome.run.name.word(), request.beams);
    let plan = plan_file(
        &export,
        &Plan {
            label: &label,
            machine: Machine {
                name: "stillpoint",
                energy_mv: machine.energy_mv,
                source_axis_mm: machine.sad_mm,
            },
            prescription: request.setup.case.prescription(),
            fractions: request.setup.case.fractions().unwrap_or(1),
            position: request.setup.case.position(),
            leaf_edges_mm: collimator.map_or(&[][..], |c| &c.leaf_edges_mm[..]),
            beams: &beams,
        },
    )?;
    let dose = dose_file(&export, &PlannedDose { grid: outcome.grid(), gray, plan: &plan.uid })?;
    let structures = match request.setup.case.uids() {
        Some(_) => None,
        None => Some(structure_file(&export, &request.setup.case)?),
    };
    Ok(Files { plan, dose, structures })
}

fn shaped(request: &Request, outcome: &Outcome<'_>, leaves: &Leaves<'_>) -> Vec<Beam> {
    let (_, all) = leaves.totals();
    let beam = |(number, beam): (&u16, &LeafBeam)| {
        let angles = request.setup.directions.angles(*number);
        let segment = |segment: &Segment| LeafSegment {
            tips_mm: segment.tips_mm.clone(),
            field_mm: segment.field_mm,
            monitor_units: leaves.monitor_units(segment.weight),
        };
        Beam {
            name: name_of(angles),
            gantry_deg: angles.gantry_deg,
            couch_deg: angles.couch_deg.rem_euclid(360.0),
            isocentre_mm: request.setup.case.isocentre_mm(),
            weight: leaves.beam_units(beam) / all,
            field_mm: beam.field_mm,
            segments: beam.segments.iter().map(segment).collect(),
            arc: None,
        }
    };
    leaves.beams(outcome.run).map(beam).collect()
}

fn name_of(angles: BeamAngles) -> String {
    let BeamAngles { gantry_deg, couch_deg } = angles;
    match angles.is_coplanar() {
        true => format!("gantry {gantry_deg}"),
        false => format!("gantry {gantry_deg} couch {couch_deg}"),
    }
}

fn beams(request: &Request, prepared: &Prepared, outcome: &Outcome<'_>) -> Vec<Beam> {
    let best = &outcome.run.choice.best;
    let whole: f64 = best.plan.weights.iter().sum();
    let half = 0.5 * request.setup.spec.bixel_mm;
    let of = |beam: &u16| {
        let weights = best.weights_of(*beam)?;
        let share = weights.iter().sum::<f64>() / whole;
        let lit = || {
            prepared
                .doses
                .solved
                .bixels_mm(*beam)
                .iter()
                .zip(weights)
                .filter(|(_, w)| **w > 0.0)
                .map(|(b, _)| b)
        };
        let edge = |axis: usize| {
            let low = lit().map(|b| b[axis]).fold(f64::INFINITY, f64::min);
            let high = lit().map(|b| b[axis]).fold(f64::NEG_INFINITY, f64::max);
            [low - half, high + half]
        };
        let angles = request.setup.directions.angles(*beam);
        (share > LEAST_SHARE).then(|| Beam {
            name: name_of(angles),
            gantry_deg: angles.gantry_deg,
            couch_deg: angles.couch_deg.rem_euclid(360.0),
            isocentre_mm: request.setup.case.isocentre_mm(),
            weight: share,
            // The beam's x is that of the collimator at 0 degrees; its z, to the head, is the collimator's y.
            field_mm: [edge(0), edge(1)],
            segments: Vec::new(),
            arc: None,
        })
    };
    best.beams.beams().iter().filter_map(of).collect()
}
