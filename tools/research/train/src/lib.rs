//! Trains what is learned offline. The one crate that stands on candle: what was trained is run by plain code elsewhere.
//!
//! - [`excite`]: data of a head on the simulated rig, excited by its valves
//! - [`patients`]: data of patients who breathe, nod, drift and cough, and tracked tones as a prediction
//! - [`dataset`]: samples, windows of them, and what is to be predicted
//! - [`network`]: the network of `stillpoint-control` as tensors, with gradients
//! - [`fit`]: descent, validation and early stop
//! - [`linear`]: least squares over the same windows, to compare with
//! - [`planner`]: the prior of beam angles of `stillpoint-network`
//! - [`tower`]: the dissertation's residual tower
//! - [`card`], [`patient_card`]: what a model was trained on, and how well it predicts

#![forbid(unsafe_code)]

pub mod card;
pub mod dataset;
pub mod device;
pub mod excite;
pub mod fit;
pub mod linear;
pub mod network;
pub mod patient_card;
pub mod patients;
pub mod planner;
pub mod tower;

/// Why there is no trained model.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// There is no GPU to train on.
    #[error(
        "this build trains on a CUDA device, and the first one cannot be used: {0}; a build without the feature `cuda` trains on the processor"
    )]
    Device(String),
    #[error(
        "there are {found} windows to {what}, and at least {needed} are needed: give more or longer runs"
    )]
    TooLittle {
        /// Train on, or validate on.
        what: &'static str,
        found: usize,
        needed: usize,
    },
    /// A channel that never moves.
    #[error("the {0} never changes in the data: excite it")]
    Still(&'static str),
    /// An option that cannot be.
    #[error("{what} is {value}: it must be {must}")]
    Option {
        /// Name of the quantity.
        what: &'static str,
        value: f64,
        must: &'static str,
    },
    /// The descent left the finite numbers.
    #[error("the loss is not finite after epoch {0}: take a smaller learning rate")]
    RanAway(usize),
    /// The head on the rig has no rest.
    #[error("the rig: {0}")]
    Rig(String),
    /// A case, its doses or its features.
    #[error("planning: {0}")]
    Plan(String),
    /// Games that were trained on came from a worker that gave wrong answers later.
    #[error("games of a worker that was shut out are in doubt: {}", .0.join(", "))]
    Doubtful(Vec<String>),
    /// A file that cannot be read or written.
    #[error("{}: {why}", path.display())]
    File {
        /// Path of the file.
        path: std::path::PathBuf,
        /// Description of the fault.
        why: String,
    },
    /// An operation on tensors failed.
    #[error("training failed: {0}")]
    Tensor(#[from] candle_core::Error),
    /// The numbers do not make a model.
    #[error("the trained numbers make no model: {0}")]
    Predictor(#[from] stillpoint_control::predictor::PredictorError),
}
