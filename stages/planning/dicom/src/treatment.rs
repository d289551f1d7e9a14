//! RTPLAN, read: where gantry and collimator stand while each part of the meterset is given.
//!
//! A control point carries what changes; what it does not name stays as it was (PS3.3 C.8.8.14). Only photons of an open
//! field are read: what the beam passes besides jaws and leaves (wedges, blocks, compensators, boluses) is refused, since a
//! dose without it would be another.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_patient::case::Uid;

use crate::element::{TagError, exactly, items, padded_numbers, text, text_if_any, uid, whole, wrong};

/// Beams and control points of a plan at most: more are none of a machine.
const MOST_BEAMS: usize = 200;
const MOST_POINTS: usize = 2000;
/// Farthest from the axis that an edge of a field can be, mm.
const FARTHEST_MM: f64 = 1000.0;
/// How far a cumulative weight may fall by rounding, as a part of the final one.
const ROUNDING: f64 = 1e-5;
/// Angle up to which a table top counts as level, degrees.
const LEVEL_DEG: f64 = 0.05;

/// A plan as it is to be delivered.
#[derive(Clone, Debug, PartialEq)]
pub struct TreatmentPlan {
    /// The plan itself.
    pub uid: Uid,
    /// The frame of reference of its places, if it states one.
    pub frame_of_reference: Option<Uid>,
    /// How the patient lies, as the file says it (`HFS`), if it does.
    pub position: Option<String>,
    /// Its name.
    pub label: String,
    /// Number of fractions.
    pub fractions: u32,
    /// Beams that give photons, in the order of the file.
    pub beams: Vec<TreatmentBeam>,
    /// What is left out, a sentence each: beams for the set-up alone.
    pub left_out: Vec<String>,
}

/// A beam.
#[derive(Clone, Debug, PartialEq)]
pub struct TreatmentBeam {
    /// Its name, or its number.
    pub name: String,
    /// Nominal energy of the photons, MV, where the plan states it.
    pub energy_mv: Option<f64>,
    /// Distance of the source from the axis of rotation, mm, where the plan states it.
    pub source_axis_mm: Option<f64>,
    /// Isocentre, mm in the DICOM patient frame.
    pub isocentre_mm: [f64; 3],
    /// Monitor units in one fraction.
    pub monitor_units: f64,
    /// Its leaves, if it has any.
    pub leaves: Option<Leaves>,
    /// Its control points, at least two.
    pub points: Vec<ControlPoint>,
}

/// The leaf pairs of a collimator.
#[derive(Clone, Debug, PartialEq)]
pub struct Leaves {
    /// Whether they travel along y of the collimator (MLCY), and not along x (MLCX).
    pub along_y: bool,
    /// Edges of the pairs across their travel, rising, mm on the isocentre plane.
    pub edges_mm: Vec<f64>,
}

/// Where all stands at a moment of a beam. Between two of them all changes linearly with the meterset.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlPoint {
    /// Part of the beam's meterset that was given up to here, 0 to 1.
    pub given: f64,
    /// IEC 61217 gantry angle, degrees. It runs on beyond 0 and 360, so that it changes by what the gantry turns.
    pub gantry_deg: f64,
    /// IEC 61217 collimator angle, degrees, which runs on in the same way.
    pub collimator_deg: f64,
    /// IEC 61217 couch angle (patient support), degrees, which runs on in the same way.
    pub couch_deg: f64,
    /// Lower and upper edge of the jaws along x, then y of the collimator, mm on the isocentre plane; none of a machine without.
    pub jaws_mm: [Option<[f64; 2]>; 2],
    /// Tips of every leaf pair, those at the lower coordinate first, mm; empty without leaves.
    pub tips_mm: Vec<[f64; 2]>,
}

impl TreatmentPlan {
    /// The plan in this data set.
    ///
    /// # Errors
    /// A tag that is missing or that says what is not read.
    pub fn read(object: &InMemDicomObject) -> Result<Self, TagError> {
        let modality = text(object, tags::MODALITY)?;
        if modality != "RTPLAN" {
            return wrong(tags::MODALITY, modality, "an RTPLAN of photons or electrons is expected");
        }
        let label = text_if_any(object, tags::RT_PLAN_LABEL)?.unwrap_or_default();
        let groups = items(object, tags::FRACTION_GROUP_SEQUENCE);
        let [group] = groups else {
            let why = "one fraction group is expected: give the plan of one phase";
            return wrong(tags::FRACTION_GROUP_SEQUENCE, format!("{} groups", groups.len()), why);
        };
        let planned = whole(group, tags::NUMBER_OF_FRACTIONS_PLANNED)?;
        let fractions = match u32::try_from(planned) {
            Ok(fractions @ 1..=100) => fractions,
            _ => return wrong(tags::NUMBER_OF_FRACTIONS_PLANNED, planned, "1 to 100 is expected"),
        };
        let described = items(object, tags::BEAM_SEQUENCE);
        if described.is_empty() || described.len() > MOST_BEAMS {
            let why = "1 to 200 beams of an external machine are expected";
            return wrong(tags::BEAM_SEQUENCE, format!("{} beams", described.len()), why);
        }
        let (mut beams, mut left_out) = (Vec::new(), Vec::new());
        for beam in described {
            let number = whole(beam, tags::BEAM_NUMBER)?;
            let name = text_if_any(beam, tags::BEAM_NAME)?.unwrap_or_else(|| format!("beam {number}"));
            let of_beam = |source| TagError::Beam { name: name.clone(), source: Box::new(source) };
            let kind = text_if_any(beam, tags::TREATMENT_DELIVERY_TYPE)?.unwrap_or_default();
            if kind == "SETUP" {
                left_out.push(format!("{name:?} is for the set-up and gives no dose that counts"));
                continue;
            }
            beams.push(read_beam(beam, number, name.clone(), group).map_err(of_beam)?);
        }
        if beams.is_empty() {
            return wrong(
                tags::BEAM_SEQUENCE,
                "beams for the set-up alone",
                "a beam that treats is expected",
            );
        }
        let frame_of_reference = match text_if_any(object, tags::FRAME_OF_REFERENCE_UID)? {
            Some(_) => Some(uid(object, tags::FRAME_OF_REFERENCE_UID)?),
            None => None,
        };
        let position = match items(object, tags::PATIENT_SETUP_SEQUENCE) {
            [setup, ..] => text_if_any(setup, tags::PATIENT_POSITION)?,
            [] => None,
        };
        let uid = uid(object, tags::SOP_INSTANCE_UID)?;
        Ok(Self { uid, frame_of_reference, position, label, fractions, beams, left_out })
    }
}

/// Monitor units of a beam in a fraction.
fn meterset(group: &InMemDicomObject, number: i64) -> Result<f64, TagError> {
    for item in items(group, tags::REFERENCED_BEAM_SEQUENCE) {
        if whole(item, tags::REFERENCED_BEAM_NUMBER)? == number {
            let [units] = exactly(item, tags::BEAM_METERSET)?;
            return match units > 0.0 && units <= 1e6 {
                true => Ok(units),
                false => wrong(tags::BEAM_METERSET, units, "monitor units above 0 are expected"),
            };
        }
    }
    wrong(tags::REFERENCED_BEAM_SEQUENCE, format!("no beam {number}"), "its monitor units are expected there")
}

fn read_beam(
    beam: &InMemDicomObject,
    number: i64,
    name: String,
    group: &InMemDicomObject,
) -> Result<TreatmentBeam, TagError> {
    let radiation = text(beam, tags::RADIATION_TYPE)?;
    if radiation != "PHOTON" {
        return wrong(tags::RADIATION_TYPE, radiation, "photons are read");
    }
    if let Some(unit) = text_if_any(beam, tags::PRIMARY_DOSIMETER_UNIT)?
        && unit != "MU"
    {
        return wrong(tags::PRIMARY_DOSIMETER_UNIT, unit, "monitor units (MU) are read");
    }
    for (tag, why) in [
        (tags::NUMBER_OF_WEDGES, "fields with a wedge are not read"),
        (tags::NUMBER_OF_COMPENSATORS, "fields with a compensator are not read"),
        (tags::NUMBER_OF_BLOCKS, "fields with a block are not read"),
        (tags::NUMBER_OF_BOLI, "fields with a bolus are not read: draw it as a structure of the type BOLUS"),
    ] {
        if text_if_any(beam, tag)?.is_some_and(|count| count != "0") {
            return wrong(tag, whole(beam, tag)?, why);
        }
    }
    let number_if_any = |object: &InMemDicomObject, tag: Tag| match text_if_any(object, tag)? {
        None => Ok(None),
        Some(_) => exactly(object, tag).map(|[value]: [f64; 1]| Some(value)),
    };
    let devices = Devices::read(beam)?;
    let described = items(beam, tags::CONTROL_POINT_SEQUENCE);
    if !(2..=MOST_POINTS).contains(&described.len()) {
        let why = "2 to 2000 control points are expected";
        return wrong(tags::CONTROL_POINT_SEQUENCE, format!("{} points", described.len()), why);
    }
    let first = &described[0];
    let [last] = exactly(beam, tags::FINAL_CUMULATIVE_METERSET_WEIGHT)?;
    if last.is_nan() || last <= 0.0 {
        let why = "a weight above 0 is expected";
        return wrong(tags::FINAL_CUMULATIVE_METERSET_WEIGHT, last, why);
    }
    let isocentre_mm = exactly(first, tags::ISOCENTER_POSITION)?;
    let mut points: Vec<ControlPoint> = Vec::with_capacity(described.len());
    for point in described {
        points.push(devices.point(point, points.last(), last)?);
        if text_if_any(point, tags::ISOCENTER_POSITION)?.is_some() {
            let at: [f64; 3] = exactly(point, tags::ISOCENTER_POSITION)?;
            if at.iter().zip(isocentre_mm).any(|(a, b)| (a - b).abs() > 0.01) {
                let why = "the isocentre must not move within a beam";
                return wrong(tags::ISOCENTER_POSITION, format!("{at:?}"), why);
            }
        }
    }
    let end = points.last().map_or(0.0, |point| point.given);
    if (end - 1.0).abs() > 1e-3 {
        let why = "the last control point must have the final weight";
        return wrong(tags::CUMULATIVE_METERSET_WEIGHT, end * last, why);
    }
    Ok(TreatmentBeam {
        name,
        energy_mv: number_if_any(first, tags::NOMINAL_BEAM_ENERGY)?,
        source_axis_mm: number_if_any(beam, tags::SOURCE_AXIS_DISTANCE)?,
        isocentre_mm,
        monitor_units: meterset(group, number)?,
        leaves: devices.leaves,
        points,
    })
}

/// What limits a beam.
struct Devices {
    leaves: Option<Leaves>,
}

impl Devices {
    fn read(beam: &InMemDicomObject) -> Result<Self, TagError> {
        let mut leaves = None;
        for device in items(beam, tags::BEAM_LIMITING_DEVICE_SEQUENCE) {
            let kind = text(device, tags::RT_BEAM_LIMITING_DEVICE_TYPE)?;
            let along_y = match kind.as_str() {
                "X" | "Y" | "ASYMX" | "ASYMY" => continue,
                "MLCX" => false,
                "MLCY" => true,
                _ => return wrong(tags::RT_BEAM_LIMITING_DEVICE_TYPE, kind, "jaws, MLCX and MLCY are read"),
            };
            if leaves.is_some() {
                let why = "one multileaf collimator is read; this beam has two layers";
                return wrong(tags::RT_BEAM_LIMITING_DEVICE_TYPE, kind, why);
            }
            let edges_mm = padded_numbers(device, tags::LEAF_POSITION_BOUNDARIES)?;
            let pairs = whole(device, tags::NUMBER_OF_LEAF_JAW_PAIRS)?;
            let rises = edges_mm.windows(2).all(|pair| pair[0] < pair[1]);
            let is_near = edges_mm.iter().all(|edge| edge.abs() <= FARTHEST_MM);
            if !(rises && is_near && (1..=500).contains(&pairs) && edges_mm.len() as i64 == pairs + 1) {
                let why = "edges of the leaf pairs rise, one more than there are pairs";
                return wrong(
                    tags::LEAF_POSITION_BOUNDARIES,
                    format!("{} edges, {pairs} pairs", edges_mm.len()),
                    why,
                );
            }
            leaves = Some(Leaves { along_y, edges_mm });
        }
        Ok(Self { leaves })
    }

    /// A control point after the one before.
    fn point(
        &self,
        point: &InMemDicomObject,
        before: Option<&ControlPoint>,
        last: f64,
    ) -> Result<ControlPoint, TagError> {
        let [weight] = exactly(point, tags::CUMULATIVE_METERSET_WEIGHT)?;
        let given = weight / last;
        let least = before.map_or(0.0, |point| point.given);
        if !(least - ROUNDING..=1.0 + 1e-3).contains(&given) || (before.is_none() && given > ROUNDING) {
            let why = "cumulative weights begin with 0 and rise to the final one";
            return wrong(tags::CUMULATIVE_METERSET_WEIGHT, weight, why);
        }
        let angle = |tag, of: fn(&ControlPoint) -> f64| turned(point, tag, before.map(of));
        // A table top that is turned about itself or tilted is another geometry.
        for tag in [tags::TABLE_TOP_ECCENTRIC_ANGLE, tags::TABLE_TOP_PITCH_ANGLE, tags::TABLE_TOP_ROLL_ANGLE]
        {
            if let Some(turned) = turned(point, tag, None)?
                && turned.abs().min((turned.abs() - 360.0).abs()) > LEVEL_DEG
            {
                return wrong(tag, turned, "a level table top is read: 0 degrees is expected");
            }
        }
        let Some(gantry_deg) = angle(tags::GANTRY_ANGLE, |p| p.gantry_deg)? else {
            return Err(TagError::Missing(tags::GANTRY_ANGLE));
        };
        let mut next = ControlPoint {
            given: given.clamp(least, 1.0),
            gantry_deg,
            collimator_deg: angle(tags::BEAM_LIMITING_DEVICE_ANGLE, |p| p.collimator_deg)?.unwrap_or(0.0),
            couch_deg: angle(tags::PATIENT_SUPPORT_ANGLE, |p| p.couch_deg)?.unwrap_or(0.0),
            jaws_mm: before.map_or([None; 2], |b| b.jaws_mm),
            tips_mm: before.map_or_else(Vec::new, |b| b.tips_mm.clone()),
        };
        for device in items(point, tags::BEAM_LIMITING_DEVICE_POSITION_SEQUENCE) {
            let kind = text(device, tags::RT_BEAM_LIMITING_DEVICE_TYPE)?;
            let places = padded_numbers(device, tags::LEAF_JAW_POSITIONS)?;
            match kind.as_str() {
                "X" | "ASYMX" => next.jaws_mm[0] = Some(jaws(&places)?),
                "Y" | "ASYMY" => next.jaws_mm[1] = Some(jaws(&places)?),
                _ => next.tips_mm = self.tips(&places)?,
            }
        }
        match &self.leaves {
            Some(leaves) if next.tips_mm.len() + 1 != leaves.edges_mm.len() => {
                Err(TagError::Missing(tags::LEAF_JAW_POSITIONS))
            }
            None if next.jaws_mm.contains(&None) => {
                Err(TagError::Missing(tags::BEAM_LIMITING_DEVICE_POSITION_SEQUENCE))
            }
            _ => Ok(next),
        }
    }

    /// The tips of leaf pairs: those at the lower coordinate, then the others.
    fn tips(&self, places: &[f64]) -> Result<Vec<[f64; 2]>, TagError> {
        let pairs = self.leaves.as_ref().map_or(0, |leaves| leaves.edges_mm.len() - 1);
        if pairs == 0 || places.len() != 2 * pairs {
            let why = "two tips of each leaf pair are expected";
            return wrong(tags::LEAF_JAW_POSITIONS, format!("{} places", places.len()), why);
        }
        let tips: Vec<[f64; 2]> = (0..pairs).map(|pair| [places[pair], places[pairs + pair]]).collect();
        // Planning systems write tips that pass each other by rounding.
        let is_good = |[low, high]: &[f64; 2]| low - high < 0.1 && low.abs().max(high.abs()) <= FARTHEST_MM;
        match tips.iter().find(|tips| !is_good(tips)) {
            None => Ok(tips),
            Some(tips) => {
                wrong(tags::LEAF_JAW_POSITIONS, format!("{tips:?}"), "tips must not pass each other")
            }
        }
    }
}

fn jaws(places: &[f64]) -> Result<[f64; 2], TagError> {
    match places {
        [low, high] if low <= high && low.abs().max(high.abs()) <= FARTHEST_MM => Ok([*low, *high]),
        _ => wrong(tags::LEAF_JAW_POSITIONS, format!("{places:?}"), "two edges that rise are expected"),
    }
}

/// An angle at a control point, degrees, which runs on from the one before by the shorter way: the points of an arc are far
/// less than half a turn apart.
fn turned(point: &InMemDicomObject, tag: Tag, before: Option<f64>) -> Result<Option<f64>, TagError> {
    if text_if_any(point, tag)?.is_none() {
        return Ok(before);
    }
    let [angle] = exactly(point, tag)?;
    let Some(before) = before else { return Ok(Some(angle)) };
    let turn = (angle - before).rem_euclid(360.0);
    let turn = if turn > 180.0 { turn - 360.0 } else { turn };
    if turn.abs() > 90.0 {
        let why = "control points more than a quarter turn apart do not say where the meterset is given";
        return wrong(tag, angle, why);
    }
    Ok(Some(before + turn))
}
