//! The exact minimum of a piecewise quadratic along a line.

use super::problem::Problem;

const MAX_STEPS: usize = 60;

/// Step `t` in `[0, longest]` that minimises the objective of `dose + t change`.
///
/// The slope along the line rises and is piecewise linear: Newton on it, kept in a bracket, ends on the exact piece.
pub fn minimise(problem: &Problem, dose: &[f64], change: &[f64], longest: f64) -> f64 {
    if slope_at(problem, dose, change, 0.0).0 >= 0.0 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, longest);
    let mut t = longest.min(1.0);
    for _ in 0..MAX_STEPS {
        let (slope, curvature) = slope_at(problem, dose, change, t);
        if slope > 0.0 {
            high = t;
        } else if slope < 0.0 {
            low = t;
        } else {
            return t;
        }
        let newton = t - slope / curvature;
        let next = if newton > low && newton < high {
            newton
        } else if newton >= high && slope < 0.0 && high == longest && longest.is_finite() {
            longest
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
fn slope_at(problem: &Problem, dose: &[f64], change: &[f64], t: f64) -> (f64, f64) {
    let (mut slope, mut curvature) = (0.0, 0.0);
    for term in problem.terms() {
        let row = term.row as usize;
        let (d, by) = (dose[row] + t * change[row], change[row]);
        slope += term.slope(d) * by;
        curvature += term.curvature(d) * by * by;
    }
    (slope, curvature)
}
