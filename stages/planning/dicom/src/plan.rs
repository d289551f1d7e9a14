//! RTPLAN: beams, each with the step-and-shoot segments of its collimator, or without any; and arcs.
//!
//! An arc has one control point for each angle. Its cumulative weight is what was given until there, so between two control points a
//! constant number of monitor units is given for each degree, and the leaves move evenly (PS3.3 C.8.8.14).

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use stillpoint_patient::case::{PatientPosition, Prescription};

use crate::write::{Export, ExportError, Exported, Writer, fitting};

/// What every reader of the plan must know.
const NOT_SEQUENCED: &str =
    "Research only. The fluence is not sequenced for a collimator: this plan cannot be delivered.";

/// The same of a plan in segments.
const SEQUENCED: &str = "Research only. The segments are for step and shoot. Their monitor units are those of a generic \
     beam model, not of a measured machine.";
/// The same of a plan of arcs.
const TURNED: &str = "Research only. The gantry turns while the beam is on. The monitor units are those of a generic beam \
     model, not of a measured machine.";
/// Farthest from the axis that a tip of a leaf can be, mm.
const FARTHEST_MM: f64 = 1000.0;

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

/// One beam of a plan; the collimator stands at zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// Its name, unique for people, at most 64 characters.
    pub name: String,
    /// IEC 61217 gantry angle, degrees from 0 to below 360.
    pub gantry_deg: f64,
    /// IEC 61217 couch angle (patient support), degrees from 0 to below 360.
    pub couch_deg: f64,
    /// Isocentre, mm in the DICOM patient frame.
    pub isocentre_mm: [f64; 3],
    /// Share of the plan, as its final cumulative meterset weight. It is no monitor units.
    pub weight: f64,
    /// Edges of the smallest rectangle around its bixels in the isocentre plane, mm: IEC beam limiting device x, then y. Segments
    /// have their own.
    pub field_mm: [[f64; 2]; 2],
    /// Its segments, in the order in which they are given; none in a plan without leaves, and none of an arc.
    pub segments: Vec<LeafSegment>,
    /// What it does while the gantry turns; nothing where it stands still.
    pub arc: Option<Arc>,
}

/// A turn of the gantry with the beam on.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    /// Whether the gantry turns clockwise: its IEC 61217 angle rises.
    pub clockwise: bool,
    /// Highest dose rate, monitor units a minute.
    pub mu_per_min: f64,
    /// Its control points, at least two. The gantry angle of the first is that of the beam.
    pub points: Vec<ArcPoint>,
}

/// A control point of an arc.
#[derive(Clone, Debug, PartialEq)]
pub struct ArcPoint {
    /// IEC 61217 gantry angle, degrees from 0 to below 360.
    pub gantry_deg: f64,
    /// Monitor units that were given up to here in one fraction: 0 at the first, never falling, above 0 at the last.
    pub given: f64,
    /// Tips of every leaf pair in the isocentre plane, those at lower x first, mm.
    pub tips_mm: Vec<[f64; 2]>,
}

/// One segment of a beam.
#[derive(Clone, Debug, PartialEq)]
pub struct LeafSegment {
    /// Tips of every leaf pair in the isocentre plane, those at lower x first, mm.
    pub tips_mm: Vec<[f64; 2]>,
    /// Edges of the jaws in the isocentre plane, mm: IEC beam limiting device x, then y.
    pub field_mm: [[f64; 2]; 2],
    /// Monitor units in one fraction.
    pub monitor_units: f64,
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
    /// Edges of the leaf pairs along y of the collimator, mm, rising; none where the fluence is not sequenced. With edges
    /// every beam has segments, and its weight is not written.
    pub leaf_edges_mm: &'a [f64],
    /// Its beams.
    pub beams: &'a [Beam],
}

/// The RTPLAN file of this plan. Without leaves it says in it that the fluence is not sequenced for a collimator.
pub fn plan_file(export: &Export<'_>, plan: &Plan<'_>) -> Result<Exported, ExportError> {
    let mut file = Writer::default();
    file.belongs(export, uids::RT_PLAN_STORAGE, "RTPLAN");
    file.put(tags::RT_PLAN_LABEL, VR::SH, fitting("label of a plan", plan.label, 16)?);
    file.put(tags::RT_PLAN_DESCRIPTION, VR::ST, plan.says());
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
    let beams = plan.beams.iter().enumerate().map(|(i, b)| beam(i + 1, b, plan));
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
        return Err(ExportError::Number {
            what: "a number of fractions",
            value,
            why: "1 to 100 is expected",
        });
    }
    let mut group = Writer::default();
    group.whole(tags::FRACTION_GROUP_NUMBER, 1);
    group.whole(tags::NUMBER_OF_FRACTIONS_PLANNED, plan.fractions as usize);
    group.whole(tags::NUMBER_OF_BEAMS, plan.beams.len()).whole(tags::NUMBER_OF_BRACHY_APPLICATION_SETUPS, 0);
    let references = plan.beams.iter().enumerate().map(|(i, beam)| {
        let mut item = Writer::default();
        if plan.has_leaves() {
            item.decimals(tags::BEAM_METERSET, &[monitor_units(beam)?]);
        }
        item.whole(tags::REFERENCED_BEAM_NUMBER, i + 1);
        Ok(item)
    });
    group.sequence(tags::REFERENCED_BEAM_SEQUENCE, references.collect::<Result<_, ExportError>>()?);
    Ok(group)
}

impl Plan<'_> {
    fn has_leaves(&self) -> bool {
        !self.leaf_edges_mm.is_empty()
    }

    fn says(&self) -> &'static str {
        match (self.has_leaves(), self.beams.iter().any(|beam| beam.arc.is_some())) {
            (_, true) => TURNED,
            (true, false) => SEQUENCED,
            (false, false) => NOT_SEQUENCED,
        }
    }
}

/// Monitor units of a beam in one fraction.
fn monitor_units(beam: &Beam) -> Result<f64, ExportError> {
    if let Some(arc) = &beam.arc {
        return given(arc);
    }
    for segment in &beam.segments {
        positive("a number of monitor units", segment.monitor_units)?;
    }
    positive("a number of monitor units", beam.segments.iter().map(|s| s.monitor_units).sum())
}

fn beam(number: usize, beam: &Beam, plan: &Plan<'_>) -> Result<Writer, ExportError> {
    let machine = &plan.machine;
    let mut item = Writer::default();
    item.whole(tags::BEAM_NUMBER, number);
    item.put(tags::BEAM_NAME, VR::LO, fitting("name of a beam", &beam.name, 64)?);
    item.put(tags::BEAM_DESCRIPTION, VR::ST, plan.says());
    let kind = if beam.arc.is_some() { "DYNAMIC" } else { "STATIC" };
    item.put(tags::BEAM_TYPE, VR::CS, kind).put(tags::RADIATION_TYPE, VR::CS, "PHOTON");
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
    let mut devices = vec![device("ASYMX"), device("ASYMY")];
    devices.extend(leaves(plan.leaf_edges_mm)?);
    item.sequence(tags::BEAM_LIMITING_DEVICE_SEQUENCE, devices);
    for none in
        [tags::NUMBER_OF_WEDGES, tags::NUMBER_OF_COMPENSATORS, tags::NUMBER_OF_BOLI, tags::NUMBER_OF_BLOCKS]
    {
        item.whole(none, 0);
    }
    item.whole(tags::REFERENCED_PATIENT_SETUP_NUMBER, 1);
    let (last, points) = match &beam.arc {
        Some(arc) => turned(beam, arc, plan)?,
        None if plan.has_leaves() => shot(beam, plan)?,
        None => even(beam, machine)?,
    };
    item.whole(tags::NUMBER_OF_CONTROL_POINTS, points.len());
    item.decimals(tags::FINAL_CUMULATIVE_METERSET_WEIGHT, &[last]);
    item.sequence(tags::CONTROL_POINT_SEQUENCE, points);
    Ok(item)
}

/// The multileaf collimator, where there is one.
fn leaves(edges_mm: &[f64]) -> Result<Option<Writer>, ExportError> {
    if edges_mm.is_empty() {
        return Ok(None);
    }
    let rising = edges_mm.windows(2).all(|pair| pair[0] < pair[1]);
    let near = edges_mm.iter().all(|edge| edge.abs() <= FARTHEST_MM);
    if !(rising && near && edges_mm.len() > 1) {
        let why = "edges must rise within 1 m of the axis, one more than there are pairs";
        return Err(ExportError::Number { what: "an edge of a leaf", value: edges_mm[0], why });
    }
    let mut device = Writer::default();
    device.put(tags::RT_BEAM_LIMITING_DEVICE_TYPE, VR::CS, "MLCX");
    device.whole(tags::NUMBER_OF_LEAF_JAW_PAIRS, edges_mm.len() - 1);
    device.decimals(tags::LEAF_POSITION_BOUNDARIES, edges_mm);
    Ok(Some(device))
}

/// Final weight and control points of a beam whose fluence is not sequenced.
fn even(beam: &Beam, machine: &Machine<'_>) -> Result<(f64, Vec<Writer>), ExportError> {
    let weight = positive("a weight of a beam", beam.weight)?;
    let mut end = Writer::default();
    end.whole(tags::CONTROL_POINT_INDEX, 1).decimals(tags::CUMULATIVE_METERSET_WEIGHT, &[weight]);
    Ok((weight, vec![start(beam, beam.field_mm, machine, None)?, end]))
}

/// Final weight and control points of segments: two for each, between which its monitor units are given. The leaves move
/// between the second of one and the first of the next.
fn shot(beam: &Beam, plan: &Plan<'_>) -> Result<(f64, Vec<Writer>), ExportError> {
    let whole = monitor_units(beam)?;
    let (mut given, mut points) = (0.0, Vec::new());
    // Jaws that move stand at every control point, jaws that stand still at the first alone.
    let jaws_move = beam.segments.windows(2).any(|pair| pair[0].field_mm != pair[1].field_mm);
    let devices = |segment: &LeafSegment| {
        let mut devices = if jaws_move { jaws(segment.field_mm)? } else { Vec::new() };
        devices.push(positions(&segment.tips_mm, plan.leaf_edges_mm)?);
        Ok::<_, ExportError>(devices)
    };
    for (number, segment) in beam.segments.iter().enumerate() {
        let begin = match number {
            0 => {
                let leaves = positions(&segment.tips_mm, plan.leaf_edges_mm)?;
                start(beam, segment.field_mm, &plan.machine, Some(leaves))?
            }
            _ => {
                let mut point = Writer::default();
                point.whole(tags::CONTROL_POINT_INDEX, 2 * number);
                point.decimals(tags::CUMULATIVE_METERSET_WEIGHT, &[given / whole]);
                point.sequence(tags::BEAM_LIMITING_DEVICE_POSITION_SEQUENCE, devices(segment)?);
                point
            }
        };
        given += segment.monitor_units;
        // The last is 1 to the digit, whatever the sum.
        let until = if number + 1 == beam.segments.len() { 1.0 } else { given / whole };
        let mut end = Writer::default();
        end.whole(tags::CONTROL_POINT_INDEX, 2 * number + 1);
        end.decimals(tags::CUMULATIVE_METERSET_WEIGHT, &[until]);
        end.sequence(tags::BEAM_LIMITING_DEVICE_POSITION_SEQUENCE, devices(segment)?);
        points.extend([begin, end]);
    }
    Ok((1.0, points))
}

/// Monitor units of an arc in one fraction.
fn given(arc: &Arc) -> Result<f64, ExportError> {
    let mut last = 0.0;
    for (number, point) in arc.points.iter().enumerate() {
        let is_sound = if number == 0 { point.given == 0.0 } else { point.given >= last };
        if !(is_sound && point.given.is_finite()) {
            let why = "0 at the first control point of an arc is expected, and no fall after it";
            return Err(ExportError::Number { what: "a number of monitor units", value: point.given, why });
        }
        last = point.given;
    }
    positive("a number of monitor units", last)
}

/// Final weight and control points of an arc: one for each angle, each with all that changes.
fn turned(beam: &Beam, arc: &Arc, plan: &Plan<'_>) -> Result<(f64, Vec<Writer>), ExportError> {
    let whole = given(arc)?;
    let turn = if arc.clockwise { "CW" } else { "CC" };
    let mut points = Vec::with_capacity(arc.points.len());
    for (number, at) in arc.points.iter().enumerate() {
        let is_last = number + 1 == arc.points.len();
        let leaves = positions(&at.tips_mm, plan.leaf_edges_mm)?;
        let gantry_deg = angle("a gantry angle", at.gantry_deg)?;
        let mut point = if number == 0 {
            let mut point = start(beam, beam.field_mm, &plan.machine, Some(leaves))?;
            point.decimals(tags::DOSE_RATE_SET, &[positive("a dose rate", arc.mu_per_min)?]);
            point
        } else {
            let mut point = Writer::default();
            point.whole(tags::CONTROL_POINT_INDEX, number);
            // The last is 1 to the digit, whatever the sum.
            let until = if is_last { 1.0 } else { at.given / whole };
            point.decimals(tags::CUMULATIVE_METERSET_WEIGHT, &[until]);
            point.sequence(tags::BEAM_LIMITING_DEVICE_POSITION_SEQUENCE, vec![leaves]);
            point
        };
        // The sense is that of the turn from here on.
        point.decimals(tags::GANTRY_ANGLE, &[gantry_deg]).put(
            tags::GANTRY_ROTATION_DIRECTION,
            VR::CS,
            if is_last { "NONE" } else { turn },
        );
        points.push(point);
    }
    Ok((1.0, points))
}

/// Where the leaves stand: all tips at lower x, then all at higher x.
fn positions(tips_mm: &[[f64; 2]], edges_mm: &[f64]) -> Result<Writer, ExportError> {
    if tips_mm.len() + 1 != edges_mm.len() {
        let why = "each leaf pair needs the places of its tips";
        return Err(ExportError::Number { what: "a number of leaf pairs", value: tips_mm.len() as f64, why });
    }
    let good = |[low, high]: &[f64; 2]| low <= high && low.abs().max(high.abs()) <= FARTHEST_MM;
    if let Some([low, _]) = tips_mm.iter().find(|tips| !good(tips)) {
        let why = "tips must not overlap and must be within 1 m of the axis";
        return Err(ExportError::Number { what: "a place of a leaf", value: *low, why });
    }
    let both: Vec<f64> = (0..2).flat_map(|bank| tips_mm.iter().map(move |tips| tips[bank])).collect();
    let mut leaves = Writer::default();
    leaves.put(tags::RT_BEAM_LIMITING_DEVICE_TYPE, VR::CS, "MLCX");
    leaves.decimals(tags::LEAF_JAW_POSITIONS, &both);
    Ok(leaves)
}

/// The control point that places the beam.
fn start(
    beam: &Beam,
    field_mm: [[f64; 2]; 2],
    machine: &Machine<'_>,
    leaves: Option<Writer>,
) -> Result<Writer, ExportError> {
    let mut point = Writer::default();
    point.whole(tags::CONTROL_POINT_INDEX, 0).decimals(tags::CUMULATIVE_METERSET_WEIGHT, &[0.0]);
    point.decimals(tags::NOMINAL_BEAM_ENERGY, &[positive("an energy", machine.energy_mv)?]);
    angle("a gantry angle", beam.gantry_deg)?;
    angle("a couch angle", beam.couch_deg)?;
    point.decimals(tags::GANTRY_ANGLE, &[beam.gantry_deg]).put(
        tags::GANTRY_ROTATION_DIRECTION,
        VR::CS,
        "NONE",
    );
    for (angle, direction, degrees) in [
        (tags::BEAM_LIMITING_DEVICE_ANGLE, tags::BEAM_LIMITING_DEVICE_ROTATION_DIRECTION, 0.0),
        (tags::PATIENT_SUPPORT_ANGLE, tags::PATIENT_SUPPORT_ROTATION_DIRECTION, beam.couch_deg),
        (tags::TABLE_TOP_ECCENTRIC_ANGLE, tags::TABLE_TOP_ECCENTRIC_ROTATION_DIRECTION, 0.0),
    ] {
        point.decimals(angle, &[degrees]).put(direction, VR::CS, "NONE");
    }
    for unknown in [
        tags::TABLE_TOP_VERTICAL_POSITION,
        tags::TABLE_TOP_LONGITUDINAL_POSITION,
        tags::TABLE_TOP_LATERAL_POSITION,
    ] {
        point.empty(unknown, VR::DS);
    }
    if let Some(&value) = beam.isocentre_mm.iter().find(|c| c.is_nan() || c.abs() > 1e5) {
        let why = "a position within 100 m is expected";
        return Err(ExportError::Number { what: "a coordinate of the isocentre", value, why });
    }
    point.decimals(tags::ISOCENTER_POSITION, &beam.isocentre_mm);
    let mut devices = jaws(field_mm)?;
    devices.extend(leaves);
    point.sequence(tags::BEAM_LIMITING_DEVICE_POSITION_SEQUENCE, devices);
    Ok(point)
}

/// Where the jaws stand.
fn jaws(field_mm: [[f64; 2]; 2]) -> Result<Vec<Writer>, ExportError> {
    let mut jaws = Vec::new();
    for (kind, [low, high]) in ["ASYMX", "ASYMY"].into_iter().zip(field_mm) {
        if !(low < high && low >= -1000.0 && high <= 1000.0) {
            let why = "its edges must rise within 1 m of the axis";
            return Err(ExportError::Number { what: "a width of a field", value: high - low, why });
        }
        let mut jaw = Writer::default();
        jaw.put(tags::RT_BEAM_LIMITING_DEVICE_TYPE, VR::CS, kind);
        jaw.decimals(tags::LEAF_JAW_POSITIONS, &[low, high]);
        jaws.push(jaw);
    }
    Ok(jaws)
}

fn angle(what: &'static str, value: f64) -> Result<f64, ExportError> {
    match (0.0..360.0).contains(&value) {
        true => Ok(value),
        false => Err(ExportError::Number { what, value, why: "0 to below 360 degrees is expected" }),
    }
}

fn positive(what: &'static str, value: f64) -> Result<f64, ExportError> {
    match value.is_finite() && value > 0.0 {
        true => Ok(value),
        false => Err(ExportError::Number { what, value, why: "a number above 0 is expected" }),
    }
}
