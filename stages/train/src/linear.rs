//! A linear prediction beside the network: least squares over the same windows.

use nalgebra::{DMatrix, DVector};

use crate::TrainError;
use crate::dataset::{Batch, Dataset};

/// Part of the mean square of the inputs that is added to each square: valves that never open make no singular problem.
const RIDGE: f64 = 1e-9;

/// What least squares leaves of the changes: the root mean square of the error of each channel over the validation runs, as
/// a fraction of the root mean square of the change. Its inputs are all numbers of a window, and one.
///
/// # Errors
/// The inputs are not finite.
pub fn left(data: &Dataset) -> Result<Vec<f64>, TrainError> {
    let width = data.inputs() * data.window() + 1;
    let (mut squares, mut products) = (DMatrix::zeros(width, width), DMatrix::zeros(width, data.outputs()));
    each(&data.training(), width, data.outputs(), |inputs, changes| {
        squares.ger(1.0, inputs, inputs, 1.0);
        products.ger(1.0, inputs, changes, 1.0);
    });
    let ridge = RIDGE * squares.trace() / width as f64;
    (0..width).for_each(|i| squares[(i, i)] += ridge);
    let factor = squares.cholesky().ok_or(TrainError::Still("input of the network"))?;
    let weights = factor.solve(&products);
    let mut sums = vec![[0.0_f64; 2]; data.outputs()];
    each(&data.validation(), width, data.outputs(), |inputs, changes| {
        let said = weights.tr_mul(inputs);
        for ((sum, said), change) in sums.iter_mut().zip(said.iter()).zip(changes.iter()) {
            sum[0] += (said - change) * (said - change);
            sum[1] += change * change;
        }
    });
    Ok(sums.iter().map(|[left, all]| libm::sqrt(left / all)).collect())
}

/// Gives the inputs, with a one behind them, and the changes of each window.
fn each(batch: &Batch, width: usize, outputs: usize, mut take: impl FnMut(&DVector<f64>, &DVector<f64>)) {
    let (mut inputs, mut changes) = (DVector::repeat(width, 1.0), DVector::zeros(outputs));
    for (row, to) in batch.inputs.chunks_exact(width - 1).zip(batch.changes.chunks_exact(outputs)) {
        inputs.iter_mut().zip(row).for_each(|(input, value)| *input = f64::from(*value));
        changes.iter_mut().zip(to).for_each(|(change, value)| *change = f64::from(*value));
        take(&inputs, &changes);
    }
}
