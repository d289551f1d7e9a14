//! RTDOSE, read: the dose of a plan that another program computed.

use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_patient::Grid;

use crate::dataset::DataSet;
use crate::element::{TagError, exactly, must_be, padded_numbers, text, text_if_any, whole, wrong};

/// How unevenly frames may lie, mm.
const EVEN_MM: f64 = 0.01;
/// Voxels of a dose at most.
const MOST_VOXELS: usize = 1 << 28;

/// A dose on a grid in the DICOM patient frame.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenDose {
    /// Where its voxels are.
    pub grid: Grid,
    /// Dose, gray, in the order of the grid.
    pub gray: Vec<f32>,
    /// What it is the dose of: `PLAN`, `FRACTION`, `BEAM` and the like.
    pub sum: String,
}

impl GivenDose {
    /// The dose in this data set.
    ///
    /// # Errors
    /// A tag that is missing or that says what is not read.
    pub fn read(data: &DataSet) -> Result<Self, TagError> {
        let object = &data.object;
        if let Some(syntax) = &data.compressed {
            return wrong(tags::PIXEL_DATA, syntax, "an uncompressed dose is read: convert the file");
        }
        let modality = text(object, tags::MODALITY)?;
        if modality != "RTDOSE" {
            return wrong(tags::MODALITY, modality, "an RTDOSE is expected");
        }
        let unit = text(object, tags::DOSE_UNITS)?;
        if unit != "GY" {
            return wrong(tags::DOSE_UNITS, unit, "a dose in gray is expected: export it as absolute dose");
        }
        let orientation: [f64; 6] = exactly(object, tags::IMAGE_ORIENTATION_PATIENT)?;
        let is_along = orientation.iter().zip([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        if is_along.into_iter().any(|(found, expected)| (found - expected).abs() > 1e-4) {
            let why = "rows along x and columns along y are read (1\\0\\0\\0\\1\\0)";
            return wrong(tags::IMAGE_ORIENTATION_PATIENT, format!("{orientation:?}"), why);
        }
        let count = |tag| match usize::try_from(whole(object, tag)?) {
            Ok(count @ 1..=4096) => Ok(count),
            _ => wrong(tag, whole(object, tag)?, "1 to 4096 is expected"),
        };
        let counts = [count(tags::COLUMNS)?, count(tags::ROWS)?, count(tags::NUMBER_OF_FRAMES)?];
        let [down, across] = exactly(object, tags::PIXEL_SPACING)?;
        let offsets = padded_numbers(object, tags::GRID_FRAME_OFFSET_VECTOR)?;
        let [x, y, z]: [f64; 3] = exactly(object, tags::IMAGE_POSITION_PATIENT)?;
        let voxels = counts.iter().product::<usize>();
        if offsets.len() != counts[2] || voxels > MOST_VOXELS {
            let why = "an offset for each frame is expected";
            return wrong(tags::GRID_FRAME_OFFSET_VECTOR, format!("{} offsets", offsets.len()), why);
        }
        let (step, first) = frames(&offsets, z)?;
        let grid = Grid {
            counts,
            spacing_mm: [across, down, step.abs()],
            origin_mm: [x, y, if step < 0.0 { first + step * (counts[2] - 1) as f64 } else { first }],
        };
        if !grid.spacing_mm.iter().all(|mm| (0.01..=100.0).contains(mm)) {
            return wrong(
                tags::PIXEL_SPACING,
                format!("{:?}", grid.spacing_mm),
                "0.01 to 100 mm is expected",
            );
        }
        must_be(object, tags::SAMPLES_PER_PIXEL, 1, "a dose has one sample per voxel")?;
        must_be(object, tags::PIXEL_REPRESENTATION, 0, "doses are not negative")?;
        let [scaling] = exactly(object, tags::DOSE_GRID_SCALING)?;
        if scaling.is_nan() || scaling <= 0.0 {
            return wrong(tags::DOSE_GRID_SCALING, scaling, "a scaling above 0 is expected");
        }
        let mut gray = stored(object, voxels)?;
        gray.iter_mut().for_each(|value| *value *= scaling);
        let slice = counts[0] * counts[1];
        let gray: Vec<f32> = if step < 0.0 {
            gray.chunks(slice).rev().flatten().map(|value| *value as f32).collect()
        } else {
            gray.into_iter().map(|value| value as f32).collect()
        };
        let sum = text_if_any(object, tags::DOSE_SUMMATION_TYPE)?.unwrap_or_default();
        Ok(Self { grid, gray, sum })
    }
}

/// Step and first place of frames along z, mm. Offsets count from the position of the first frame, or are places themselves
/// (PS3.3 C.8.8.3.2).
fn frames(offsets: &[f64], z: f64) -> Result<(f64, f64), TagError> {
    let first = if offsets[0] == 0.0 { z } else { offsets[0] };
    let step = match offsets {
        [a, b, ..] => b - a,
        _ => 1.0,
    };
    let is_even = |pair: &[f64]| (pair[1] - pair[0] - step).abs() <= EVEN_MM;
    match step.abs() >= 0.01 && offsets.windows(2).all(is_even) {
        true => Ok((step, first)),
        false => {
            let why = "evenly spaced frames are expected";
            wrong(tags::GRID_FRAME_OFFSET_VECTOR, format!("{offsets:?}"), why)
        }
    }
}

/// The stored values.
fn stored(object: &InMemDicomObject, voxels: usize) -> Result<Vec<f64>, TagError> {
    let bits = whole(object, tags::BITS_ALLOCATED)?;
    let missing = || TagError::Missing(tags::PIXEL_DATA);
    let bytes = object.get(tags::PIXEL_DATA).ok_or_else(missing)?.to_bytes().map_err(|_| missing())?;
    let wide = match bits {
        16 => 2,
        32 => 4,
        _ => return wrong(tags::BITS_ALLOCATED, bits, "16 or 32 bits are read"),
    };
    if bytes.len() < wide * voxels {
        let why = "fewer bytes than the voxels need: the file is cut";
        return wrong(tags::PIXEL_DATA, format!("{} bytes", bytes.len()), why);
    }
    let value = |chunk: &[u8]| match *chunk {
        [a, b] => f64::from(u16::from_le_bytes([a, b])),
        [a, b, c, d] => f64::from(u32::from_le_bytes([a, b, c, d])),
        _ => 0.0,
    };
    Ok(bytes.chunks_exact(wide).take(voxels).map(value).collect())
}
