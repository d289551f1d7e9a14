//! The reservation of shared memory. A write beyond the end of `/dev/shm` would be a SIGBUS, so a run begins only where
//! `/dev/shm` has room for the most that the run can take.
//!
//! The system hands out memory page by page as samples are written, so the memory of a young run looks free. Therefore each
//! run notes in its folder how much it may take, and a new run counts the notes of the others. It cannot see runs of other
//! users.

use std::fs::OpenOptions;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};

use rustix::fs::{FlockOperation, flock};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use stillpoint_shm::Contract;

use super::contracts;
use super::run_folder::{RunFolder, RunFolderError, others_alive, prefix_of};
use crate::graph::Graph;

/// The folder of shared memory.
const SHARED: &str = "/dev/shm";
/// In the folder of a run: bytes that it may take.
const ROOM: &str = "room";
/// In the folder of all runs: held by the run that looks for room.
const LOCK: &str = ".room";

/// Of the room that is left beside what the topics need: 1 of so many parts may hold what publishers keep.
const RETAINED_PART: u64 = 2;

/// Bytes that iceoryx2 adds to the memory of a topic, at most.
const OWN_BYTES: u64 = 1 << 16;

/// Files that a process of a run may have open at once: some of its own, and so many for each topic.
const OWN_FILES: u64 = 24;
const FILES_OF_A_TOPIC: u64 = 9;
/// Files that a process may commonly open: fewer are looked into.
const FEW_FILES: u64 = 1024;

/// Why a run gets no room.
#[derive(Debug, thiserror::Error)]
pub enum ReserveError {
    /// The folder of a run.
    #[error(transparent)]
    Folder(#[from] RunFolderError),
    /// The lock or the note of what a run may take.
    #[error("room for the run cannot be reserved in its folder: {0}")]
    Note(std::io::Error),
    /// Fewer files may be open than a process needs.
    #[error(
        "a process of the pipeline may have {needed} files open at once, and {allowed} are allowed: say \
         `ulimit -n {FEW_FILES}`, or raise the limit of the service that starts it (`LimitNOFILE`)"
    )]
    Files {
        /// Files that a process may have open.
        needed: u64,
        /// The limit.
        allowed: u64,
    },
    /// The memory of a topic is a file, and such a file would be too large.
    #[error(
        "the shared memory of {topic} is a file of {} MiB, and a file may have at most {allowed} bytes here: say \
         `ulimit -f unlimited`, or raise the limit of the service that starts the run (`LimitFSIZE`)", mib(*needed)
    )]
    FileSize {
        /// Name of the largest topic.
        topic: String,
        /// Bytes that its memory may take.
        needed: u64,
        /// The limit.
        allowed: u64,
    },
    /// The limit of open files cannot be raised.
    #[error("{limit} ({reason})")]
    Limit {
        /// What the limit is, and what is needed.
        limit: Box<ReserveError>,
        /// What the system says.
        reason: rustix::io::Errno,
    },
    /// Shared memory is too small.
    #[error(
        "the pipeline's topics may take {} MiB of shared memory, and {SHARED} has {} MiB free{}: {}make {SHARED} \
         larger or lower the capacities (the largest topic is {largest})",
        mib(*needed), mib(*free), others(*promised), if *promised > 0 { "end another run, " } else { "" }
    )]
    TooSmall {
        /// Bytes that the topics may take.
        needed: u64,
        /// Bytes that other runs may still take.
        promised: u64,
        /// Bytes that are free.
        free: u64,
        /// Name of the largest topic.
        largest: String,
    },
}

fn mib(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}

fn others(promised: u64) -> String {
    match promised {
        0 => String::new(),
        _ => format!(", of which other runs that are going on may still take {} MiB", mib(promised)),
    }
}

/// What the publishers of a run keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Retention {
    /// Nothing: the run is not recorded.
    Nothing,
    /// The newest samples of journals and recorded topics, for a recorder that is started again.
    Newest,
}

/// Reserves the memory that the topics of a graph may take, and gives their contracts. Where shared memory is small, the
/// publishers keep less, and the run begins nevertheless.
pub fn reserve(
    graph: &Graph,
    retained: Retention,
    folder: &RunFolder,
) -> Result<Vec<Contract>, ReserveError> {
    let plain = contracts::all(graph);
    allow_files(plain.len() as u64)?;
    let needed = bytes_of(&plain);
    let lock = folder.path().with_file_name(LOCK);
    let lock = OpenOptions::new()
        .create(true)
        .truncate(false)
        .write(true)
        .mode(0o600)
        .open(lock)
        .map_err(ReserveError::Note)?;
    // Two runs that look at the same time would both find the same room. The lock ends with this function.
    flock(&lock, FlockOperation::LockExclusive).map_err(|e| ReserveError::Note(e.into()))?;
    let promised: u64 = others_alive(folder)?
        .iter()
        .map(|(path, id)| {
            let message = std::fs::read_to_string(path.join(ROOM)).ok().and_then(|text| text.parse().ok());
            message.unwrap_or(0_u64).saturating_sub(taken(&prefix_of(id)))
        })
        .sum();
    let mut left = u64::MAX;
    if let Ok(room) = rustix::fs::statvfs(SHARED) {
        let free = room.f_bavail.saturating_mul(room.f_frsize);
        let taken = needed.saturating_add(promised);
        left = free.checked_sub(taken).ok_or_else(|| too_small(&plain, needed, promised, free))?;
    }
    let topics = match retained {
        Retention::Nothing => plain,
        Retention::Newest => contracts::all_recorded(graph, left / RETAINED_PART),
    };
    check_file_size(&topics, getrlimit(Resource::Fsize).current)?;
    std::fs::write(folder.path().join(ROOM), bytes_of(&topics).to_string()).map_err(ReserveError::Note)?;
    Ok(topics)
}

fn bytes_of(topics: &[Contract]) -> u64 {
    topics.iter().map(|c| c.pool_bytes() as u64).sum()
}

/// Bytes of shared memory that a run has taken.
fn taken(prefix: &str) -> u64 {
    let Ok(entries) = std::fs::read_dir(SHARED) else { return 0 };
    let own = entries.flatten().filter(|e| e.file_name().to_string_lossy().starts_with(prefix));
    own.filter_map(|e| Some(e.metadata().ok()?.blocks() * 512)).sum()
}

/// Has this process, and those that it starts, open as many files as they need, as far as the system lets it.
fn allow_files(topics: u64) -> Result<(), ReserveError> {
    let limit = getrlimit(Resource::Nofile);
    let Some(reason) = too_few_files(topics, limit.current) else { return Ok(()) };
    let raised = Rlimit { current: limit.maximum, maximum: limit.maximum };
    if too_few_files(topics, raised.current).is_some() {
        return Err(reason);
    }
    setrlimit(Resource::Nofile, raised)
        .map_err(|e| ReserveError::Limit { limit: Box::new(reason), reason: e })
}

/// A process that can open no more files receives no samples: the run would go on and do nothing.
fn too_few_files(topics: u64, limit: Option<u64>) -> Option<ReserveError> {
    let needed = OWN_FILES + FILES_OF_A_TOPIC * topics;
    let allowed = limit.filter(|limit| *limit < FEW_FILES && *limit < needed)?;
    Some(ReserveError::Files { needed, allowed })
}

/// Memory that cannot grow to its size ends the process that makes it, or fails without a reason.
fn check_file_size(topics: &[Contract], allowed: Option<u64>) -> Result<(), ReserveError> {
    let largest = topics.iter().max_by_key(|c| c.pool_bytes());
    let (Some(largest), Some(allowed)) = (largest, allowed) else { return Ok(()) };
    let needed = largest.pool_bytes() as u64 + OWN_BYTES;
    if needed <= allowed {
        return Ok(());
    }
    Err(ReserveError::FileSize { topic: largest.topic.clone(), needed, allowed })
}

/// Whether shared memory is full, or as good as full.
pub fn is_full() -> bool {
    rustix::fs::statvfs(SHARED).is_ok_and(|room| room.f_bavail.saturating_mul(room.f_frsize) < 1 << 20)
}

fn too_small(topics: &[Contract], needed: u64, promised: u64, free: u64) -> ReserveError {
    let largest = topics.iter().max_by_key(|c| c.pool_bytes()).map_or("", |c| c.topic.as_str());
    ReserveError::TooSmall { needed, promised, free, largest: largest.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_files_are_refused_with_what_to_say() {
        let message = too_few_files(6, Some(60)).unwrap().to_string();
        assert!(
            message.contains("78 files open at once, and 60 are allowed: say `ulimit -n 1024`"),
            "{message}"
        );
        for limit in [Some(78), Some(1024), None] {
            assert!(too_few_files(6, limit).is_none());
        }
        assert!(too_few_files(1000, Some(1024)).is_none(), "what is common is not refused by a guess");
    }
}
