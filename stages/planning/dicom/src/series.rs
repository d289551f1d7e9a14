//! CT images to a volume.

use std::path::PathBuf;

use stillpoint_patient::Grid;
use stillpoint_patient::case::{PatientPosition, Uid};
use thiserror::Error;

use crate::slice::Slice;
use crate::stack::Stack;

/// How far places and distances that should be one may lie apart, mm.
const SAME_MM: f64 = 1e-3;
/// How far the corners of two images may lie apart within their plane, mm: writers of resampled images round them.
const CORNER_MM: f64 = 1e-2;
/// How far the distance of two slices may be from the others, as a part of it.
const GAP: f64 = 0.01;
/// How far an image may be from its place among evenly spaced ones, mm, and as a part of their distance: contours go to the
/// nearest image all the same.
const OFF_MM: f64 = 0.2;
const OFF: f64 = 0.05;
/// A distance above so many of the median is not bridged where images are resampled.
const BRIDGED: f64 = 3.0;

/// Why images make no volume.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum SeriesError {
    /// There are none, or one.
    #[error("{0} CT images make no volume: give a folder with a whole series")]
    Few(usize),
    /// Two images do not belong together.
    #[error("{}: {what} differs from {}: give one series alone", file.display(), first.display())]
    Mixed {
        /// The first of the two files.
        file: PathBuf,
        /// The second of the two files.
        first: PathBuf,
        /// The tag, with its name.
        what: &'static str,
    },
    /// Two images have one place.
    #[error(
        "{}: (0020,0032) ImagePositionPatient is at {z_mm} mm, as that of {}: remove one of them",
        file.display(), other.display()
    )]
    Twice {
        /// The first of the two files.
        file: PathBuf,
        /// The second of the two files.
        other: PathBuf,
        /// Their place along the patient, mm.
        z_mm: f64,
    },
    /// An image is missing.
    #[error(
        "{}: (0020,0032) ImagePositionPatient is {found_mm:.3} mm from the next, {}, where others are {expected_mm:.3} mm apart: \
         an image is missing, or the series is not evenly spaced; export it again, or have it resampled by `--resample`, \
         which bridges up to {BRIDGED} such distances",
        file.display(), next.display()
    )]
    Gap {
        /// The lower.
        file: PathBuf,
        /// The upper.
        next: PathBuf,
        /// Their distance, mm.
        found_mm: f64,
        /// The distance of most images, mm.
        expected_mm: f64,
    },
    /// Images are missing, more than resampling may fill in.
    #[error(
        "{}: (0020,0032) ImagePositionPatient is {found_mm:.3} mm from the next, {}, where others are {expected_mm:.3} mm apart: \
         more than {BRIDGED} such distances are not bridged; give the whole series",
        file.display(), next.display()
    )]
    Hole {
        /// The lower.
        file: PathBuf,
        /// The upper.
        next: PathBuf,
        /// Their distance, mm.
        found_mm: f64,
        /// The distance of most images, mm.
        expected_mm: f64,
    },
    /// Tilted images of which no slice across the patient is covered.
    #[error(
        "the {0} images are tilted so far that no slice across the patient is covered by them: give more images, or a series without a tilt"
    )]
    Steep(usize),
}

/// CT images as one volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Where its voxels are.
    pub grid: Grid,
    /// Hounsfield units, in the order of the grid.
    pub hu: Vec<i16>,
    /// The study of the images.
    pub study: Uid,
    /// Their frame of reference.
    pub frame_of_reference: Uid,
    /// How the patient lies.
    pub position: PatientPosition,
    /// The images as they were taken, where the volume is resampled.
    pub stack: Option<Stack>,
    /// What is worth a look, a sentence each.
    pub notes: Vec<String>,
}

/// The volume of these images of one series, in whatever order they come. Images that are unevenly spaced or of a tilted
/// gantry are refused, or resampled where `resample` asks for it.
pub fn volume(mut slices: Vec<(PathBuf, Slice)>, resample: bool) -> Result<Volume, SeriesError> {
    slices.sort_by(|(a, s), (b, t)| s.plane_mm().total_cmp(&t.plane_mm()).then_with(|| a.cmp(b)));
    let [(first_path, first), _, ..] = slices.as_slice() else { return Err(SeriesError::Few(slices.len())) };
    for (file, slice) in &slices[1..] {
        if let Some(what) = difference(first, slice, resample) {
            return Err(SeriesError::Mixed { file: file.clone(), first: first_path.clone(), what });
        }
    }
    let mut notes = Vec::new();
    let is_sheared = first.tilt != 0.0
        || slices.iter().any(|(_, s)| (s.position_mm[1] - first.position_mm[1]).abs() > CORNER_MM);
    let expected_mm = match evenly(&slices, &mut notes) {
        Ok(expected_mm) if !is_sheared => expected_mm,
        Ok(step_mm) => return resampled(&slices, step_mm, notes),
        Err(SeriesError::Gap { expected_mm, .. }) if resample => {
            bridged(&slices, expected_mm)?;
            return resampled(&slices, expected_mm, notes);
        }
        Err(error) => return Err(error),
    };
    note_values(&slices, &mut notes);
    let grid = Grid {
        counts: [first.counts[0], first.counts[1], slices.len()],
        spacing_mm: [first.spacing_mm[0], first.spacing_mm[1], expected_mm],
        origin_mm: first.position_mm,
    };
    let mut hu = Vec::with_capacity(slices.iter().map(|(_, s)| s.hu.len()).sum());
    slices.iter().for_each(|(_, slice)| hu.extend(&slice.hu));
    let (study, frame_of_reference) = (first.study.clone(), first.frame_of_reference.clone());
    Ok(Volume { grid, hu, study, frame_of_reference, position: first.position, stack: None, notes })
}

/// What is to be said of the values of these images.
fn note_values(slices: &[(PathBuf, Slice)], notes: &mut Vec<String>) {
    notes.extend(slices.first().and_then(|(_, first)| first.unit.clone()));
    let clipped: usize = slices.iter().map(|(_, slice)| slice.clipped).sum();
    if let Some((file, _)) = slices.iter().find(|(_, slice)| slice.clipped > 0) {
        notes.push(format!(
            "{clipped} pixels, the first in {}, are beyond -32768 to 32767 Hounsfield units and are clipped",
            file.display()
        ));
    }
}

/// Refuses distances that are too large to be filled in.
fn bridged(slices: &[(PathBuf, Slice)], expected_mm: f64) -> Result<(), SeriesError> {
    for pair in slices.windows(2) {
        let [(file, lower), (next, upper)] = pair else { continue };
        let found_mm = upper.plane_mm() - lower.plane_mm();
        if found_mm > BRIDGED * expected_mm {
            return Err(SeriesError::Hole { file: file.clone(), next: next.clone(), found_mm, expected_mm });
        }
    }
    Ok(())
}

/// The volume of images that are not evenly spaced or lie in a tilted gantry, as slices across the patient.
fn resampled(
    slices: &[(PathBuf, Slice)],
    step_mm: f64,
    mut notes: Vec<String>,
) -> Result<Volume, SeriesError> {
    let images: Vec<&Slice> = slices.iter().map(|(_, slice)| slice).collect();
    let stack = Stack::of(&images, step_mm);
    let Some(grid) = stack.across(&images) else { return Err(SeriesError::Steep(images.len())) };
    let hu = stack.resample(&images, &grid);
    let [low_mm, high_mm] = [0, grid.counts[2] - 1].map(|k| grid.origin_mm[2] + step_mm * k as f64);
    notes.push(format!(
        "the images are resampled, linearly between neighbours, to slices {step_mm:.3} mm apart from z = {low_mm:.1} to {high_mm:.1} mm{}{}",
        match images[0].tilt {
            0.0 => String::new(),
            tilt => format!("; the gantry was tilted by {:.1} degrees", libm::atan(tilt).to_degrees()),
        },
        match stack.widest_mm() {
            widest if widest > GAP.mul_add(step_mm, step_mm) => format!("; neighbours are up to {widest:.3} mm apart"),
            _ => String::new(),
        }
    ));
    note_values(slices, &mut notes);
    let first = images[0];
    let (study, frame_of_reference) = (first.study.clone(), first.frame_of_reference.clone());
    Ok(Volume { grid, hu, study, frame_of_reference, position: first.position, stack: Some(stack), notes })
}

/// The distance of the images, if it is one.
fn evenly(slices: &[(PathBuf, Slice)], notes: &mut Vec<String>) -> Result<f64, SeriesError> {
    let z_mm = |place: usize| slices[place].1.plane_mm();
    let mut steps: Vec<f64> = (1..slices.len()).map(|i| z_mm(i) - z_mm(i - 1)).collect();
    if let Some(i) = steps.iter().position(|&step| step <= SAME_MM) {
        let (file, other) = (slices[i + 1].0.clone(), slices[i].0.clone());
        return Err(SeriesError::Twice { file, other, z_mm: z_mm(i) });
    }
    let unsorted = steps.clone();
    steps.sort_by(f64::total_cmp);
    let expected_mm = steps[steps.len() / 2];
    // The mean keeps the last image where it is.
    let mean_mm = (z_mm(slices.len() - 1) - z_mm(0)) / (slices.len() - 1) as f64;
    let uneven =
        unsorted.iter().position(|step| (step - expected_mm).abs() > (GAP * expected_mm).max(SAME_MM));
    let Some(i) = uneven else { return Ok(mean_mm) };
    let off_mm = (0..slices.len())
        .map(|place| (z_mm(place) - z_mm(0) - mean_mm * place as f64).abs())
        .fold(0.0, f64::max);
    if off_mm <= OFF_MM.min(OFF * mean_mm) {
        notes.push(format!(
            "the images are {:.3} to {:.3} mm apart and are taken as evenly spaced, {mean_mm:.3} mm: none is off by more than {off_mm:.3} mm",
            steps[0],
            steps[steps.len() - 1]
        ));
        return Ok(mean_mm);
    }
    let (file, next) = (slices[i].0.clone(), slices[i + 1].0.clone());
    Err(SeriesError::Gap { file, next, found_mm: unsorted[i], expected_mm })
}

/// What two images of one volume must share but do not.
fn difference(a: &Slice, b: &Slice, sheared: bool) -> Option<&'static str> {
    let within = |a: &[f64], b: &[f64], most: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most);
    [
        (a.study == b.study, "(0020,000D) StudyInstanceUID"),
        (a.series == b.series, "(0020,000E) SeriesInstanceUID"),
        (a.frame_of_reference == b.frame_of_reference, "(0020,0052) FrameOfReferenceUID"),
        (a.position == b.position, "(0018,5100) PatientPosition"),
        (a.unit == b.unit, "(0028,1054) RescaleType"),
        (a.counts == b.counts, "the count of (0028,0010) Rows or (0028,0011) Columns"),
        (within(&[a.tilt], &[b.tilt], SAME_MM), "(0020,0037) ImageOrientationPatient"),
        (within(&a.spacing_mm, &b.spacing_mm, SAME_MM), "(0028,0030) PixelSpacing"),
        (
            within(&a.position_mm[..1], &b.position_mm[..1], CORNER_MM),
            "the corner in (0020,0032) ImagePositionPatient",
        ),
        (
            sheared || within(&a.position_mm[1..2], &b.position_mm[1..2], CORNER_MM),
            "the corner in (0020,0032) ImagePositionPatient (of images sheared by a tilted gantry, `--resample` makes a volume)",
        ),
    ]
    .into_iter()
    .find_map(|(same, what)| (!same).then_some(what))
}
