//! A linear prediction beside the network: least squares over the same windows.

use nalgebra::{DMatrix, DVector};

use crate::TrainError;
use crate::dataset::{Batch, Dataset};

/// Part of the mean square of the inputs that is added to each square: valves that never open make no singular problem.
const RIDGE: f64 = 1e-9;

/// Least squares over windows: weights of all numbers of a window, and of one. (inputs + 1) by outputs.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear {
    weights: DMatrix<f64>,
}

impl Linear {
    /// The weights that predict these windows of a data set best.
    ///
    /// # Errors
    /// The inputs are not finite.
    pub fn new(data: &Dataset, batch: &Batch) -> Result<Self, TrainError> {
        let (width, outputs) = (data.inputs() * data.window() + 1, data.outputs());
        let (mut squares, mut products) = (DMatrix::zeros(width, width), DMatrix::zeros(width, outputs));
        let (mut inputs, mut changes) = (DVector::repeat(width, 1.0), DVector::zeros(outputs));
        for (row, to) in batch.inputs.chunks_exact(width - 1).zip(batch.changes.chunks_exact(outputs)) {
            inputs.iter_mut().zip(row).for_each(|(input, value)| *input = f64::from(*value));
            changes.iter_mut().zip(to).for_each(|(change, value)| *change = f64::from(*value));
            squares.ger(1.0, &inputs, &inputs, 1.0);
            products.ger(1.0, &inputs, &changes, 1.0);
        }
        let ridge = RIDGE * squares.trace() / width as f64;
        (0..width).for_each(|i| squares[(i, i)] += ridge);
        let factor = squares.cholesky().ok_or(TrainError::Still("input of the network"))?;
        Ok(Self { weights: factor.solve(&products) })
    }

    /// The root mean square of the error for each change, in parts of the change's scale.
    #[must_use]
    pub fn errors(&self, batch: &Batch) -> Vec<f64> {
        let (width, outputs) = self.weights.shape();
        let mut inputs = DVector::repeat(width, 1.0);
        batch.errors(outputs, |_, window, predicted| {
            inputs.iter_mut().zip(window).for_each(|(input, value)| *input = f64::from(*value));
            predicted.copy_from_slice(self.weights.tr_mul(&inputs).as_slice());
        })
    }
}

/// What least squares leaves of the changes: the root mean square of the error of each over the validation runs, as a
/// fraction of the root mean square of the change.
///
/// # Errors
/// The inputs are not finite.
pub fn left(data: &Dataset) -> Result<Vec<f64>, TrainError> {
    let batch = data.validation();
    let hold = batch.errors(data.outputs(), |_, _, predicted| predicted.fill(0.0));
    Ok(Linear::new(data, &data.training())?
        .errors(&batch)
        .iter()
        .zip(&hold)
        .map(|(error, hold)| error / hold)
        .collect())
}
