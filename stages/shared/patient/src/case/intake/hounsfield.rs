//! Whether the scale of Hounsfield units is a patient's: where soft tissue and air are.

use super::super::mask::Mask;
use super::{IntakeError, Scale};
use crate::Grid;

/// Soft tissue lies within this of water, HU.
const TISSUE_HU: i32 = 200;
/// What is not above air by this is lung or gas, HU.
const ABOVE_AIR_HU: i32 = 500;
/// Values up to this are air: scanners pad the corners with less than -1024.
const AIR_HU: i32 = -800;
/// The part of what is outside of the outline that is air at least.
const AIR: f64 = 0.1;
/// Values below this are reported: nothing is lighter than air.
const LEAST_HU: i32 = -1024;
/// The part of the images that must lie outside of the outline before its air is judged.
const OUTSIDE: f64 = 0.05;
/// The part of the images that a body fills at least, where no outline says it.
const BODY: f64 = 0.05;
/// Soft tissue is no less than this part of any other matter of a patient: a thorax has three times as much lung at most.
const MINOR: f64 = 1.0 / 3.0;
/// Where density tables end as scanners are calibrated, HU: beyond it is metal, or a fault.
const TABLE_HU: i32 = 3000;
/// Window in which most soft tissue lies, HU.
const WINDOW: usize = 200;
const LEVELS: usize = 1 << 16;

pub(super) fn check(
    grid: &Grid,
    hu: &[i16],
    outline: Option<&Mask>,
    scale: Scale,
    notes: &mut Vec<String>,
) -> Result<(), IntakeError> {
    let (mut inside, mut outside) = (vec![0_usize; LEVELS], vec![0_usize; LEVELS]);
    for (voxel, &value) in hu.iter().enumerate() {
        let place = (i32::from(value) - i32::from(i16::MIN)) as usize;
        match outline.is_none_or(|mask| mask.contains(voxel)) {
            true => inside[place] += 1,
            false => outside[place] += 1,
        }
    }
    let around: usize = outside.iter().sum();
    let judged = around as f64 >= OUTSIDE * hu.len() as f64;
    let air_hu = judged.then(|| densest(&outside, i32::from(i16::MIN))).flatten().map(|(air, _)| air);
    let lowest =
        inside.iter().chain(&outside).enumerate().filter(|(_, n)| **n > 0).map(|(i, _)| value(i % LEVELS));
    let air = air_hu.or(lowest.min());
    let is_body = |from: i32| outline.is_some() || above(&inside, from) >= BODY * hu.len() as f64;
    let body = |air: i32| {
        let from = air + ABOVE_AIR_HU;
        is_body(from).then(|| densest(&inside, from)).flatten()
    };
    // Less than air is padding, or a scale that is off: then the patient's mass lies below what is called tissue.
    let tissue = air.and_then(|air| body(air.max(LEAST_HU)));
    let all = air.filter(|air| *air < LEAST_HU).and_then(body);
    let body_hu = match (tissue, all) {
        (Some((_, few)), Some((hu, many))) if (few as f64) < MINOR * many as f64 => Some(hu),
        (Some((hu, _)), _) | (None, Some((hu, _))) => Some(hu),
        (None, None) => densest(&inside, i32::from(i16::MIN)).map(|(hu, _)| hu),
    };
    if let Some(body_hu) = body_hu
        && body_hu.abs() > TISSUE_HU
    {
        let fault = IntakeError::Scale { body_hu, air_hu };
        match scale {
            Scale::OfPatients => return Err(fault),
            Scale::Any => notes.push(fault.to_string()),
        }
    }
    let count = |levels: &[usize], holds: &dyn Fn(i32) -> bool| -> usize {
        levels.iter().enumerate().filter(|(place, _)| holds(value(*place))).map(|(_, n)| n).sum()
    };
    if let Some(air_hu) = air_hu
        && (count(&outside, &|hu| hu <= AIR_HU) as f64) < AIR * around as f64
    {
        notes.push(format!(
            "what is outside of the outline has about {air_hu} HU (air has -1000): the scale of the images may be wrong, or the outline small"
        ));
    }
    let dense = count(&inside, &|hu| hu > TABLE_HU);
    if dense > 0 {
        let greatest = inside.iter().rposition(|&n| n > 0).map_or(0, value);
        notes.push(format!(
            "{:.2} cm3 of the patient have more than {TABLE_HU} HU, up to {greatest} HU: the density table that is shipped ends there; a machine file with a longer `hu_to_density` (`plan --machine FILE`) extends it",
            dense as f64 * grid.voxel_cm3()
        ));
    }
    let light = count(&inside, &|hu| hu < LEAST_HU);
    if light > 0 && outline.is_some() {
        notes.push(format!(
            "{:.2} cm3 of the patient have less than {LEAST_HU} HU and count as air",
            light as f64 * grid.voxel_cm3()
        ));
    }
    Ok(())
}

/// Voxels with at least this.
fn above(levels: &[usize], from_hu: i32) -> f64 {
    levels.iter().enumerate().filter(|(place, _)| value(*place) >= from_hu).map(|(_, n)| *n as f64).sum()
}

fn value(place: usize) -> i32 {
    place as i32 + i32::from(i16::MIN)
}

/// The mean of the window above `from_hu` that holds the most voxels, and how many; of equal ones the nearest to water.
fn densest(levels: &[usize], from_hu: i32) -> Option<(i32, usize)> {
    let from = (from_hu - i32::from(i16::MIN)).clamp(0, LEVELS as i32) as usize;
    let mut held: usize = 0;
    let mut best: Option<(usize, usize)> = None;
    let off_water = |end: usize| (value(end) - WINDOW as i32 / 2).abs();
    for end in from..LEVELS {
        held += levels[end];
        if end >= from + WINDOW {
            held -= levels[end - WINDOW];
        }
        let is_better =
            best.is_none_or(|(most, at)| held > most || held == most && off_water(end) < off_water(at));
        if held > 0 && is_better {
            best = Some((held, end));
        }
    }
    let (held, end) = best?;
    let window = (end + 1).saturating_sub(WINDOW).max(from)..=end;
    let sum: i64 = window.map(|place| levels[place] as i64 * i64::from(value(place))).sum();
    Some(((sum / held as i64) as i32, held))
}
