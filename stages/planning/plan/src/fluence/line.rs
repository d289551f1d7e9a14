//! The minimum of the objective along a line: exact where it is piecewise quadratic.

use super::problem::Problem;

const MAX_STEPS: usize = 60;

/// Step `t` in `[0, longest]` that minimises the objective of `dose + t change`.
pub fn minimise(problem: &Problem, dose: &[f64], change: &[f64], longest: f64) -> f64 {
    root(|t| slope_at(problem, dose, change, t), [0.0, longest], longest.min(1.0))
}

/// Where in `[from, to]` a slope is zero that rises, sought from `start`; the end beside it where
/// that is nowhere. `slope` gives the slope and its own slope.
///
/// Newton, kept in a bracket, ends on the exact piece of a slope that is piecewise linear.
pub fn root(slope: impl Fn(f64) -> (f64, f64), [from, to]: [f64; 2], start: f64) -> f64 {
    if slope(from).0 >= 0.0 {
        return from;
    }
    let (mut low, mut high, mut t) = (from, to, start);
    for _ in 0..MAX_STEPS {
        let (value, curvature) = slope(t);
        if value > 0.0 {
            high = t;
        } else if value < 0.0 {
            low = t;
        } else {
            return t;
        }
        let newton = t - value / curvature;
        let next = if newton > low && newton < high {
            newton
        } else if newton >= high && value < 0.0 && high == to && to.is_finite() {
            to
        } else if high.is_finite() {
            f64::midpoint(low, high)
        } else {
            2.0 * t
        };
        if (next - t).abs() <= 1e-14 * t.abs() || next == t {
            return next;
        }
        t = next;
    }
    low
}

/// First and second derivative of the objective along the line at `t`.
pub fn slope_at(problem: &Problem, dose: &[f64], change: &[f64], t: f64) -> (f64, f64) {
    let (mut slope, mut curvature) = (0.0, 0.0);
    for term in problem.terms() {
        let row = term.row as usize;
        let (d, by) = (dose[row] + t * change[row], change[row]);
        slope += term.slope(d) * by;
        curvature += term.curvature(d) * by * by;
    }
    if !problem.regions().is_empty() {
        let at: Vec<f64> = dose.iter().zip(change).map(|(dose, by)| dose + t * by).collect();
        for region in problem.regions() {
            let (of_slope, of_curvature) = region.along(&at, change);
            slope += of_slope;
            curvature += of_curvature;
        }
    }
    (slope, curvature)
}
