//! Which cores a bench uses.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use serde::Serialize;

use stillpoint::Failure;

/// Where the processes of a chain run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// All on one core.
    One,
    /// By turns on two.
    Two,
}

impl Layout {
    /// The core of the process at this place of a chain.
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

/// Binds this thread, and what it starts from now on, to these cores.
pub fn bind(cores: &[usize]) -> Result<(), Failure> {
    let mut set = CpuSet::new();
    for core in cores {
        set.set(*core);
    }
    sched_setaffinity(None, &set).map_err(Failure::failed)
}
