//! Identifies a linear model from what went in and what came out: the prediction-error method for the innovation form
//! (4.10), SCIENCE D4.
//!
//! ```
//! use stillpoint_identify::{Record, fit};
//!
//! // y(k+1) = 0.9 y(k) + 0.5 u(k), with the input switching every 20 samples.
//! let u: Vec<f64> = (0..200).map(|k| if (k / 20) % 2 == 0 { 1.0 } else { -1.0 }).collect();
//! let mut y = vec![0.0; 200];
//! for k in 1..200 {
//!     y[k] = 0.9 * y[k - 1] + 0.5 * u[k - 1] + 1e-3 * ((k * 7919 % 13) as f64 - 6.0);
//! }
//! let found = fit(&Record { input: &u, output: &y }, 1)?;
//! let gain = found.dc_gain.expect("it is stable");
//! assert!((gain.value - 5.0).abs() < 0.1);
//! # Ok::<(), stillpoint_identify::FitError>(())
//! ```
//!
//! - `resample`: samples at any times to a record of one sample time
//! - `companion`: the form in which a model is fitted: its predictor, and the derivatives of its errors
//! - `start`: models to start from, by least squares
//! - `descent`: Levenberg and Marquardt's descent
//! - `fit`: from a record to a model with all that is to be said of it
//! - `confidence`: poles and DC gain, and how well they are known
//! - `residual`: whether the residuals are noise
//! - `model`: the model as a file, for a controller

#![forbid(unsafe_code)]

mod companion;
mod confidence;
mod descent;
mod fit;
mod model;
mod resample;
mod residual;
mod start;

pub use companion::{Companion, Prediction};
pub use confidence::{Estimate, INTEGRATOR, Pole, Stability};
pub use fit::{Found, Record, fit};
pub use model::{InnovationModel, ModelError, Provenance, Signal};
pub use resample::{Grid, ResampleError, Resampled, resample};
pub use residual::{ResidualTest, residual_tests};
pub use start::arx;

/// Why there is no model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitError {
    /// The order is 0, or more than can be told from any record.
    #[error("the order is {0}: give one from 1 to {MAX_ORDER}")]
    Order(usize),
    /// Input and output differ in length.
    #[error("there are {input} samples of the input and {output} of the output: give one of each per time")]
    Lengths {
        /// Samples of the input.
        input: usize,
        /// Samples of the output.
        output: usize,
    },
    /// There are fewer samples than a fit needs.
    #[error("a model of order {order} needs at least {needed} samples, and there are {found}: record longer")]
    TooShort { order: usize, needed: usize, found: usize },
    /// A number that is none.
    #[error("sample {place} of the {what} is {value}: leave such samples out")]
    NotFinite { what: &'static str, place: usize, value: f64 },
    /// A signal without information.
    #[error("the {0} never changes: excite the system while it is recorded")]
    Constant(&'static str),
    /// No start led to a model that predicts.
    #[error("no model of order {0} predicts the output: try another order, or an input that excites more")]
    NoModel(usize),
}

/// The highest order that is fitted.
pub const MAX_ORDER: usize = 12;
