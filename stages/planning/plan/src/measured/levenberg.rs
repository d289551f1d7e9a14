//! Least squares of a smooth function of few numbers: Levenberg and Marquardt, with slopes by differences.

use nalgebra::{DMatrix, DVector};

/// Most steps.
const STEPS: usize = 60;
/// Difference of a number for the slopes.
const DIFFERENCE: f64 = 1e-4;
/// A step that gains less than this part of the sum ends the search.
const GAIN: f64 = 1e-9;

/// The numbers that make the sum of squares of the residuals least, from these on.
pub(super) fn least_squares(start: Vec<f64>, residuals: impl Fn(&[f64]) -> Vec<f64>) -> Vec<f64> {
    let sum = |values: &[f64]| values.iter().map(|r| r * r).sum::<f64>();
    let mut numbers = start;
    let mut now = residuals(&numbers);
    let mut damping = 1e-3;
    for _ in 0..STEPS {
        let mut slopes = DMatrix::zeros(now.len(), numbers.len());
        for column in 0..numbers.len() {
            let mut moved = numbers.clone();
            moved[column] += DIFFERENCE;
            let there = residuals(&moved);
            for (row, (b, a)) in there.iter().zip(&now).enumerate() {
                slopes[(row, column)] = (b - a) / DIFFERENCE;
            }
        }
        let normal = slopes.transpose() * &slopes;
        let gradient = slopes.transpose() * DVector::from_column_slice(&now);
        let before = sum(&now);
        let mut is_better = false;
        // A larger damping turns a step that is too long into a short one down the slope.
        for _ in 0..12 {
            let mut damped = normal.clone();
            for i in 0..numbers.len() {
                damped[(i, i)] *= 1.0 + damping;
                damped[(i, i)] += 1e-12;
            }
            let Some(step) = damped.cholesky().map(|factor| factor.solve(&gradient)) else {
                damping *= 10.0;
                continue;
            };
            let moved: Vec<f64> = numbers.iter().zip(step.iter()).map(|(n, s)| n - s).collect();
            let there = residuals(&moved);
            if sum(&there) < before {
                (numbers, now) = (moved, there);
                damping = (damping * 0.2).max(1e-9);
                is_better = true;
                break;
            }
            damping *= 10.0;
        }
        if !is_better || before - sum(&now) < GAIN * before {
            break;
        }
    }
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_of_two_exponentials_is_found() {
        let curve = |n: &[f64], x: f64| n[0] * libm::exp(-n[1] * x) + n[2] * libm::exp(-n[3] * x);
        let truth = [2.0, 0.3, 1.0, 1.7];
        let residuals =
            |n: &[f64]| (0..40).map(|i| f64::from(i) * 0.1).map(|x| curve(n, x) - curve(&truth, x)).collect();
        let found = least_squares(vec![1.5, 0.5, 1.5, 1.2], residuals);
        for (found, truth) in found.iter().zip(&truth) {
            assert!((found - truth).abs() < 1e-4, "{found} {truth}");
        }
    }
}
