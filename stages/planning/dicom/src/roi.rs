//! The contours of a structure set.

use std::collections::BTreeMap;

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_patient::case::{Role, Uid};

use crate::element::{TagError, exactly, items, padded_numbers, text, text_if_any, uid, whole, wrong};
use crate::raster::{Contour, ContourKind};

/// Contours may leave their plane by this much, mm.
const FLAT_MM: f64 = 0.05;
/// More regions than this are no patient's.
const MOST: usize = 500;

/// One region of interest.
#[derive(Clone, Debug, PartialEq)]
pub struct Roi {
    /// Its name, as written.
    pub name: String,
    /// Its interpreted type, if the structure set states one.
    pub kind: Option<String>,
    /// Its role, as far as the type says one.
    pub role: Option<Role>,
    /// Properties that the planner gave it, with their values: `REL_ELEC_DENSITY` and the like.
    pub properties: Vec<(String, f64)>,
    /// Its closed contours.
    pub contours: Vec<Contour>,
    /// Contours that are points or open lines, which hold no volume.
    pub lines: usize,
}

/// The regions of interest of a structure set, in its order.
#[derive(Clone, Debug, PartialEq)]
pub struct Rois {
    /// The structure set itself.
    pub uid: Uid,
    /// The regions.
    pub rois: Vec<Roi>,
    /// What cannot be used and is left out, a sentence each.
    pub left_out: Vec<String>,
}

impl Rois {
    /// The regions of this structure set, in this frame of reference. `tilt` is that of the images that they were drawn
    /// on, mm along z for each mm along y: planes of contours are where they cross `y = 0`.
    pub fn read(object: &InMemDicomObject, frame_of_reference: &Uid, tilt: f64) -> Result<Self, TagError> {
        let uid = uid(object, tags::SOP_INSTANCE_UID)?;
        let (rois, left_out) = regions(object, frame_of_reference, tilt)?;
        Ok(Self { uid, rois, left_out })
    }
}

fn regions(
    object: &InMemDicomObject,
    frame_of_reference: &Uid,
    tilt: f64,
) -> Result<(Vec<Roi>, Vec<String>), TagError> {
    let described = items(object, tags::STRUCTURE_SET_ROI_SEQUENCE);
    if described.is_empty() {
        return Err(TagError::Missing(tags::STRUCTURE_SET_ROI_SEQUENCE));
    }
    if described.len() > MOST {
        return wrong(
            tags::STRUCTURE_SET_ROI_SEQUENCE,
            format!("{} regions", described.len()),
            "at most 500 are read",
        );
    }
    if items(object, tags::ROI_CONTOUR_SEQUENCE).is_empty() {
        return Err(TagError::Missing(tags::ROI_CONTOUR_SEQUENCE));
    }
    let kinds = by_roi(object, tags::RTROI_OBSERVATIONS_SEQUENCE)?;
    let mut drawn = by_roi(object, tags::ROI_CONTOUR_SEQUENCE)?;
    let (mut rois, mut left_out) = (Vec::new(), Vec::new());
    let mut strangers = Vec::new();
    let mut numbers: BTreeMap<i64, String> = BTreeMap::new();
    for described in described {
        let number = whole(described, tags::ROI_NUMBER)?;
        let name = text_if_any(described, tags::ROI_NAME)?.unwrap_or_else(|| format!("ROI {number}"));
        let (kind, properties) =
            observed(kinds.get(&number).map_or(&[], Vec::as_slice), &name, &mut left_out)?;
        let contours = drawn.remove(&number).unwrap_or_default();
        if let Some(first) = numbers.insert(number, name.clone()) {
            return wrong(
                tags::ROI_NUMBER,
                format!("{number} for {first:?} and for {name:?}"),
                "whose contours are whose cannot be determined: give each region a number of its own",
            );
        }
        let role = kind.as_deref().and_then(Role::of_interpreted_type);
        let mut roi = Roi { name, kind, role, properties, contours: Vec::new(), lines: 0 };
        if !contours.is_empty() {
            let frame = frame(object, described)?;
            if &frame != frame_of_reference {
                strangers.push((frame, roi.name));
                continue;
            }
        }
        let mut empty = 0;
        for item in contours.iter().flat_map(|drawn| items(drawn, tags::CONTOUR_SEQUENCE)).enumerate() {
            let (place, item) = item;
            let of_region = |source| TagError::Contour {
                number: place + 1,
                region: roi.name.clone(),
                source: Box::new(source),
            };
            match contour(item, tilt).map_err(of_region)? {
                Drawing::Closed(contour) => roi.contours.push(contour),
                Drawing::Line => roi.lines += 1,
                Drawing::Empty => empty += 1,
            }
        }
        if empty > 0 {
            left_out.push(format!(
                "{:?}: {empty} contours have fewer than three points and are left out",
                roi.name
            ));
        }
        rois.push(roi);
    }
    others(strangers, &rois, &mut left_out)?;
    for (number, contours) in drawn {
        let count: usize = contours.iter().map(|drawn| items(drawn, tags::CONTOUR_SEQUENCE).len()).sum();
        left_out.push(format!("{count} contours are of the region number {number}, which the structure set does not describe, and are left out"));
    }
    Ok((rois, left_out))
}

/// Regions of another frame of reference: left out where others are of that of the images.
fn others(strangers: Vec<(Uid, String)>, rois: &[Roi], left_out: &mut Vec<String>) -> Result<(), TagError> {
    if let Some((frame, name)) = strangers.first()
        && rois.iter().all(|roi| roi.contours.is_empty())
    {
        let why = "it is not the frame of reference of the images: give the images that the structures were drawn on";
        return wrong(tags::REFERENCED_FRAME_OF_REFERENCE_UID, format!("{frame} for {name}"), why);
    }
    left_out.extend(strangers.into_iter().map(|(frame, name)| {
        format!("{name:?} is drawn in another frame of reference than the images, {frame}, and is left out")
    }));
    Ok(())
}

/// The frame of reference of a region: its own, or the only one of the structure set.
fn frame(object: &InMemDicomObject, described: &InMemDicomObject) -> Result<Uid, TagError> {
    let own = tags::REFERENCED_FRAME_OF_REFERENCE_UID;
    if text_if_any(described, own)?.is_some() {
        return uid(described, own);
    }
    match items(object, tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE) {
        [only] => uid(only, tags::FRAME_OF_REFERENCE_UID),
        _ => Err(TagError::Missing(own)),
    }
}

/// Type and properties of a region.
type Observed = (Option<String>, Vec<(String, f64)>);

/// Type and properties of a region. A type that means nothing is none.
fn observed(
    observations: &[&InMemDicomObject],
    name: &str,
    left_out: &mut Vec<String>,
) -> Result<Observed, TagError> {
    let mut kinds: Vec<String> = Vec::new();
    let mut properties = Vec::new();
    for observation in observations {
        let kind =
            text_if_any(observation, tags::RTROI_INTERPRETED_TYPE)?.map(|kind| kind.to_ascii_uppercase());
        if let Some(kind) = kind
            && !matches!(kind.as_str(), "OTHER" | "NONE" | "UNDEFINED" | "UNKNOWN")
            && !kinds.contains(&kind)
        {
            kinds.push(kind);
        }
        for property in items(observation, tags::ROI_PHYSICAL_PROPERTIES_SEQUENCE) {
            let what = text(property, tags::ROI_PHYSICAL_PROPERTY)?;
            if what == "ELEM_FRACTION" {
                left_out.push(format!("{name:?}: its elements (ELEM_FRACTION) are not used"));
                continue;
            }
            let [value] = exactly(property, tags::ROI_PHYSICAL_PROPERTY_VALUE)?;
            properties.push((what, value));
        }
    }
    if kinds.len() > 1 {
        left_out.push(format!("{name:?} has the types {}: the first holds", kinds.join(", ")));
    }
    Ok((kinds.into_iter().next(), properties))
}

/// The items of a sequence by the region that they refer to.
fn by_roi(
    object: &InMemDicomObject,
    sequence: Tag,
) -> Result<BTreeMap<i64, Vec<&InMemDicomObject>>, TagError> {
    let mut found: BTreeMap<i64, Vec<_>> = BTreeMap::new();
    for item in items(object, sequence) {
        found.entry(whole(item, tags::REFERENCED_ROI_NUMBER)?).or_default().push(item);
    }
    Ok(found)
}

/// The series that a structure set refers to.
pub fn series(object: &InMemDicomObject) -> Result<Vec<Uid>, TagError> {
    let mut found = Vec::new();
    for frame in items(object, tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE) {
        for study in items(frame, tags::RT_REFERENCED_STUDY_SEQUENCE) {
            for series in items(study, tags::RT_REFERENCED_SERIES_SEQUENCE) {
                found.push(uid(series, tags::SERIES_INSTANCE_UID)?);
            }
        }
    }
    Ok(found)
}

/// What an item of a contour sequence is.
enum Drawing {
    Closed(Contour),
    /// A point or an open line.
    Line,
    /// Fewer points than hold an area.
    Empty,
}

fn contour(item: &InMemDicomObject, tilt: f64) -> Result<Drawing, TagError> {
    let kind = text(item, tags::CONTOUR_GEOMETRIC_TYPE)?;
    let kind = match kind.as_str() {
        "CLOSED_PLANAR" => ContourKind::Closed,
        "CLOSED_PLANAR_XOR" | "CLOSEDPLANAR_XOR" => ContourKind::Xor,
        "POINT" | "OPEN_PLANAR" | "OPEN_NONPLANAR" => return Ok(Drawing::Line),
        _ => return wrong(tags::CONTOUR_GEOMETRIC_TYPE, kind, "CLOSED_PLANAR is expected"),
    };
    let expected = match text_if_any(item, tags::NUMBER_OF_CONTOUR_POINTS)? {
        None => None,
        // Some writers divide, and write the quotient.
        Some(count) => match count.parse::<f64>() {
            Ok(points) if points >= 0.0 && points.fract() == 0.0 => Some(points),
            _ => return wrong(tags::NUMBER_OF_CONTOUR_POINTS, count, "a whole number is expected"),
        },
    };
    if text_if_any(item, tags::CONTOUR_DATA)?.is_none() && expected.is_none_or(|points| points == 0.0) {
        return Ok(Drawing::Empty);
    }
    let values = padded_numbers(item, tags::CONTOUR_DATA)?;
    let found = || format!("{} numbers", values.len());
    if values.len() % 3 != 0 {
        return wrong(tags::CONTOUR_DATA, found(), "three numbers for each point are expected");
    }
    if expected.is_some_and(|points| points != (values.len() / 3) as f64) {
        return wrong(
            tags::CONTOUR_DATA,
            found(),
            "(3006,0046) NumberOfContourPoints says another count: the contour is cut off",
        );
    }
    let points = values.chunks_exact(3);
    let mut planes_mm = points.clone().map(|p| p[2] - tilt * p[1]);
    let z_mm = planes_mm.next().unwrap_or_default();
    if planes_mm.any(|plane| (plane - z_mm).abs() > FLAT_MM) {
        return wrong(
            tags::CONTOUR_DATA,
            "oblique",
            "each contour must be in one plane, parallel to the images",
        );
    }
    if values.iter().any(|v| v.abs() > 1e5) {
        return wrong(tags::CONTOUR_DATA, "more than 100 m away", "positions are in mm");
    }
    if points.len() < 3 {
        return Ok(Drawing::Empty);
    }
    Ok(Drawing::Closed(Contour { z_mm, xy_mm: points.map(|p| [p[0], p[1]]).collect(), kind }))
}
