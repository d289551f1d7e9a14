//! RTDOSE: the dose of a plan on a grid.

use dicom_core::{PrimitiveValue, VR};
use dicom_dictionary_std::{tags, uids};
use stillpoint_patient::Grid;
use stillpoint_patient::case::Uid;

use crate::write::{Export, ExportError, Exported, MOST_FRAMES, Writer, decimal};

/// A value has 32 bits.
const BITS: u16 = 32;
/// The largest stored value: a little below the largest that fits, since the scaling is rounded to ten digits.
const FULL: f64 = 4_294_967_000.0;
/// DICOM counts the bytes of pixels in 32 bits; viewers stop earlier.
const MOST_BYTES: usize = 1 << 30;

/// The dose of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedDose<'a> {
    /// Where its voxels are, in the DICOM patient frame.
    pub grid: &'a Grid,
    /// Dose over all fractions, gray, in the order of the grid.
    pub gray: &'a [f32],
    /// The RTPLAN that it belongs to.
    pub plan: &'a Uid,
}

/// The RTDOSE file of this dose. A stored value is the dose to half of the largest dose over 4294967000.
pub fn dose_file(export: &Export<'_>, dose: &PlannedDose<'_>) -> Result<Exported, ExportError> {
    let Grid { counts, spacing_mm, origin_mm } = *dose.grid;
    let voxels = counts.iter().try_fold(4_usize, |bytes, &n| bytes.checked_mul(n));
    let [Ok(columns), Ok(rows), _] = counts.map(u16::try_from) else {
        return Err(ExportError::Size(counts));
    };
    if counts[2] > MOST_FRAMES || voxels.is_none_or(|bytes| bytes == 0 || bytes > MOST_BYTES) {
        return Err(ExportError::Size(counts));
    }
    if dose.gray.len() != dose.grid.len() {
        return Err(ExportError::Length { expected: dose.grid.len(), found: dose.gray.len() });
    }
    if let Some(&value) = dose.gray.iter().find(|d| !(d.is_finite() && **d >= 0.0)) {
        let why = "doses are finite and not negative";
        return Err(ExportError::Number { what: "a dose", value: value.into(), why });
    }
    let (scaling, stored) = store(dose.gray);
    let mut file = Writer::default();
    file.belongs(export, uids::RT_DOSE_STORAGE, "RTDOSE");
    file.empty(tags::INSTANCE_NUMBER, VR::IS).empty(tags::SLICE_THICKNESS, VR::DS);
    file.decimals(tags::IMAGE_POSITION_PATIENT, &origin_mm);
    file.decimals(tags::IMAGE_ORIENTATION_PATIENT, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    file.decimals(tags::PIXEL_SPACING, &[spacing_mm[1], spacing_mm[0]]);
    file.put(tags::SAMPLES_PER_PIXEL, VR::US, 1_u16);
    file.put(tags::PHOTOMETRIC_INTERPRETATION, VR::CS, "MONOCHROME2");
    file.whole(tags::NUMBER_OF_FRAMES, counts[2]);
    file.put(
        tags::FRAME_INCREMENT_POINTER,
        VR::AT,
        PrimitiveValue::Tags([tags::GRID_FRAME_OFFSET_VECTOR][..].into()),
    );
    file.put(tags::ROWS, VR::US, rows).put(tags::COLUMNS, VR::US, columns);
    file.put(tags::BITS_ALLOCATED, VR::US, BITS).put(tags::BITS_STORED, VR::US, BITS);
    file.put(tags::HIGH_BIT, VR::US, BITS - 1).put(tags::PIXEL_REPRESENTATION, VR::US, 0_u16);
    file.put(tags::DOSE_UNITS, VR::CS, "GY").put(tags::DOSE_TYPE, VR::CS, "PHYSICAL");
    file.put(tags::DOSE_SUMMATION_TYPE, VR::CS, "PLAN");
    file.put(tags::DOSE_COMMENT, VR::LO, "Research only; computed by stillpoint");
    let offsets: Vec<f64> = (0..counts[2]).map(|z| z as f64 * spacing_mm[2]).collect();
    file.decimals(tags::GRID_FRAME_OFFSET_VECTOR, &offsets);
    file.put(tags::DOSE_GRID_SCALING, VR::DS, decimal(scaling));
    file.reference(tags::REFERENCED_RT_PLAN_SEQUENCE, uids::RT_PLAN_STORAGE, dose.plan);
    let bytes: Vec<u8> = stored.iter().flat_map(|v| v.to_le_bytes()).collect();
    file.put(tags::PIXEL_DATA, VR::OW, PrimitiveValue::from(bytes));
    file.finish(uids::RT_DOSE_STORAGE)
}

/// Gray per stored unit, as ten digits give it, and the stored values.
fn store(gray: &[f32]) -> (f64, Vec<u32>) {
    let largest = gray.iter().copied().fold(0.0, f32::max);
    let exact = if largest > 0.0 { f64::from(largest) / FULL } else { 1.0 };
    // A reader multiplies by what the text says, so that is what is divided by.
    let scaling = format!("{exact:.9e}").parse().unwrap_or(exact);
    (scaling, gray.iter().map(|d| libm::round(f64::from(*d) / scaling) as u32).collect())
}
