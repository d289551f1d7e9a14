//! One CT image.

use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use stillpoint_plan::case::Uid;

use crate::dataset::DataSet;
use crate::element::{TagError, exactly, must_be, text, text_if_any, uid, whole, wrong};

/// How far the rows and columns may be turned from the patient's axes, as a cosine: under 0.01 degrees.
const OBLIQUE: f64 = 1e-4;
/// Padding outside the scanner's circle holds no measurement; it is air.
const AIR_HU: i16 = -1000;

/// One CT image, in Hounsfield units.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// Columns and rows.
    pub counts: [usize; 2],
    /// Distance of columns and of rows, mm.
    pub spacing_mm: [f64; 2],
    /// Centre of the first voxel, mm.
    pub position_mm: [f64; 3],
    /// Values, x fastest.
    pub hu: Vec<i16>,
    /// Study, series and frame of reference.
    pub study: Uid,
    /// The series.
    pub series: Uid,
    /// The frame of reference.
    pub frame_of_reference: Uid,
}

impl Slice {
    /// The image in this data set.
    pub fn read(DataSet { object, compressed }: &DataSet) -> Result<Self, TagError> {
        let class = text(object, tags::SOP_CLASS_UID)?;
        if class != uids::CT_IMAGE_STORAGE {
            return wrong(
                tags::SOP_CLASS_UID,
                class,
                "single-frame CT images are read: export them as CT Image Storage",
            );
        }
        if let Some(syntax) = compressed {
            let why = "compressed pixels are not read: convert the images to explicit little endian (for example `gdcmconv --raw`)";
            return wrong(tags::TRANSFER_SYNTAX_UID, syntax, why);
        }
        placed(object)?;
        let position_mm = exactly(object, tags::IMAGE_POSITION_PATIENT)?;
        let [row_mm, column_mm] = exactly(object, tags::PIXEL_SPACING)?;
        if !(row_mm > 0.0 && column_mm > 0.0) {
            return wrong(
                tags::PIXEL_SPACING,
                format!("{row_mm}\\{column_mm}"),
                "distances above 0 mm are due",
            );
        }
        let counts = [whole(object, tags::COLUMNS)?, whole(object, tags::ROWS)?];
        let [Ok(columns), Ok(rows)] = counts.map(usize::try_from) else {
            return wrong(tags::ROWS, format!("{counts:?}"), "a count is due");
        };
        Ok(Self {
            counts: [columns, rows],
            spacing_mm: [column_mm, row_mm],
            position_mm,
            hu: hounsfield(object, columns, rows)?,
            study: uid(object, tags::STUDY_INSTANCE_UID)?,
            series: uid(object, tags::SERIES_INSTANCE_UID)?,
            frame_of_reference: uid(object, tags::FRAME_OF_REFERENCE_UID)?,
        })
    }
}

/// Refuses patients who do not lie head first supine, and images that are not axial.
fn placed(object: &InMemDicomObject) -> Result<(), TagError> {
    let position = text(object, tags::PATIENT_POSITION)?;
    if position != "HFS" {
        let name = match position.as_str() {
            "HFP" => "HFP, head first prone",
            "FFS" => "FFS, feet first supine",
            "FFP" => "FFP, feet first prone",
            "HFDR" => "HFDR, head first on the right side",
            "HFDL" => "HFDL, head first on the left side",
            "FFDR" => "FFDR, feet first on the right side",
            "FFDL" => "FFDL, feet first on the left side",
            other => other,
        };
        return wrong(tags::PATIENT_POSITION, name, "plans are made for HFS, head first supine, alone");
    }
    let orientation: [f64; 6] = exactly(object, tags::IMAGE_ORIENTATION_PATIENT)?;
    let axial = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    if orientation.iter().zip(axial).any(|(found, due)| (found - due).abs() > OBLIQUE) {
        let why = "the image is oblique: rows must run to the left and columns to the back (1\\0\\0\\0\\1\\0); resample the series";
        return wrong(tags::IMAGE_ORIENTATION_PATIENT, format!("{orientation:?}"), why);
    }
    Ok(())
}

fn hounsfield(object: &InMemDicomObject, columns: usize, rows: usize) -> Result<Vec<i16>, TagError> {
    must_be(object, tags::SAMPLES_PER_PIXEL, 1, "a CT has one sample per pixel")?;
    must_be(object, tags::BITS_ALLOCATED, 16, "16 bits per pixel are read")?;
    let photometric = text(object, tags::PHOTOMETRIC_INTERPRETATION)?;
    if photometric != "MONOCHROME2" {
        return wrong(tags::PHOTOMETRIC_INTERPRETATION, photometric, "MONOCHROME2 is due");
    }
    if let Some(frames) = text_if_any(object, tags::NUMBER_OF_FRAMES)?
        && frames != "1"
    {
        return wrong(tags::NUMBER_OF_FRAMES, frames, "one image per file is read");
    }
    let stored = whole(object, tags::BITS_STORED)?;
    let Some(spare) = u32::try_from(stored).ok().filter(|s| (1..=16).contains(s)).map(|s| 16 - s) else {
        return wrong(tags::BITS_STORED, stored, "1 to 16 is due");
    };
    must_be(object, tags::HIGH_BIT, stored - 1, "the bits stored must be the lowest")?;
    let signed = match whole(object, tags::PIXEL_REPRESENTATION)? {
        0 => false,
        1 => true,
        other => return wrong(tags::PIXEL_REPRESENTATION, other, "0 (unsigned) or 1 (signed) is due"),
    };
    let value = |word: u16| match signed {
        true => i32::from((word << spare) as i16 >> spare),
        false => i32::from(word << spare >> spare),
    };
    let [slope] = exactly(object, tags::RESCALE_SLOPE)?;
    let [intercept] = exactly(object, tags::RESCALE_INTERCEPT)?;
    let padding = match object.get(tags::PIXEL_PADDING_VALUE) {
        Some(element) => element.to_int::<i32>().ok().map(|p| value(p as u16)),
        None => None,
    };
    let pixels = object.get(tags::PIXEL_DATA).ok_or(TagError::Missing(tags::PIXEL_DATA))?;
    let bytes = match pixels.to_bytes() {
        Ok(bytes) => bytes,
        Err(_) => return wrong(tags::PIXEL_DATA, "a sequence", "uncompressed pixels are due"),
    };
    let size = columns.checked_mul(rows).and_then(|n| n.checked_mul(2));
    // A value of odd length is padded by one byte.
    if size.is_none_or(|size| size == 0 || bytes.len() < size || bytes.len() > size + 1) {
        let found = format!("{} bytes for {columns} x {rows} pixels", bytes.len());
        return wrong(tags::PIXEL_DATA, found, "two bytes for each pixel are due");
    }
    let mut hu = Vec::with_capacity(columns * rows);
    for word in bytes.chunks_exact(2) {
        let stored = value(u16::from_le_bytes([word[0], word[1]]));
        let exact = libm::round(slope * f64::from(stored) + intercept);
        hu.push(match exact {
            _ if Some(stored) == padding => AIR_HU,
            _ if (f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&exact) => exact as i16,
            _ => {
                return wrong(
                    tags::RESCALE_SLOPE,
                    slope,
                    "it takes a pixel beyond -32768 to 32767 Hounsfield units",
                );
            }
        });
    }
    Ok(hu)
}
