//! From a record to a model, with all that is to be said of it.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::companion::Companion;
use crate::confidence::{Estimate, Pole, dc_gain, poles};
use crate::descent::{descend, diagonal_scale};
use crate::residual::{ResidualTest, residual_tests};
use crate::start::{reduced_arx, short_arx};
use crate::{FitError, MAX_ORDER};

/// What went in and came out, one of each per sample time. Where they are counted from is theirs: take off the point at
/// which the system rests.
#[derive(Clone, Copy, Debug)]
pub struct Record<'a> {
    pub input: &'a [f64],
    pub output: &'a [f64],
}

/// A fitted model and how good it is, in the units of the record.
#[derive(Clone, Debug, Serialize)]
pub struct Found {
    #[serde(skip)]
    pub model: Companion,
    /// V = 1/2 sum e^2.
    pub loss: f64,
    /// Variance of the innovation e.
    pub noise_variance: f64,
    /// How much of the output one-step predictions explain, percent: 100 (1 - |y - y^| / |y - mean y|).
    pub fit_percent: f64,
    /// The same for the output that the input alone makes.
    pub simulation_fit_percent: f64,
    pub poles: Vec<Pole>,
    /// The DC gain; `None` where a pole's modulus is 1 or more.
    pub dc_gain: Option<Estimate>,
    /// Standard deviations of the last row of A, of B, K and the start.
    pub parameter_sd: Vec<f64>,
    /// Whether the errors are noise.
    pub residuals: [ResidualTest; 2],
    pub samples: usize,
    /// Steps of the descent.
    pub steps: usize,
}

/// Fits a model of this order by the prediction-error method. It starts from the ARX model and from a long ARX model
/// that is reduced, and takes the better start.
///
/// # Errors
/// A record that determines no model.
pub fn fit(record: &Record<'_>, order: usize) -> Result<Found, FitError> {
    check(record, order)?;
    let (u, y) = (root_mean_square(record.input), root_mean_square(record.output));
    // Numbers of about one: B in 1e-7 of (4.11) is a matter of units.
    let input: Vec<f64> = record.input.iter().map(|v| v / u).collect();
    let output: Vec<f64> = record.output.iter().map(|v| v / y).collect();
    let starts = [short_arx(&input, &output, order), reduced_arx(&input, &output, order)];
    let feet = starts.iter().flatten().filter_map(|start| descend(start, &input, &output));
    let foot = feet.min_by(|a, b| a.loss.total_cmp(&b.loss)).ok_or(FitError::NoModel(order))?;
    let n = output.len();
    let freedom = (n - 4 * order).max(1) as f64;
    // The state is in the output's unit, so A and K are plain numbers.
    let unscale = DVector::from_fn(4 * order, |i, _| match i / order {
        0 | 2 => 1.0,
        1 => y / u,
        _ => y,
    });
    let covariance = inverse(&foot.curvature) * (2.0 * foot.loss / freedom);
    let covariance =
        DMatrix::from_fn(4 * order, 4 * order, |i, j| covariance[(i, j)] * unscale[i] * unscale[j]);
    let model = Companion::from_parameters(&foot.model.parameters().component_mul(&unscale));
    let errors = model.predict(record.input, record.output).errors;
    let simulated = model.simulate(record.input);
    let left: Vec<f64> = record.output.iter().zip(&simulated).map(|(y, s)| y - s).collect();
    Ok(Found {
        loss: foot.loss * y * y,
        noise_variance: 2.0 * foot.loss * y * y / freedom,
        fit_percent: fit_percent(&errors, record.output),
        simulation_fit_percent: fit_percent(&left, record.output),
        poles: poles(&model, &covariance),
        dc_gain: dc_gain(&model, &covariance),
        parameter_sd: (0..4 * order).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect(),
        residuals: residual_tests(&errors, record.input),
        samples: n,
        steps: foot.steps,
        model,
    })
}

/// The divisor of a signal; 1 for a signal of zeros.
fn root_mean_square(values: &[f64]) -> f64 {
    let largest = values.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    if largest == 0.0 {
        return 1.0;
    }
    let squares: f64 = values.iter().map(|v| (v / largest) * (v / largest)).sum();
    largest * (squares / values.len() as f64).sqrt()
}

fn check(record: &Record<'_>, order: usize) -> Result<(), FitError> {
    if !(1..=MAX_ORDER).contains(&order) {
        return Err(FitError::Order(order));
    }
    let (input, output) = (record.input.len(), record.output.len());
    if input != output {
        return Err(FitError::Lengths { input, output });
    }
    let needed = 20 * order;
    if output < needed {
        return Err(FitError::TooShort { order, needed, found: output });
    }
    for (what, values) in [("input", record.input), ("output", record.output)] {
        if let Some((place, value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            return Err(FitError::NotFinite { what, place, value: *value });
        }
        if values.iter().all(|v| *v == values[0]) {
            return Err(FitError::Constant(what));
        }
    }
    Ok(())
}

/// The inverse of a symmetric matrix, scaled to a unit diagonal first; what cannot be told has a large variance.
fn inverse(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = diagonal_scale(matrix);
    let n = matrix.nrows();
    let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let eigen = scaled.symmetric_eigen();
    let inverted = eigen.eigenvalues.map(|v| 1.0 / v.max(1e-15));
    let back = &eigen.eigenvectors * DMatrix::from_diagonal(&inverted) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(n, n, |i, j| back[(i, j)] * scale[i] * scale[j])
}

fn fit_percent(errors: &[f64], output: &[f64]) -> f64 {
    let mean = output.iter().sum::<f64>() / output.len() as f64;
    let whole: f64 = output.iter().map(|y| (y - mean) * (y - mean)).sum();
    let left: f64 = errors.iter().map(|e| e * e).sum();
    100.0 * (1.0 - (left / whole).sqrt())
}
