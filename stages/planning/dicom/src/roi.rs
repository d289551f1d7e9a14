//! The contours of a structure set.

use std::collections::BTreeMap;

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_patient::case::{Role, Uid};

use crate::element::{TagError, items, numbers, text, text_if_any, uid, whole, wrong};
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
    /// Its role, as far as the structure set says one.
    pub role: Role,
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
}

impl Rois {
    /// The regions of this structure set, in this frame of reference.
    pub fn read(object: &InMemDicomObject, frame_of_reference: &Uid) -> Result<Self, TagError> {
        Ok(Self { uid: uid(object, tags::SOP_INSTANCE_UID)?, rois: regions(object, frame_of_reference)? })
    }
}

fn regions(object: &InMemDicomObject, frame_of_reference: &Uid) -> Result<Vec<Roi>, TagError> {
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
    let drawn = by_roi(object, tags::ROI_CONTOUR_SEQUENCE)?;
    let mut rois = Vec::new();
    for described in described {
        let number = whole(described, tags::ROI_NUMBER)?;
        let role = match kinds.get(&number).and_then(|k| k.first()) {
            Some(kind) => text_if_any(kind, tags::RTROI_INTERPRETED_TYPE)?,
            None => None,
        };
        let mut roi = Roi {
            name: text_if_any(described, tags::ROI_NAME)?.unwrap_or_else(|| format!("ROI {number}")),
            role: role.and_then(|word| Role::of_interpreted_type(&word)).unwrap_or(Role::Other),
            contours: Vec::new(),
            lines: 0,
        };
        for drawn in drawn.get(&number).into_iter().flatten() {
            let frame = uid(described, tags::REFERENCED_FRAME_OF_REFERENCE_UID)?;
            if &frame != frame_of_reference {
                let why = "it is not the frame of reference of the images: give the images that the structures were drawn on";
                return wrong(
                    tags::REFERENCED_FRAME_OF_REFERENCE_UID,
                    format!("{frame} for {}", roi.name),
                    why,
                );
            }
            for (place, item) in items(drawn, tags::CONTOUR_SEQUENCE).iter().enumerate() {
                let of_region = |source| TagError::Contour {
                    number: place + 1,
                    region: roi.name.clone(),
                    source: Box::new(source),
                };
                match contour(item).map_err(of_region)? {
                    Some(contour) => roi.contours.push(contour),
                    None => roi.lines += 1,
                }
            }
        }
        rois.push(roi);
    }
    Ok(rois)
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

/// A closed contour; `None` for points and open lines.
fn contour(item: &InMemDicomObject) -> Result<Option<Contour>, TagError> {
    let kind = text(item, tags::CONTOUR_GEOMETRIC_TYPE)?;
    let kind = match kind.as_str() {
        "CLOSED_PLANAR" => ContourKind::Closed,
        "CLOSED_PLANAR_XOR" | "CLOSEDPLANAR_XOR" => ContourKind::Xor,
        "POINT" | "OPEN_PLANAR" | "OPEN_NONPLANAR" => return Ok(None),
        _ => return wrong(tags::CONTOUR_GEOMETRIC_TYPE, kind, "CLOSED_PLANAR is due"),
    };
    let values = numbers(item, tags::CONTOUR_DATA)?;
    let found = || format!("{} numbers", values.len());
    if values.len() % 3 != 0 {
        return wrong(tags::CONTOUR_DATA, found(), "three numbers for each point are due");
    }
    if item.get(tags::NUMBER_OF_CONTOUR_POINTS).is_some() {
        let due = whole(item, tags::NUMBER_OF_CONTOUR_POINTS)?;
        if usize::try_from(due).ok() != Some(values.len() / 3) {
            return wrong(
                tags::CONTOUR_DATA,
                found(),
                "(3006,0046) NumberOfContourPoints says another count: the contour is cut off",
            );
        }
    }
    let points = values.chunks_exact(3);
    let z_mm = values.get(2).copied().unwrap_or_default();
    if points.clone().any(|p| (p[2] - z_mm).abs() > FLAT_MM) {
        return wrong(
            tags::CONTOUR_DATA,
            "oblique",
            "contours must lie across the patient, in one plane each",
        );
    }
    if values.iter().any(|v| v.abs() > 1e5) {
        return wrong(tags::CONTOUR_DATA, "more than 100 m away", "positions are in mm");
    }
    Ok(Some(Contour { z_mm, xy_mm: points.map(|p| [p[0], p[1]]).collect(), kind }))
}
