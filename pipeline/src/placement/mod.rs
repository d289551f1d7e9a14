//! Placements: where activations happen. They know nothing of schedules.
//!
//! - `directed`: an operator whose activations are decided elsewhere
//! - `local`: all operators in this thread
//! - `threads`: a thread per operator
//!
//! Processes that are directed stand in `live`, since they share children and pipes with the live executor.

mod directed;
mod local;
mod threads;

pub use directed::Directed;
pub use local::Local;
pub use threads::Threads;

use serde::{Deserialize, Serialize};
use stillpoint_samples::Entry;

use crate::record::Record;
use crate::sample_store::OwnedSample;

/// The result of an activation: its entry, and its outputs in the order of sending.
#[derive(Clone, Debug)]
pub struct Committed {
    /// The journal entry.
    pub entry: Entry,
    /// The outputs, with the number of their port.
    pub outputs: Vec<(usize, OwnedSample)>,
    /// The reason of an activation that failed.
    pub fault: Option<String>,
}

/// Why a placement could not follow the schedule.
#[derive(Clone, Debug, thiserror::Error)]
pub enum PlacementError {
    /// The operator could not be made.
    #[error("operator {operator}: {reason}")]
    Setup {
        /// Name of the operator.
        operator: String,
        /// Message of the operator.
        reason: String,
    },
    /// A sample that the record names is not there.
    #[error(
        "operator {operator}: sample {sequence} of incarnation {incarnation} on input {port} is not there"
    )]
    Sample {
        /// Name of the operator.
        operator: String,
        /// Number of the input.
        port: u32,
        /// Incarnation of the producer.
        incarnation: u32,
        /// Sequence of the sample.
        sequence: u64,
    },
    /// It took fewer changes of parameters than the incarnation begins with.
    #[error(
        "operator {operator}: incarnation {incarnation} began with {carried} changes of parameters, of which {known} are known"
    )]
    Changes {
        /// Name of the operator.
        operator: String,
        /// The incarnation.
        incarnation: u32,
        /// Changes that it began with.
        carried: u64,
        /// Those of earlier incarnations that are known.
        known: usize,
    },
    /// The other end is gone.
    #[error("operator {operator}: {reason}")]
    Gone {
        /// Name of the operator.
        operator: String,
        /// Description of the event.
        reason: String,
    },
}

/// With which of the changes of parameters that an operator took its next incarnation begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Carried {
    /// With all of them.
    All,
    /// With the oldest, this many: those that a recorded incarnation began with.
    First(u64),
}

/// The beginning of an incarnation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Begin {
    /// Its number.
    pub incarnation: u32,
    /// Session time, ns.
    pub time: u64,
    /// The changes of parameters that it begins with.
    pub carried: Carried,
}

/// Where activations happen.
pub trait Placement {
    /// Begins an incarnation of an operator and gives the entry that marks it.
    fn start(&mut self, operator: usize, begin: Begin) -> Result<Entry, PlacementError>;

    /// Does one activation. Its outputs have reached every consumer when this returns.
    fn activate(&mut self, operator: usize, record: &Record) -> Result<Committed, PlacementError>;

    /// Ends an incarnation in order and gives the entry that marks it. `inputs` is the account of its inputs.
    fn end(
        &mut self,
        operator: usize,
        time: u64,
        inputs: &[stillpoint_samples::JournalRef],
    ) -> Result<Entry, PlacementError>;
}
