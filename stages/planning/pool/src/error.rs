//! Why a call has no answer.

use std::path::PathBuf;

use crate::call::Kind;
use crate::courier::CourierError;
use crate::store::StoreError;
use crate::{Hash, WireError};

/// Why a call has no answer.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// A content is not in the store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// No message will arrive any more.
    #[error(transparent)]
    Courier(#[from] CourierError),
    /// Bytes cannot be read.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// A file cannot be read.
    #[error("{}: {error}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system answered.
        error: std::io::Error,
    },
    /// Neither a worker nor this process gave one.
    #[error("a call has no answer")]
    NoAnswer,
    /// A call of another kind.
    #[error("a {} is not a call of a search", .0.word())]
    NotOfSearch(Kind),
    /// An argument of another kind.
    #[error("{0:.16} is an argument of another kind than the call takes it for")]
    Argument(Hash),
    /// Weights of other beams.
    #[error("the weights to begin with are not those of {0} bixels")]
    Weights(usize),
    /// The doses of the set-ups do not fit each other.
    #[error("the doses of a beam in several set-ups have different sizes")]
    Uneven,
    /// The goals are not those of the doses, or are not goals.
    #[error("the goals cannot be read: {0}")]
    Goals(WireError),
    /// The plan that a price names is not in this process.
    #[error("the plan {0:.16} is not here")]
    NoPlan(Hash),
    /// A dose is not in this process.
    #[error("a dose is not here")]
    NoDose,
    /// The answer is that of another call.
    #[error("it is another game")]
    OtherGame,
    /// A game cannot be played.
    #[error("{name}, {patient}: {error}")]
    Game {
        /// The game.
        name: String,
        /// Its patient.
        patient: String,
        /// Why.
        error: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A fault of this program on a worker.
    #[error("the computation panicked on this worker")]
    Panic,
    /// The arguments do not fit each other, or the answer has no place to go.
    #[error("{0}")]
    Fault(Box<dyn std::error::Error + Send + Sync>),
}

impl CallError {
    /// Of the error of a lower layer.
    pub fn of(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Fault(Box::new(error))
    }
}
