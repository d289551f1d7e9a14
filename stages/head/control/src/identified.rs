//! A model of `stillpoint identify` (4.10)-(4.11) as the plant of a controller.

use nalgebra::{DMatrix, DVector};
use stillpoint_identify::InnovationModel;

use crate::lqi::Plant;

/// A model of one bladder and one channel, in parts of the channel's scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Identified {
    plant: Plant,
    /// What the output is counted from, and its scale.
    output: f64,
    scale: f64,
    /// What the input, a net duty, is counted from.
    input: f64,
    /// The state in which an output of 1 stays, as well as one does.
    rest: DVector<f64>,
    /// The state beside that, and the input, that move the output by 1 in each sample time.
    ramp: DVector<f64>,
}

/// Why a model cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IdentifiedError {
    /// It was made for another sample time.
    #[error(
        "its sample time is {model} ms and the timer ticks every {timer} ms: say `every: {model} ms`, or identify with \
         --sample-time '{timer} ms'"
    )]
    SampleTime {
        /// The model's, ms.
        model: f64,
        /// The controller's, ms.
        timer: f64,
    },
    /// Its output has another unit.
    #[error("its output is in {found}, and the channel in {expected}: identify from the channel itself")]
    Unit {
        /// The model's.
        found: String,
        /// The channel's.
        expected: &'static str,
    },
    /// The output follows the input at once.
    #[error("its output depends on the input of the same moment (D = {0}): no controller can use that")]
    Feedthrough(f64),
    /// The input has no effect.
    #[error("its input does nothing: B is zero")]
    NoEffect,
}

/// Sample times that differ by less than this part are the same.
const SAME: f64 = 0.01;

impl Identified {
    /// A model for a channel of this unit and scale, used every `period` seconds.
    ///
    /// # Errors
    /// [`IdentifiedError`].
    pub fn new(
        model: &InnovationModel,
        unit: &'static str,
        scale: f64,
        period: f64,
    ) -> Result<Self, IdentifiedError> {
        let sample_time = model.sample_time_s();
        if (sample_time / period - 1.0).abs() > SAME {
            return Err(IdentifiedError::SampleTime { model: sample_time * 1e3, timer: period * 1e3 });
        }
        let found = &model.output().unit;
        if !found.is_empty() && found != unit {
            return Err(IdentifiedError::Unit { found: found.clone(), expected: unit });
        }
        if model.d() != 0.0 {
            return Err(IdentifiedError::Feedthrough(model.d()));
        }
        if model.b().iter().all(|v| *v == 0.0) {
            return Err(IdentifiedError::NoEffect);
        }
        let n = model.order();
        let plant = Plant {
            a: model.a(),
            b: DMatrix::from_column_slice(n, 1, model.b().as_slice()),
            c: DMatrix::from_row_slice(1, n, model.c().as_slice()) / scale,
            k: DMatrix::from_column_slice(n, 1, model.k().as_slice()) * scale,
        };
        let rest = resting_state(&plant);
        Ok(Self {
            ramp: ramp(&plant, &rest),
            rest,
            plant,
            output: model.output().offset,
            scale,
            input: model.input().offset,
        })
    }

    /// The plant, in parts of the scale.
    #[must_use]
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// An output, m or rad, as the plant counts it.
    #[must_use]
    pub fn counted(&self, output: f64) -> f64 {
        (output - self.output) / self.scale
    }

    /// The state of the plant at this output while the output moves by `speed` in each sample time, and the input that
    /// keeps it so, as well as one does.
    pub fn moving(&self, y: f64, speed: f64, x: &mut [f64]) -> f64 {
        let n = self.rest.len();
        for (i, x) in x.iter_mut().enumerate() {
            *x = self.rest[i] * y + self.ramp[i] * speed;
        }
        self.ramp[n] * speed
    }

    /// The net duty of an input of the plant.
    #[must_use]
    pub fn duty(&self, u: f64) -> f64 {
        u + self.input
    }

    /// Between which limits the plant's input lies, so that the net duty lies within -1 to 1.
    #[must_use]
    pub fn limits(&self) -> [f64; 2] {
        [-1.0 - self.input, 1.0 - self.input]
    }
}

/// The least-squares solution of `x = A x`, `C x = 1`.
fn resting_state(plant: &Plant) -> DVector<f64> {
    let n = plant.a.nrows();
    let mut rows = DMatrix::zeros(n + 1, n);
    rows.view_mut((0, 0), (n, n)).copy_from(&(DMatrix::identity(n, n) - &plant.a));
    rows.view_mut((n, 0), (1, n)).copy_from(&plant.c);
    let mut right = DVector::zeros(n + 1);
    right[n] = 1.0;
    rows.svd(true, true).solve(&right, 1e-12).unwrap_or_else(|_| DVector::zeros(n))
}

/// The least-squares solution of `(A - I) x + B u = x_r`, `C x = 0`, with x_r the state at rest of an output of 1: x, and
/// behind it u. All states then move by x_r in a sample time.
fn ramp(plant: &Plant, rest: &DVector<f64>) -> DVector<f64> {
    let n = plant.a.nrows();
    let mut rows = DMatrix::zeros(n + 1, n + 1);
    rows.view_mut((0, 0), (n, n)).copy_from(&(&plant.a - DMatrix::identity(n, n)));
    rows.view_mut((0, n), (n, 1)).copy_from(&plant.b);
    rows.view_mut((n, 0), (1, n)).copy_from(&plant.c);
    let mut right = DVector::zeros(n + 1);
    right.rows_mut(0, n).copy_from(rest);
    rows.svd(true, true).solve(&right, 1e-12).unwrap_or_else(|_| DVector::zeros(n + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    #[test]
    fn a_plant_that_integrates_is_moved_along_with_its_set_point() {
        // y' = 0.3 v, v a lag of 0.8 behind u.
        let plant = Plant {
            a: dmatrix![1.0, 0.3; 0.0, 0.8],
            b: dmatrix![0.0; 0.2],
            c: dmatrix![1.0, 0.0],
            k: dmatrix![0.5; 0.1],
        };
        let rest = resting_state(&plant);
        let ramp = ramp(&plant, &rest);
        let mut x = &rest * 2.0 + ramp.rows(0, 2) * 0.6;
        for k in 0..10 {
            assert!(((&plant.c * &x)[0] - 2.0 - 0.6 * f64::from(k)).abs() < 1e-9, "{x}");
            x = &plant.a * &x + &plant.b * (ramp[2] * 0.6);
        }
    }
}
