//! The loss (5.9), SCIENCE G7: `w_mse (zeta - v)^2 - w_ce pi^T log p + lambda |psi|^2`.

use candle_core::{D, Tensor};

use crate::TrainError;

/// Weights of the loss.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Weights {
    /// Of the square of the value's error.
    pub mse: f64,
    /// Of the cross-entropy of the policy.
    pub ce: f64,
    /// Of the sum of squares of the numbers that are trained.
    pub lambda: f64,
}

impl Weights {
    /// The dissertation's, with SCIENCE's `lambda`.
    pub const PRINTED: Self = Self { mse: 0.01, ce: 0.9, lambda: 1e-4 };
}

/// The loss, its means over the values and over the rows of the policy.
///
/// `logits` and `pi` have a row for each state. `psi` are the numbers that are trained.
pub fn loss(
    (zeta, v): (&Tensor, &Tensor),
    (pi, logits): (&Tensor, &Tensor),
    psi: &[Tensor],
    weights: Weights,
) -> Result<Tensor, TrainError> {
    let mse = (zeta - v)?.sqr()?.mean_all()?;
    let log_p = candle_nn::ops::log_softmax(logits, D::Minus1)?;
    let ce = (pi * log_p)?.sum(D::Minus1)?.mean_all()?.neg()?;
    let mut sum = ((mse * weights.mse)? + (ce * weights.ce)?)?;
    if weights.lambda > 0.0 {
        for numbers in psi {
            sum = (sum + (numbers.sqr()?.sum_all()? * weights.lambda)?)?;
        }
    }
    Ok(sum)
}
