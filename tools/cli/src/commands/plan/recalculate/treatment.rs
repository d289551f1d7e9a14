//! The beams of an RTPLAN as fluence on bixels.

use stillpoint_dicom::{ControlPoint, DataSet, TagError, TreatmentBeam, TreatmentPlan, uids_of};
use stillpoint_patient::case::{Case, content_hash};
use stillpoint_plan::dose::Machine;
use stillpoint_plan::leaves::{Aperture, LeafPairs, moving_fluence};
use stillpoint_plan::recompute::BeamFluence;

/// How far a distance of the source may be from that of the machine, mm, and an energy, MV.
const DISTANCE_MM: f64 = 1.0;
const ENERGY_MV: f64 = 0.05;
/// Directions of a plan at most: each is a dose. Four full arcs with control points 4 degrees apart have up to 2880.
const MOST_DIRECTIONS: usize = 4000;
/// Farthest place of a field from the axis, mm.
const MOST_MM: f64 = 500.0;

/// Why a plan cannot be computed.
#[derive(Debug, thiserror::Error)]
pub enum TreatmentError {
    #[error(transparent)]
    Tag(#[from] TagError),
    #[error("the case cannot be named: {0}")]
    Case(String),
    #[error(
        "the plan is in the frame of reference {plan}, and the images of the case {case} in {images}: give the case of this patient"
    )]
    Frame { plan: String, case: String, images: String },
    #[error(
        "the plan is for the patient position {plan}, and the images of the case are of {images}: give the case of this plan"
    )]
    Position { plan: String, images: &'static str },
    #[error(
        "the machine file has no collimator: give one with its transmission and monitor units by --machine"
    )]
    NoCollimator,
    #[error(
        "beam {name:?} is of {found} MV, and the machine of {machine} MV: give the machine file by --machine"
    )]
    Energy { name: String, found: f64, machine: f64 },
    #[error(
        "beam {name:?} has its source at {found} mm, and the machine at {machine} mm: give the machine file by --machine"
    )]
    Distance { name: String, found: f64, machine: f64 },
    #[error("beam {name:?} has a field that reaches more than {MOST_MM} mm from the axis")]
    Field { name: String },
    #[error("{0} directions, more than {MOST_DIRECTIONS}: split the plan")]
    Directions(usize),
}

/// A plan, ready for its dose.
pub struct Treatment {
    /// As the file has it.
    pub plan: TreatmentPlan,
    /// The directions of its beams, of all fractions, with their isocentres, mm.
    pub parts: Vec<([f64; 3], Vec<BeamFluence>)>,
}

impl Treatment {
    /// The plan in a data set, for the case of its patient.
    pub fn of(data: &DataSet, case: &Case, machine: &Machine, bixel_mm: f64) -> Result<Self, TreatmentError> {
        let plan = TreatmentPlan::read(&data.object)?;
        let hash = content_hash(case).map_err(|e| TreatmentError::Case(e.to_string()))?;
        let images = uids_of(case, &hash).frame_of_reference;
        if let Some(frame) = plan.frame_of_reference.as_ref().filter(|frame| **frame != images) {
            let (plan, case, images) = (frame.to_string(), case.name().to_owned(), images.to_string());
            return Err(TreatmentError::Frame { plan, case, images });
        }
        let lies = case.position().term();
        if let Some(position) = plan.position.as_ref().filter(|position| *position != lies) {
            return Err(TreatmentError::Position { plan: position.clone(), images: lies });
        }
        let file = machine.file();
        let Some(collimator) = &file.collimator else { return Err(TreatmentError::NoCollimator) };
        let mut parts: Vec<([f64; 3], Vec<BeamFluence>)> = Vec::new();
        for beam in &plan.beams {
            suits(beam, file.energy_mv, file.sad_mm)?;
            let weight = beam.monitor_units * f64::from(plan.fractions) / collimator.mu_per_weight;
            let points: Vec<Aperture> = beam.points.iter().map(aperture).collect();
            let leaves = beam.leaves.as_ref();
            let leaves = leaves.map(|l| LeafPairs { along_z: l.along_y, edges_mm: &l.edges_mm });
            let fluence = moving_fluence(&points, leaves, collimator.transmission, weight, bixel_mm);
            let mut places = fluence.iter().flat_map(|f| &f.bixels_mm).flatten();
            if places.any(|mm| mm.abs() > MOST_MM) {
                return Err(TreatmentError::Field { name: beam.name.clone() });
            }
            match parts.iter_mut().find(|(at, _)| *at == beam.isocentre_mm) {
                Some((_, all)) => all.extend(fluence),
                None => parts.push((beam.isocentre_mm, fluence)),
            }
        }
        let directions = parts.iter().map(|(_, beams)| beams.len()).sum();
        match directions {
            0..=MOST_DIRECTIONS => Ok(Self { plan, parts }),
            _ => Err(TreatmentError::Directions(directions)),
        }
    }

    /// Monitor units of a fraction.
    pub fn monitor_units(&self) -> f64 {
        self.plan.beams.iter().map(|beam| beam.monitor_units).sum()
    }
}

/// Whether a beam is one of the machine.
fn suits(beam: &TreatmentBeam, energy_mv: f64, source_axis_mm: f64) -> Result<(), TreatmentError> {
    let name = || beam.name.clone();
    if let Some(found) = beam.energy_mv.filter(|found| (found - energy_mv).abs() > ENERGY_MV) {
        return Err(TreatmentError::Energy { name: name(), found, machine: energy_mv });
    }
    if let Some(found) = beam.source_axis_mm.filter(|found| (found - source_axis_mm).abs() > DISTANCE_MM) {
        return Err(TreatmentError::Distance { name: name(), found, machine: source_axis_mm });
    }
    Ok(())
}

fn aperture(point: &ControlPoint) -> Aperture {
    Aperture {
        given: point.given,
        gantry_deg: point.gantry_deg,
        collimator_deg: point.collimator_deg,
        couch_deg: point.couch_deg,
        jaws_mm: point.jaws_mm,
        tips_mm: point.tips_mm.clone(),
    }
}
