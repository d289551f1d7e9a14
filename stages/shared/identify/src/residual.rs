//! Residual tests: the errors of a model should be white and independent of the input.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Number of tested lags.
const LAGS: usize = 25;
/// Added to the input's correlation with itself: an input of few frequencies leaves directions open.
const RIDGE: f64 = 1e-6;
/// Quantile of the normal distribution that 99 % lie below.
const QUANTILE_99: f64 = 2.326_347_874_040_841;
/// 99 % of a normal distribution lie within this many standard deviations.
const WITHIN_99: f64 = 2.575_829_303_548_901;

/// A test of the errors.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ResidualTest {
    pub name: &'static str,
    /// The sum of squared correlations over their variance.
    pub statistic: f64,
    /// What 99 of 100 records of a true model stay below.
    pub limit: f64,
    /// Lags whose correlation alone is beyond its 99 % bound, of `lags`.
    pub beyond: usize,
    /// Number of tested lags.
    pub lags: usize,
}

impl ResidualTest {
    /// Whether the errors pass.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.statistic <= self.limit
    }
}

/// The errors against themselves at lags 1 to 25, and against the input at lags 0 to 25 (causes before effects).
#[must_use]
pub fn residual_tests(errors: &[f64], input: &[f64]) -> [ResidualTest; 2] {
    let n = errors.len().min(input.len());
    let lags = LAGS.min(n.saturating_sub(1) / 4);
    let (e, u) = (centred(&errors[..n]), centred(&input[..n]));
    let (variance_e, variance_u) = (covariance(&e, &e, 0), covariance(&u, &u, 0));
    let own: Vec<f64> = (1..=lags).map(|lag| covariance(&e, &e, lag) / variance_e).collect();
    let white = test("whiteness", &own, n);
    let scale = (variance_e * variance_u).sqrt();
    let with_input = DVector::from_fn(lags + 1, |lag, _| covariance(&e, &u, lag) / scale);
    // Of white errors, correlations with a slow input go together as the input does: n r^T R_u^-1 r is chi-squared.
    let slow = DMatrix::from_fn(lags + 1, lags + 1, |i, j| {
        covariance(&u, &u, i.abs_diff(j)) / variance_u + if i == j { RIDGE } else { 0.0 }
    });
    let mut cross = test("independence of the input", with_input.as_slice(), n);
    if let Some(root) = slow.cholesky() {
        cross.statistic = n as f64 * with_input.dot(&root.solve(&with_input));
    }
    [white, cross]
}

fn test(name: &'static str, correlations: &[f64], samples: usize) -> ResidualTest {
    let variance = 1.0 / samples as f64;
    let bound = WITHIN_99 * variance.sqrt();
    ResidualTest {
        name,
        statistic: correlations.iter().map(|r| r * r / variance).sum(),
        limit: chi_squared_99(correlations.len() as f64),
        beyond: correlations.iter().filter(|r| r.abs() > bound).count(),
        lags: correlations.len(),
    }
}

fn centred(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|v| v - mean).collect()
}

/// sum a(k) b(k - lag) / N.
fn covariance(a: &[f64], b: &[f64], lag: usize) -> f64 {
    a.iter().skip(lag).zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len().max(1) as f64
}

/// The 99 % quantile of a chi-squared distribution with this many degrees of freedom (Wilson and Hilferty).
fn chi_squared_99(degrees: f64) -> f64 {
    let part = 2.0 / (9.0 * degrees.max(1e-9));
    let root = 1.0 - part + QUANTILE_99 * part.sqrt();
    degrees * root * root * root
}
