//! RTPLAN: beams, without the sequence of a collimator.

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use stillpoint_plan::case::{PatientPosition, Prescription};

use crate::write::{Export, ExportError, Exported, Writer, fitting};

/// What every reader of the plan must know.
const NOT_SEQUENCED: &str =
    "Research only. The fluence is not sequenced for a collimator: this plan cannot be delivered.";

/// What turns, and with what energy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Machine<'a> {
    /// Name of the treatment machine, at most 16 characters.
    pub name: &'a str,
    /// Nominal energy of the photons, MV.
    pub energy_mv: f64,
    /// Distance of the source from the axis of rotation, mm.
    pub source_axis_mm: f64,
}

/// One beam of a plan; couch and collimator stand at zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// Its name, unique for people, at most 64 characters.
    pub name: String,
    /// IEC 61217 gantry angle, degrees from 0 to below 360.
    pub gantry_deg: f64,
    /// Isocentre, mm in the DICOM patient frame.
    pub isocentre_mm: [f64; 3],
    /// Share of the plan, as its final cumulative meterset weight. It is no monitor units.
    pub weight: f64,
    /// Edges of the smallest rectangle around its bixels in the isocentre plane, mm: IEC beam limiting device x, then y.
    pub field_mm: [[f64; 2]; 2],
}

/// A plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan<'a> {
    /// Its name, at most 16 characters.
    pub label: &'a str,
    /// The machine.
    pub machine: Machine<'a>,
    /// Doses of the targets, over all fractions.
    pub prescription: &'a [Prescription],
    /// Number of fractions.
    pub fractions: u32,
    /// How the patient lies.
    pub position: PatientPosition,
    /// Its beams.
    pub beams: &'a [Beam],
}

/// The RTPLAN file of this plan. It says in it that the fluence is not sequenced for a collimator.
pub fn plan_file(export: &Export<'_>, plan: &Plan<'_>) -> Result<Exported, ExportError> {
    let mut file = Writer::default();
    file.belongs(export, uids::RT_PLAN_STORAGE, "RTPLAN");
    file.put(tags::RT_PLAN_LABEL, VR::SH, fitting("label of a plan", plan.label, 16)?);
    file.put(tags::RT_PLAN_DESCRIPTION, VR::ST, NOT_SEQUENCED);
    file.empty(tags::RT_PLAN_DATE, VR::DA).empty(tags::RT_PLAN_TIME, VR::TM);
    file.put(tags::PLAN_INTENT, VR::CS, "RESEARCH").put(tags::RT_PLAN_GEOMETRY, VR::CS, "PATIENT");
    file.put(tags::APPROVAL_STATUS, VR::CS, "UNAPPROVED");
    let set = &export.uids.structure_set;
    file.reference(tags::REFERENCED_STRUCTURE_SET_SEQUENCE, uids::RT_STRUCTURE_SET_STORAGE, set);
    let doses = plan.prescription.iter().enumerate().map(|(i, p)| dose_reference(i + 1, p));
    let doses = doses.collect::<Result<Vec<_>, _>>()?;
    if !doses.is_empty() {
        file.sequence(tags::DOSE_REFERENCE_SEQUENCE, doses);
    }
    if !(1..=999).contains(&plan.beams.len()) {
        return Err(ExportError::Beams);
    }
    file.sequence(tags::FRACTION_GROUP_SEQUENCE, vec![fraction_group(plan)?]);
    let mut setup = Writer::default();
    setup.whole(tags::PATIENT_SETUP_NUMBER, 1).put(tags::PATIENT_POSITION, VR::CS, plan.position.term());
    file.sequence(tags::PATIENT_SETUP_SEQUENCE, vec![setup]);
    let beams = plan.beams.iter().enumerate().map(|(i, b)| beam(i + 1, b, &plan.machine));
    file.sequence(tags::BEAM_SEQUENCE, beams.collect::<Result<_, _>>()?);
    file.finish(uids::RT_PLAN_STORAGE)
}

fn dose_reference(number: usize, prescription: &Prescription) -> Result<Writer, ExportError> {
    let mut item = Writer::default();
    item.whole(tags::DOSE_REFERENCE_NUMBER, number);
    item.put(tags::DOSE_REFERENCE_STRUCTURE_TYPE, VR::CS, "SITE");
    // A backslash parts the values of a DICOM text.
    let name = prescription.structure.replace('\\', "/");
    let name = fitting("description of a dose", &name, 64)?;
    item.put(tags::DOSE_REFERENCE_DESCRIPTION, VR::LO, name);
    item.put(tags::DOSE_REFERENCE_TYPE, VR::CS, "TARGET");
    let dose = positive("a prescribed dose", prescription.dose_gy)?;
    item.decimals(tags::TARGET_PRESCRIPTION_DOSE, &[dose]);
    Ok(item)
}

fn fraction_group(plan: &Plan<'_>) -> Result<Writer, ExportError> {
    if !(1..=100).contains(&plan.fractions) {
        let value = f64::from(plan.fractions);
        return Err(ExportError::Number { what: "a number of fractions", value, why: "1 to 100 is due" });
    }
    let mut group = Writer::default();
    group.whole(tags::FRACTION_GROUP_NUMBER, 1);
    group.whole(tags::NUMBER_OF_FRACTIONS_PLANNED, plan.fractions as usize);
    group.whole(tags::NUMBER_OF_BEAMS, plan.beams.len()).whole(tags::NUMBER_OF_BRACHY_APPLICATION_SETUPS, 0);
    let references = (1..=plan.beams.len()).map(|number| {
        let mut item = Writer::default();
        item.whole(tags::REFERENCED_BEAM_NUMBER, number);
        item
    });
    group.sequence(tags::REFERENCED_BEAM_SEQUENCE, references.collect());
    Ok(group)
}

fn beam(number: usize, beam: &Beam, machine: &Machine<'_>) -> Result<Writer, ExportError> {
    let mut item = Writer::default();
    item.whole(tags::BEAM_NUMBER, number);
    item.put(tags::BEAM_NAME, VR::LO, fitting("name of a beam", &beam.name, 64)?);
    item.put(tags::BEAM_DESCRIPTION, VR::ST, NOT_SEQUENCED);
    item.put(tags::BEAM_TYPE, VR::CS, "STATIC").put(tags::RADIATION_TYPE, VR::CS, "PHOTON");
    item.put(tags::TREATMENT_MACHINE_NAME, VR::SH, fitting("name of a machine", machine.name, 16)?);
    item.put(tags::TREATMENT_DELIVERY_TYPE, VR::CS, "TREATMENT").put(
        tags::PRIMARY_DOSIMETER_UNIT,
        VR::CS,
        "MU",
    );
    item.decimals(
        tags::SOURCE_AXIS_DISTANCE,
        &[positive("a distance of the source", machine.source_axis_mm)?],
    );
    let device = |kind: &'static str| {
        let mut device = Writer::default();
        device.put(tags::RT_BEAM_LIMITING_DEVICE_TYPE, VR::CS, kind).whole(tags::NUMBER_OF_LEAF_JAW_PAIRS, 1);
        device
    };
    item.sequence(tags::BEAM_LIMITING_DEVICE_SEQUENCE, vec![device("ASYMX"), device("ASYMY")]);
    for none in
        [tags::NUMBER_OF_WEDGES, tags::NUMBER_OF_COMPENSATORS, tags::NUMBER_OF_BOLI, tags::NUMBER_OF_BLOCKS]
    {
        item.whole(none, 0);
    }
    item.whole(tags::REFERENCED_PATIENT_SETUP_NUMBER, 1).whole(tags::NUMBER_OF_CONTROL_POINTS, 2);
    let weight = positive("a weight of a beam", beam.weight)?;
    item.decimals(tags::FINAL_CUMULATIVE_METERSET_WEIGHT, &[weight]);
    let mut end = Writer::default();
    end.whole(tags::CONTROL_POINT_INDEX, 1).decimals(tags::CUMULATIVE_METERSET_WEIGHT, &[weight]);
    item.sequence(tags::CONTROL_POINT_SEQUENCE, vec![start(beam, machine)?, end]);
    Ok(item)
}

/// The control point that places the beam.
fn start(beam: &Beam, machine: &Machine<'_>) -> Result<Writer, ExportError> {
    let mut point = Writer::default();
    point.whole(tags::CONTROL_POINT_INDEX, 0).decimals(tags::CUMULATIVE_METERSET_WEIGHT, &[0.0]);
    point.decimals(tags::NOMINAL_BEAM_ENERGY, &[positive("an energy", machine.energy_mv)?]);
    if !(0.0..360.0).contains(&beam.gantry_deg) {
        let why = "0 to below 360 degrees is due";
        return Err(ExportError::Number { what: "a gantry angle", value: beam.gantry_deg, why });
    }
    point.decimals(tags::GANTRY_ANGLE, &[beam.gantry_deg]).put(
        tags::GANTRY_ROTATION_DIRECTION,
        VR::CS,
        "NONE",
    );
    for (angle, direction) in [
        (tags::BEAM_LIMITING_DEVICE_ANGLE, tags::BEAM_LIMITING_DEVICE_ROTATION_DIRECTION),
        (tags::PATIENT_SUPPORT_ANGLE, tags::PATIENT_SUPPORT_ROTATION_DIRECTION),
        (tags::TABLE_TOP_ECCENTRIC_ANGLE, tags::TABLE_TOP_ECCENTRIC_ROTATION_DIRECTION),
    ] {
        point.decimals(angle, &[0.0]).put(direction, VR::CS, "NONE");
    }
    for unknown in [
        tags::TABLE_TOP_VERTICAL_POSITION,
        tags::TABLE_TOP_LONGITUDINAL_POSITION,
        tags::TABLE_TOP_LATERAL_POSITION,
    ] {
        point.empty(unknown, VR::DS);
    }
    if let Some(&value) = beam.isocentre_mm.iter().find(|c| c.is_nan() || c.abs() > 1e5) {
        let why = "a position within 100 m is due";
        return Err(ExportError::Number { what: "a coordinate of the isocentre", value, why });
    }
    point.decimals(tags::ISOCENTER_POSITION, &beam.isocentre_mm);
    let mut jaws = Vec::new();
    for (kind, [low, high]) in ["ASYMX", "ASYMY"].into_iter().zip(beam.field_mm) {
        if !(low < high && low >= -1000.0 && high <= 1000.0) {
            let why = "its edges must rise within 1 m of the axis";
            return Err(ExportError::Number { what: "a width of a field", value: high - low, why });
        }
        let mut jaw = Writer::default();
        jaw.put(tags::RT_BEAM_LIMITING_DEVICE_TYPE, VR::CS, kind);
        jaw.decimals(tags::LEAF_JAW_POSITIONS, &[low, high]);
        jaws.push(jaw);
    }
    point.sequence(tags::BEAM_LIMITING_DEVICE_POSITION_SEQUENCE, jaws);
    Ok(point)
}

fn positive(what: &'static str, value: f64) -> Result<f64, ExportError> {
    match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(ExportError::Number { what, value, why: "a number above 0 is due" }),
    }
}
