//! Penumbra and fluence of the open field, from profiles.
//!
//! The penumbra is the width of the Gaussian whose profiles fall from 80 to 20 % of the dose on the axis over the measured
//! distance, in the mean of all profiles. It depends neither on the set width of the field nor on where the profile was
//! centred. The fluence is corrected by the measured over the computed dose inside the field, and computed once more.

use super::curve::{Curve, Kind};
use super::error::MeasuredFault;
use super::tank::{Beam, Tank, place, places};

/// Distance between the radii of the correction, mm on the isocentre plane.
pub(super) const RADIUS_STEP_MM: f64 = 20.0;
/// Distance to the edge of a field within which the dose does not tell the fluence, mm on the isocentre plane.
const EDGE_MM: f64 = 15.0;
/// Smallest reach of profiles that tell the fluence, mm on the isocentre plane.
const LEAST_REACH_MM: f64 = 30.0;
/// Widths that the penumbra may have, mm.
const PENUMBRA_MM: [f64; 2] = [0.5, 25.0];
/// Halvings of that interval.
const HALVINGS: usize = 9;
/// Distance to an edge within which a profile falls from 80 to 20 %, mm at its depth.
const FALL_MM: f64 = 20.0;

/// Correction of the fluence by radius.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Correction(pub Vec<f64>);

impl Correction {
    /// Linear between the radii; the last one holds beyond.
    pub fn at(&self, radius_mm: f64) -> f64 {
        let place = radius_mm / RADIUS_STEP_MM;
        let low = place as usize;
        match (self.0.get(low), self.0.get(low + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (place - low as f64),
            _ => self.0.last().copied().unwrap_or(1.0),
        }
    }
}

/// A profile with the distance of its middle from the axis.
pub(super) struct Centred<'a> {
    pub curve: &'a Curve,
    pub shift_mm: f64,
}

/// Mean distance between 80 and 20 % of the dose on the axis over both sides, mm at the depth of the profile.
fn fall_mm(curve: &Curve) -> Result<f64, MeasuredFault> {
    let [[l8, r8], [l2, r2]] = [curve.crossings(0.8)?, curve.crossings(0.2)?];
    Ok(0.5 * ((l8 - l2) + (r2 - r8)))
}

/// The width of the penumbra that gives the measured fall.
pub(super) fn penumbra_mm(
    tank: &Tank<'_>,
    beam: &Beam<'_>,
    profiles: &[Centred<'_>],
    photons: &[f64],
) -> Result<f64, MeasuredFault> {
    let edges: Vec<Curve> = profiles.iter().map(|profile| near_edges(tank, profile.curve)).collect();
    let profiles: Vec<Centred<'_>> = edges
        .iter()
        .zip(profiles)
        .map(|(curve, profile)| Centred { curve, shift_mm: profile.shift_mm })
        .collect();
    let measured = profiles.iter().map(|profile| fall_mm(profile.curve)).sum::<Result<f64, _>>()?;
    let computed = |penumbra_mm: f64| -> f64 {
        let beam = Beam { penumbra_mm, fluence: beam.fluence };
        profiles.iter().map(|profile| computed_fall_mm(tank, &beam, profile, photons)).sum()
    };
    let [mut low, mut high] = PENUMBRA_MM;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if computed(middle) < measured { low = middle } else { high = middle }
    }
    Ok(0.5 * (low + high))
}

/// A profile at its edges and at the axis alone: fewer places to compute.
fn near_edges(tank: &Tank<'_>, curve: &Curve) -> Curve {
    let edge = 0.5 * side_mm(curve) * distance_mm(curve) / tank.sad_mm();
    let middle = curve.points.partition_point(|point| point.at_mm < 0.0);
    let is_near = |place: usize, at_mm: f64| {
        (at_mm.abs() - edge).abs() < FALL_MM || (middle.saturating_sub(1)..=middle).contains(&place)
    };
    let points = curve.points.iter().enumerate().filter(|(place, point)| is_near(*place, point.at_mm));
    Curve { points: points.map(|(_, point)| *point).collect(), ..curve.clone() }
}

/// The same of computed doses at the same places, so that wide steps of a scan count on both sides.
fn computed_fall_mm(tank: &Tank<'_>, beam: &Beam<'_>, profile: &Centred<'_>, photons: &[f64]) -> f64 {
    let Centred { curve, shift_mm } = profile;
    let doses = tank.doses_at(curve.setup, beam, &places(curve, *shift_mm), photons);
    let mut computed = (*curve).clone();
    for (point, dose) in computed.points.iter_mut().zip(doses) {
        point.value = dose;
    }
    // A side that does not fall within the scan has a wider penumbra than any.
    fall_mm(&computed).unwrap_or(PENUMBRA_MM[1])
}

/// From the source to the depth of a profile, mm.
fn distance_mm(curve: &Curve) -> f64 {
    let depth_mm = if let Kind::Profile { depth_mm, .. } = curve.kind { depth_mm } else { 0.0 };
    curve.setup.ssd_mm + depth_mm
}

fn side_mm(curve: &Curve) -> f64 {
    let [x, y] = curve.setup.field_mm;
    if matches!(curve.kind, Kind::Profile { across: super::curve::Across::Y, .. }) { y } else { x }
}

/// How far from the axis a profile tells the fluence, mm on the isocentre plane.
fn reach_mm(curve: &Curve) -> f64 {
    0.5 * side_mm(curve) - EDGE_MM
}

/// The correction that brings computed profiles nearer to the measured ones; `None` where profiles are too narrow.
pub(super) fn corrected(
    tank: &Tank<'_>,
    beam: &Beam<'_>,
    profiles: &[Centred<'_>],
    photons: &[f64],
    before: &Correction,
) -> Option<Correction> {
    let reach = profiles.iter().map(|profile| reach_mm(profile.curve)).fold(0.0, f64::max);
    if reach < LEAST_REACH_MM {
        return None;
    }
    let radii = (reach / RADIUS_STEP_MM) as usize + 1;
    let mut sums = vec![[0.0; 2]; radii + 1];
    for Centred { curve, shift_mm } in profiles {
        let scale = tank.sad_mm() / distance_mm(curve);
        let computed = tank.doses_at(curve.setup, beam, &places(curve, *shift_mm), photons);
        let axis = tank.doses_at(curve.setup, beam, &[place(curve.kind, 0.0)], photons)[0];
        let measured_axis = curve.value_at(*shift_mm).unwrap_or_else(|| curve.on_axis());
        for (point, dose) in curve.points.iter().zip(computed) {
            let radius = (point.at_mm - shift_mm).abs() * scale;
            if radius > reach_mm(curve) {
                continue;
            }
            let ratio = point.value / measured_axis / (dose / axis);
            let at = radius / RADIUS_STEP_MM;
            let low = (at as usize).min(radii - 1);
            let part = at - low as f64;
            for (node, weight) in [(low, 1.0 - part), (low + 1, part)] {
                sums[node][0] += weight * ratio;
                sums[node][1] += weight;
            }
        }
    }
    // A radius that no point is near to goes on with the one before it.
    let mut ratio = 1.0;
    let mut ratios = Vec::with_capacity(sums.len());
    for [sum, weight] in &sums {
        if *weight > 0.25 {
            ratio = sum / weight;
        }
        ratios.push(ratio);
    }
    let first = ratios[0];
    let of = |(node, ratio): (usize, f64)| before.at(node as f64 * RADIUS_STEP_MM) * ratio / first;
    Some(Correction(ratios.into_iter().enumerate().map(of).collect()))
}
