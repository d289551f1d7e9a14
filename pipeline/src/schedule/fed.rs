//! Activations that happened already, among those that a schedule decides: the part of a session that a change does not
//! reach.

use stillpoint_samples::{Entry, JournalRef};

use super::RunError;
use crate::placement::{Begin, Committed, Placement, PlacementError};
use crate::record::Record;
use crate::sample_store::OwnedSample;

/// An entry that was made already, with its outputs.
#[derive(Clone, Debug)]
pub struct Fed {
    /// The entry.
    pub entry: Entry,
    /// The outputs, with the number of their port.
    pub outputs: Vec<(usize, OwnedSample)>,
}

/// A placement that also has activations of its own: they happened already. Their outputs have reached every consumer
/// when they are taken.
pub trait Feed: Placement {
    /// Time and operator of the next one.
    fn next(&self) -> Option<(u64, usize)>;

    /// Takes the next one.
    fn take(&mut self) -> Result<Option<Fed>, RunError>;

    /// Takes the begin of an operator that began no later than `start`, ns.
    fn take_start(&mut self, operator: usize, start: u64) -> Result<Option<Fed>, RunError>;

    /// Takes the entries that end an operator.
    fn take_end(&mut self, operator: usize) -> Result<Vec<Fed>, RunError>;

    /// When the operators of the feed ended, ns of session time.
    fn ended(&self) -> Option<u64>;
}

/// A placement without any.
pub(super) struct Unfed<'p>(pub &'p mut dyn Placement);

impl Placement for Unfed<'_> {
    fn start(&mut self, operator: usize, begin: Begin) -> Result<Entry, PlacementError> {
        self.0.start(operator, begin)
    }

    fn activate(&mut self, operator: usize, record: &Record) -> Result<Committed, PlacementError> {
        self.0.activate(operator, record)
    }

    fn end(&mut self, operator: usize, time: u64, inputs: &[JournalRef]) -> Result<Entry, PlacementError> {
        self.0.end(operator, time, inputs)
    }
}

impl Feed for Unfed<'_> {
    fn next(&self) -> Option<(u64, usize)> {
        None
    }

    fn take(&mut self) -> Result<Option<Fed>, RunError> {
        Ok(None)
    }

    fn take_start(&mut self, _: usize, _: u64) -> Result<Option<Fed>, RunError> {
        Ok(None)
    }

    fn take_end(&mut self, _: usize) -> Result<Vec<Fed>, RunError> {
        Ok(Vec::new())
    }

    fn ended(&self) -> Option<u64> {
        None
    }
}
