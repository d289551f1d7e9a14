//! How far a machine is from the curves.

use serde::Serialize;

use super::curve::{Curve, Kind};
use super::fit::Bounds;

/// Change of the dose over 1 mm, as a part of the greatest dose, from which a distance is the better measure.
const STEEP_PER_MM: f64 = 0.02;
/// Part of the dose on the axis from which a place of a profile is inside of the field.
const INSIDE: f64 = 0.8;

/// A place of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ResidualPoint {
    /// Depth, or distance from the middle of the profile, mm.
    pub at_mm: f64,
    /// Measured dose, as a part of the greatest one of the curve.
    pub measured: f64,
    /// Computed dose, in the same unit.
    pub computed: f64,
    /// Distance at which the computed curve has the measured dose, mm; only where it is steep.
    pub distance_mm: Option<f64>,
    /// Whether the place is judged.
    pub is_judged: bool,
}

/// A curve by the machine that was fitted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// Name of the curve.
    pub name: String,
    /// File of the curve.
    pub file: String,
    /// Line where it begins.
    pub line: usize,
    /// Whether it is a profile.
    pub is_profile: bool,
    /// Distance of the middle of a profile from the axis, which is taken off, mm.
    pub shift_mm: f64,
    /// Depth from which a depth dose is fitted and judged, mm.
    pub from_mm: f64,
    /// Root of the mean square of the judged differences outside of steep places, as a part of the greatest dose.
    pub rms: f64,
    /// The greatest of them, computed less measured, with its place in mm.
    pub largest: (f64, f64),
    /// The greatest difference of a depth dose outside of steep places as a part of the dose there, with its place in mm.
    pub largest_local: Option<(f64, f64)>,
    /// The greatest distance in steep places, with its place, mm.
    pub largest_mm: Option<(f64, f64)>,
    /// The greatest difference that is not judged: in the build-up.
    pub build_up: Option<(f64, f64)>,
    /// The place that is farthest beyond the bounds, mm.
    pub beyond_mm: Option<f64>,
    /// All places.
    pub points: Vec<ResidualPoint>,
}

impl Residual {
    /// Of a curve with these computed doses (in any unit). A difference is within the bounds if it is at most a part of the
    /// greatest dose and, on the axis, of the dose there, or, in steep places, a distance.
    pub(super) fn new(
        curve: &Curve,
        computed: &[f64],
        (from_mm, shift_mm): (f64, f64),
        bounds: Bounds,
    ) -> Self {
        let greatest = curve.greatest().value;
        let is_profile = curve.kind != Kind::DepthDose;
        let is_judged = |at_mm: f64| is_profile || at_mm >= from_mm;
        let inside = INSIDE * curve.on_axis() / greatest;
        // The scale of least squares over the places that are judged, inside of the field.
        let (mut both, mut square) = (0.0, 0.0);
        for (point, dose) in curve.points.iter().zip(computed).filter(|(point, _)| is_judged(point.at_mm)) {
            if !is_profile || point.value >= inside * greatest {
                both += dose * point.value;
                square += dose * dose;
            }
        }
        let scale = both / square / greatest;
        let computed: Vec<f64> = computed.iter().map(|dose| dose * scale).collect();
        let last = curve.points.len() - 1;
        let slope = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            ((computed[b] - computed[a]) / (curve.points[b].at_mm - curve.points[a].at_mm)).abs()
        };
        let of = |(i, point): (usize, &super::curve::CurvePoint)| {
            let (measured, slope) = (point.value / greatest, slope(i));
            let distance_mm = (slope > STEEP_PER_MM).then(|| (computed[i] - measured).abs() / slope);
            ResidualPoint {
                at_mm: point.at_mm - shift_mm,
                measured,
                computed: computed[i],
                distance_mm,
                is_judged: is_judged(point.at_mm),
            }
        };
        let points: Vec<ResidualPoint> = curve.points.iter().enumerate().map(of).collect();
        let judged = || points.iter().filter(|point| point.is_judged);
        let difference = |point: &ResidualPoint| point.computed - point.measured;
        let local = |point: &ResidualPoint| difference(point) / point.measured;
        let greatest_of = |points: &mut dyn Iterator<Item = &ResidualPoint>,
                           of: &dyn Fn(&ResidualPoint) -> f64| {
            points.map(|point| (of(point), point.at_mm)).max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
        };
        let even = || judged().filter(|point| point.distance_mm.is_none());
        let sum: f64 = even().map(|point| difference(point) * difference(point)).sum();
        let beyond = |point: &&ResidualPoint| {
            let part = match is_profile {
                false => bounds.depth_dose,
                true if point.measured >= inside => bounds.inside,
                true => bounds.outside,
            };
            // NaN is beyond every bound.
            let is_far = difference(point).is_nan() || difference(point).abs() > part;
            let is_far_for_its_dose = !is_profile && local(point).abs() > bounds.local;
            (is_far || is_far_for_its_dose)
                && point.distance_mm.is_none_or(|distance| distance > bounds.distance_mm)
        };
        Self {
            name: curve.to_string(),
            file: curve.file.clone(),
            line: curve.line,
            is_profile,
            shift_mm,
            from_mm,
            rms: libm::sqrt(sum / even().count().max(1) as f64),
            largest: greatest_of(&mut even(), &difference).unwrap_or((0.0, 0.0)),
            largest_local: if is_profile { None } else { greatest_of(&mut even(), &local) },
            largest_mm: judged()
                .filter_map(|point| Some((point.distance_mm?, point.at_mm)))
                .max_by(|a, b| a.0.total_cmp(&b.0)),
            build_up: greatest_of(&mut points.iter().filter(|point| !point.is_judged), &difference),
            beyond_mm: judged()
                .filter(beyond)
                .max_by(|a, b| difference(a).abs().total_cmp(&difference(b).abs()))
                .map(|point| point.at_mm),
            points,
        }
    }
}
