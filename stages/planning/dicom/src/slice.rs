//! One CT image.

use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use stillpoint_patient::case::intake::Scale;
use stillpoint_patient::case::{PatientPosition, Uid};

use crate::dataset::DataSet;
use crate::element::{TagError, exactly, must_be, text, text_if_any, uid, whole, wrong};
use crate::pixels::words;

/// How far the rows and columns may be turned from the patient's axes, as a cosine: under 0.01 degrees.
const OBLIQUE: f64 = 1e-4;
/// Images tilted beyond this, as the cosine of their angle, are not those of a gantry: 45 degrees.
const STEEPEST: f64 = 0.707;
/// Padding outside the scanner's circle holds no measurement; it is air.
pub(crate) const AIR_HU: i16 = -1000;
/// The part of an image that metal may saturate.
const CLIPPED: f64 = 0.01;

/// One CT image, in Hounsfield units.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// Columns and rows.
    pub counts: [usize; 2],
    /// Distance of columns along x and of rows along y, mm.
    pub spacing_mm: [f64; 2],
    /// How far the image rises along z for each mm along y: 0, but for a tilted gantry.
    pub tilt: f64,
    /// Centre of the first voxel, mm: the one farthest to the right and to the front of the patient.
    pub position_mm: [f64; 3],
    /// Values, x fastest.
    pub hu: Vec<i16>,
    /// Pixels beyond 16 bits of Hounsfield units, which are clipped: metal.
    pub clipped: usize,
    /// What is to be said of the unit of the values.
    pub unit: Option<String>,
    /// How the patient lies.
    pub position: PatientPosition,
    /// Study, series and frame of reference.
    pub study: Uid,
    /// The series.
    pub series: Uid,
    /// The frame of reference.
    pub frame_of_reference: Uid,
}

/// What the caller knows of images, and accepts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading {
    /// How the patient lies, where the images do not say it.
    pub position: Option<PatientPosition>,
    /// Whether values are taken that are no Hounsfield units of a patient.
    pub scale: Scale,
    /// Whether images of a tilted gantry are taken, which must be resampled.
    pub resample: bool,
}

impl Slice {
    /// The image in this data set, which says all of itself.
    pub fn read(data: &DataSet) -> Result<Self, TagError> {
        Self::read_as(data, Reading::default())
    }

    /// The image in this data set.
    pub fn read_as(DataSet { object, compressed }: &DataSet, reading: Reading) -> Result<Self, TagError> {
        let class = text(object, tags::SOP_CLASS_UID)?;
        if class != uids::CT_IMAGE_STORAGE {
            return wrong(
                tags::SOP_CLASS_UID,
                class,
                "single-frame CT images are read: export them as CT Image Storage",
            );
        }
        let position = position(object, reading.position)?;
        let unit = unit(object, reading.scale)?;
        let Axes { against: [against_x, against_y], column } = axes(object, reading.resample)?;
        let mut position_mm: [f64; 3] = exactly(object, tags::IMAGE_POSITION_PATIENT)?;
        let [row_mm, column_mm] = exactly(object, tags::PIXEL_SPACING)?;
        if !(row_mm > 0.0 && column_mm > 0.0) {
            return wrong(
                tags::PIXEL_SPACING,
                format!("{row_mm}\\{column_mm}"),
                "distances above 0 mm are expected",
            );
        }
        let counts = [whole(object, tags::COLUMNS)?, whole(object, tags::ROWS)?];
        let [Ok(columns), Ok(rows)] = counts.map(usize::try_from) else {
            return wrong(tags::ROWS, format!("{counts:?}"), "a count is expected");
        };
        let (mut hu, clipped) = hounsfield(object, compressed.as_deref(), columns, rows)?;
        if against_x {
            hu.chunks_exact_mut(columns).for_each(<[i16]>::reverse);
            position_mm[0] -= (columns - 1) as f64 * column_mm;
        }
        if against_y {
            hu = hu.chunks_exact(columns).rev().flatten().copied().collect();
            for (axis, along) in [1, 2].into_iter().zip(column) {
                position_mm[axis] -= (rows - 1) as f64 * row_mm * along;
            }
        }
        Ok(Self {
            counts: [columns, rows],
            spacing_mm: [column_mm, row_mm * column[0]],
            tilt: column[1] / column[0],
            position_mm,
            hu,
            clipped,
            unit,
            position,
            study: uid(object, tags::STUDY_INSTANCE_UID)?,
            series: uid(object, tags::SERIES_INSTANCE_UID)?,
            frame_of_reference: uid(object, tags::FRAME_OF_REFERENCE_UID)?,
        })
    }
}

impl Slice {
    /// Where the image crosses `y = 0` along the patient, mm: its z, but for a tilted gantry.
    pub fn plane_mm(&self) -> f64 {
        self.position_mm[2] - self.tilt * self.position_mm[1]
    }
}

/// How the patient lies, where it is a position that can be planned.
fn position(object: &InMemDicomObject, stated: Option<PatientPosition>) -> Result<PatientPosition, TagError> {
    let Some(term) = text_if_any(object, tags::PATIENT_POSITION)? else {
        let why = "state it by `--position HFS` (or HFP, FFS, FFP)";
        return stated.ok_or(TagError::Unstated { tag: tags::PATIENT_POSITION, why });
    };
    let term = term.to_ascii_uppercase();
    if stated.is_some_and(|stated| stated.term() != term) {
        return wrong(tags::PATIENT_POSITION, term, "`--position` states another: leave it out");
    }
    PatientPosition::of_term(&term).map_or_else(
        || {
            let name = match term.as_str() {
                "HFDR" => "HFDR, head first on the right side",
                "HFDL" => "HFDL, head first on the left side",
                "FFDR" => "FFDR, feet first on the right side",
                "FFDL" => "FFDL, feet first on the left side",
                other => other,
            };
            wrong(
                tags::PATIENT_POSITION,
                name,
                "HFS, HFP, FFS or FFP is expected: supine or prone, head or feet first",
            )
        },
        Ok,
    )
}

/// What is to be said of the unit of the values; refuses values that are no Hounsfield units.
fn unit(object: &InMemDicomObject, scale: Scale) -> Result<Option<String>, TagError> {
    let kernel = text_if_any(object, tags::CONVOLUTION_KERNEL)?.unwrap_or_default();
    let is_density = |kernel: &str| {
        kernel.strip_prefix("Sd").is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
    };
    if is_density(&kernel) {
        let message = format!(
            "the kernel {kernel} makes values that are proportional to density: the density table of the machine must be that of this kernel"
        );
        return Ok(Some(message));
    }
    let Some(unit) = text_if_any(object, tags::RESCALE_TYPE)? else { return Ok(None) };
    let also = "another density table is required (`plan --machine FILE`)";
    match unit.to_ascii_uppercase().as_str() {
        // Unspecified: many writers mean Hounsfield units, and whether the values can be is checked later.
        "HU" | "US" => Ok(None),
        "HU_MOD" => Ok(Some(format!("the values are modified Hounsfield units (HU_MOD): {also}"))),
        _ if scale == Scale::Any => Ok(Some(format!("the values are not Hounsfield units ({unit}): {also}"))),
        _ => wrong(
            tags::RESCALE_TYPE,
            unit,
            "HU is required: export the images in Hounsfield units, or take the values as they are by `--any-hounsfield`",
        ),
    }
}

/// How the rows and columns of an image run.
struct Axes {
    /// Whether they run against x and y.
    against: [bool; 2],
    /// The unit vector down the columns in y and z, where they run along y.
    column: [f64; 2],
}

/// How rows and columns run. Refuses images that are not across the patient, but for those of a tilted gantry if they are
/// taken.
fn axes(object: &InMemDicomObject, tilted: bool) -> Result<Axes, TagError> {
    let found: [f64; 6] = exactly(object, tags::IMAGE_ORIENTATION_PATIENT)?;
    let is = |expected: [f64; 6]| {
        found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= OBLIQUE)
    };
    for (row, column) in [(1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0)] {
        if is([row, 0.0, 0.0, 0.0, column, 0.0]) {
            return Ok(Axes { against: [row < 0.0, column < 0.0], column: [1.0, 0.0] });
        }
    }
    let [a, b] = [[found[0], found[1], found[2]], [found[3], found[4], found[5]]];
    let is_unit = (b[1].hypot(b[2]) - 1.0).abs() <= OBLIQUE;
    let is_tilted =
        (a[0].abs() - 1.0).abs() <= OBLIQUE && b[0].abs() <= OBLIQUE && is_unit && b[1].abs() > STEEPEST;
    if is_tilted && tilted {
        let sign = b[1].signum();
        return Ok(Axes { against: [a[0] < 0.0, sign < 0.0], column: [sign * b[1], sign * b[2]] });
    }
    let normal = [0, 1, 2].map(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    });
    let along = |axis: usize| normal[axis].abs() > 1.0 - OBLIQUE;
    let why = match [along(0), along(1), along(2)] {
        _ if is_tilted => {
            "the images are oblique, of a tilted gantry: have them resampled across the patient by `--resample`"
        }
        [true, ..] => "the image is sagittal: axial images are read; give the axial series",
        [_, true, _] => "the image is coronal: axial images are read; give the axial series",
        [.., true] => {
            "the image is turned within its plane: rows and columns must run along x and y; resample the series"
        }
        _ => {
            "the image is oblique: rows must run along x and columns along y (1\\0\\0\\0\\1\\0); resample the series"
        }
    };
    wrong(tags::IMAGE_ORIENTATION_PATIENT, format!("{found:?}"), why)
}

fn hounsfield(
    object: &InMemDicomObject,
    compressed: Option<&str>,
    columns: usize,
    rows: usize,
) -> Result<(Vec<i16>, usize), TagError> {
    must_be(object, tags::SAMPLES_PER_PIXEL, 1, "a CT has one sample per pixel")?;
    must_be(object, tags::BITS_ALLOCATED, 16, "16 bits per pixel are read")?;
    let photometric = text(object, tags::PHOTOMETRIC_INTERPRETATION)?;
    if photometric != "MONOCHROME2" {
        return wrong(tags::PHOTOMETRIC_INTERPRETATION, photometric, "MONOCHROME2 is expected");
    }
    if let Some(frames) = text_if_any(object, tags::NUMBER_OF_FRAMES)?
        && frames != "1"
    {
        return wrong(tags::NUMBER_OF_FRAMES, frames, "one image per file is read");
    }
    let stored = whole(object, tags::BITS_STORED)?;
    let Some(spare) = u32::try_from(stored).ok().filter(|s| (1..=16).contains(s)).map(|s| 16 - s) else {
        return wrong(tags::BITS_STORED, stored, "1 to 16 is expected");
    };
    must_be(object, tags::HIGH_BIT, stored - 1, "the bits stored must be the lowest")?;
    let signed = match whole(object, tags::PIXEL_REPRESENTATION)? {
        0 => false,
        1 => true,
        other => return wrong(tags::PIXEL_REPRESENTATION, other, "0 (unsigned) or 1 (signed) is expected"),
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
    let words = words(object, compressed, columns, rows)?;
    let mut hu = Vec::with_capacity(words.len());
    let mut clipped = 0;
    for word in words {
        let stored = value(word);
        let exact = libm::round(slope * f64::from(stored) + intercept);
        hu.push(match exact {
            _ if Some(stored) == padding => AIR_HU,
            _ if (f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&exact) => exact as i16,
            _ => {
                clipped += 1;
                exact.clamp(f64::from(i16::MIN), f64::from(i16::MAX)) as i16
            }
        });
    }
    if clipped as f64 > CLIPPED * hu.len() as f64 {
        return wrong(
            tags::RESCALE_SLOPE,
            slope,
            "it takes more than a hundredth of the pixels beyond -32768 to 32767 Hounsfield units",
        );
    }
    Ok((hu, clipped))
}
