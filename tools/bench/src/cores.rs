//! The cores that a measurement uses.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::Serialize;

use stillpoint::Failure;

/// The cores on which the processes of a chain run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// All processes run on one core.
    One,
    /// The processes alternate between two cores.
    Two,
}

impl Layout {
    /// Core of the process at this place of a chain, counted from 0.
    pub fn core(self, cores: &[usize], place: usize) -> usize {
        let last = cores.last().copied().unwrap_or(0);
        match self {
            Self::One => last,
            Self::Two if place.is_multiple_of(2) => cores.first().copied().unwrap_or(last),
            Self::Two => last,
        }
    }
}

/// The cores that this process may use.
pub fn cores() -> Result<Vec<usize>, Failure> {
    let set = sched_getaffinity(None).map_err(Failure::failed)?;
    Ok((0..CpuSet::MAX_CPU).filter(|c| set.is_set(*c)).collect())
}

/// Binds this thread to these cores, and with it the threads and processes that it starts from now on.
pub fn bind(cores: &[usize]) -> Result<(), Failure> {
    let mut set = CpuSet::new();
    for core in cores {
        set.set(*core);
    }
    sched_setaffinity(None, &set).map_err(Failure::failed)
}
