//! Small CT series and structure sets, as another program would write them.

use std::path::Path;

use dicom_core::value::DataSetSequence;
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use dicom_object::meta::FileMetaTableBuilder;
use dicom_transfer_syntax_registry::entries::{EXPLICIT_VR_LITTLE_ENDIAN, IMPLICIT_VR_LITTLE_ENDIAN};

pub const STUDY: &str = "1.2.3.1";
pub const SERIES: &str = "1.2.3.2";
pub const FRAME: &str = "1.2.3.3";
pub const STRUCTURES: &str = "1.2.3.4";

/// Columns, rows and slices; voxels of 2 x 3 x 2.5 mm, the first at (-10, -12, 100).
pub const COUNTS: [usize; 3] = [12, 9, 5];

pub fn put(object: &mut InMemDicomObject, tag: Tag, vr: VR, value: impl Into<PrimitiveValue>) {
    object.put(DataElement::new(tag, vr, value.into()));
}

pub fn sequence(object: &mut InMemDicomObject, tag: Tag, items: Vec<InMemDicomObject>) {
    object.put(DataElement::new(tag, VR::SQ, DataSetSequence::from(items)));
}

fn patient() -> InMemDicomObject {
    let mut object = InMemDicomObject::new_empty();
    put(&mut object, tags::SPECIFIC_CHARACTER_SET, VR::CS, "ISO_IR 192");
    put(&mut object, tags::PATIENT_NAME, VR::PN, "M\u{fc}ller^Secret");
    put(&mut object, tags::PATIENT_ID, VR::LO, "SECRET-4711");
    put(&mut object, tags::PATIENT_BIRTH_DATE, VR::DA, PrimitiveValue::Str("19500203".to_owned()));
    put(&mut object, tags::PATIENT_SEX, VR::CS, "M");
    put(&mut object, tags::STUDY_INSTANCE_UID, VR::UI, STUDY);
    object
}

/// The CT image at this place; its values are 10 times the place of the pixel, and -1000.
pub fn ct(slice: usize) -> InMemDicomObject {
    let mut object = patient();
    put(&mut object, tags::SOP_CLASS_UID, VR::UI, uids::CT_IMAGE_STORAGE);
    put(&mut object, tags::SOP_INSTANCE_UID, VR::UI, format!("1.2.3.10.{slice}"));
    put(&mut object, tags::MODALITY, VR::CS, "CT");
    put(&mut object, tags::SERIES_INSTANCE_UID, VR::UI, SERIES);
    put(&mut object, tags::FRAME_OF_REFERENCE_UID, VR::UI, FRAME);
    put(&mut object, tags::PATIENT_POSITION, VR::CS, "HFS");
    let place = format!("-10\\-12\\{}", 100.0 + 2.5 * slice as f64);
    put(&mut object, tags::IMAGE_POSITION_PATIENT, VR::DS, place);
    put(&mut object, tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "1\\0\\0\\0\\1\\0");
    put(&mut object, tags::PIXEL_SPACING, VR::DS, "3\\2");
    put(&mut object, tags::SAMPLES_PER_PIXEL, VR::US, 1_u16);
    put(&mut object, tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2");
    put(&mut object, tags::COLUMNS, VR::US, COUNTS[0] as u16);
    put(&mut object, tags::ROWS, VR::US, COUNTS[1] as u16);
    put(&mut object, tags::BITS_ALLOCATED, VR::US, 16_u16);
    put(&mut object, tags::BITS_STORED, VR::US, 12_u16);
    put(&mut object, tags::HIGH_BIT, VR::US, 11_u16);
    put(&mut object, tags::PIXEL_REPRESENTATION, VR::US, 0_u16);
    put(&mut object, tags::RESCALE_SLOPE, VR::DS, "10");
    put(&mut object, tags::RESCALE_INTERCEPT, VR::DS, "-1000");
    // The upper four bits are not stored, whatever stands in them.
    let pixels: Vec<u16> = (0..COUNTS[0] * COUNTS[1]).map(|i| i as u16 | 0xA000).collect();
    put(&mut object, tags::PIXEL_DATA, VR::OW, PrimitiveValue::U16(pixels.into()));
    object
}

/// Corners of a rectangle: x from, x to, y from, y to.
pub fn rectangle([x0, x1, y0, y1]: [f64; 4]) -> Vec<[f64; 2]> {
    vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
}

pub fn contour(z_mm: f64, corners: &[[f64; 2]]) -> InMemDicomObject {
    let mut object = InMemDicomObject::new_empty();
    put(&mut object, tags::CONTOUR_GEOMETRIC_TYPE, VR::CS, "CLOSED_PLANAR");
    put(&mut object, tags::NUMBER_OF_CONTOUR_POINTS, VR::IS, corners.len().to_string());
    let points: Vec<String> = corners.iter().map(|[x, y]| format!("{x}\\{y}\\{z_mm}")).collect();
    put(&mut object, tags::CONTOUR_DATA, VR::DS, points.join("\\"));
    object
}

/// A structure set of these regions: name, interpreted type, contours.
pub fn structure_set(regions: Vec<(&str, &str, Vec<InMemDicomObject>)>) -> InMemDicomObject {
    let mut object = patient();
    put(&mut object, tags::SOP_CLASS_UID, VR::UI, uids::RT_STRUCTURE_SET_STORAGE);
    put(&mut object, tags::SOP_INSTANCE_UID, VR::UI, STRUCTURES);
    put(&mut object, tags::MODALITY, VR::CS, "RTSTRUCT");
    let item = |fill: &dyn Fn(&mut InMemDicomObject)| {
        let mut item = InMemDicomObject::new_empty();
        fill(&mut item);
        item
    };
    let series = item(&|o| put(o, tags::SERIES_INSTANCE_UID, VR::UI, SERIES));
    let study = item(&|o| sequence(o, tags::RT_REFERENCED_SERIES_SEQUENCE, vec![series.clone()]));
    let frame = item(&|o| {
        put(o, tags::FRAME_OF_REFERENCE_UID, VR::UI, FRAME);
        sequence(o, tags::RT_REFERENCED_STUDY_SEQUENCE, vec![study.clone()]);
    });
    sequence(&mut object, tags::REFERENCED_FRAME_OF_REFERENCE_SEQUENCE, vec![frame]);
    let (mut described, mut drawn, mut observed) = (Vec::new(), Vec::new(), Vec::new());
    for (number, (name, kind, contours)) in regions.into_iter().enumerate() {
        let number = (number + 1).to_string();
        described.push(item(&|o| {
            put(o, tags::ROI_NUMBER, VR::IS, number.as_str());
            put(o, tags::REFERENCED_FRAME_OF_REFERENCE_UID, VR::UI, FRAME);
            put(o, tags::ROI_NAME, VR::LO, name);
        }));
        drawn.push(item(&|o| {
            put(o, tags::REFERENCED_ROI_NUMBER, VR::IS, number.as_str());
            sequence(o, tags::CONTOUR_SEQUENCE, contours.clone());
        }));
        observed.push(item(&|o| {
            put(o, tags::REFERENCED_ROI_NUMBER, VR::IS, number.as_str());
            put(o, tags::RTROI_INTERPRETED_TYPE, VR::CS, kind);
        }));
    }
    sequence(&mut object, tags::STRUCTURE_SET_ROI_SEQUENCE, described);
    sequence(&mut object, tags::ROI_CONTOUR_SEQUENCE, drawn);
    sequence(&mut object, tags::RTROI_OBSERVATIONS_SEQUENCE, observed);
    object
}

/// The planes of all slices with one rectangle in each.
pub fn on_every_slice(corners: [f64; 4]) -> Vec<InMemDicomObject> {
    (0..COUNTS[2]).map(|z| contour(100.0 + 2.5 * z as f64, &rectangle(corners))).collect()
}

pub fn small_structures() -> InMemDicomObject {
    structure_set(vec![
        ("outline", "EXTERNAL", on_every_slice([-9.0, 11.0, -13.5, 13.5])),
        ("ptv", "PTV", on_every_slice([-1.0, 5.0, -1.5, 4.5])),
    ])
}

/// The file of a data set, explicit and with file meta information.
pub fn file(object: &InMemDicomObject) -> Vec<u8> {
    file_as(object, uids::EXPLICIT_VR_LITTLE_ENDIAN)
}

/// The file of a data set in this transfer syntax, which encodes as explicit little endian does.
pub fn file_as(object: &InMemDicomObject, syntax: &str) -> Vec<u8> {
    let text = |tag| object.get(tag).map(|e| e.to_str().unwrap().into_owned()).unwrap_or_default();
    let meta = FileMetaTableBuilder::new()
        .media_storage_sop_class_uid(text(tags::SOP_CLASS_UID))
        .media_storage_sop_instance_uid(text(tags::SOP_INSTANCE_UID))
        .transfer_syntax(syntax);
    let mut bytes = Vec::new();
    object.clone().with_meta(meta).unwrap().write_all(&mut bytes).unwrap();
    bytes
}

/// The data set alone, without preamble and file meta information.
pub fn bare(object: &InMemDicomObject, encoding: Encoding) -> Vec<u8> {
    let mut bytes = Vec::new();
    match encoding {
        Encoding::Implicit => object.write_dataset_with_ts(&mut bytes, &IMPLICIT_VR_LITTLE_ENDIAN.erased()),
        Encoding::Explicit => object.write_dataset_with_ts(&mut bytes, &EXPLICIT_VR_LITTLE_ENDIAN.erased()),
    }
    .unwrap();
    bytes
}

#[derive(Clone, Copy)]
pub enum Encoding {
    Implicit,
    Explicit,
}

/// A folder with the whole small case; its file names do not tell the order of the slices.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for slice in 0..COUNTS[2] {
        std::fs::write(folder.path().join(name(slice)), file(&ct(slice))).unwrap();
    }
    std::fs::write(folder.path().join("rs.dcm"), file(&small_structures())).unwrap();
    folder
}

/// The file name of a slice.
pub fn name(slice: usize) -> String {
    format!("ct{}.dcm", 7 * slice % COUNTS[2])
}

/// Writes another image over that of a slice.
pub fn replace(folder: &Path, slice: usize, change: impl FnOnce(&mut InMemDicomObject)) {
    let mut object = ct(slice);
    change(&mut object);
    std::fs::write(folder.join(name(slice)), file(&object)).unwrap();
}
