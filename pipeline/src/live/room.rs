//! Room in shared memory. A write beyond the end of `/dev/shm` would be a SIGBUS, so a run begins only where all that it
//! may ever take is there.
//!
//! Memory is taken page by page as samples are written: for a while after a run began it looks free. So each run says in
//! its folder how much it may take, and leaves to the others what they said and have not taken yet. Runs of other users
//! cannot be seen.

use std::fs::OpenOptions;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};

use rustix::fs::{FlockOperation, flock};
use stillpoint_shm::Contract;

use super::contracts;
use super::run_folder::{RunFolder, others_going_on, prefix_of};
use crate::graph::Graph;

/// Where shared memory is.
const SHARED: &str = "/dev/shm";
/// In the folder of a run: bytes that it may take.
const ROOM: &str = "room";
/// In the folder of all runs: held by the run that looks for room.
const LOCK: &str = ".room";

/// Reserves what the topics of a graph may take, or says what is missing.
pub fn reserve(graph: &Graph, folder: &RunFolder) -> Result<(), String> {
    let topics = contracts::all(graph);
    let needed: u64 = topics.iter().map(|c| c.pool_bytes() as u64).sum();
    let say = |e: std::io::Error| format!("room for the run cannot be reserved in its folder: {e}");
    let lock = folder.path().with_file_name(LOCK);
    let lock =
        OpenOptions::new().create(true).truncate(false).write(true).mode(0o600).open(lock).map_err(say)?;
    // Two runs that look at the same time would both find the same room. The lock ends with this function.
    flock(&lock, FlockOperation::LockExclusive).map_err(|e| say(e.into()))?;
    let promised: u64 = others_going_on(folder)?
        .iter()
        .map(|(path, id)| {
            let said = std::fs::read_to_string(path.join(ROOM)).ok().and_then(|text| text.parse().ok());
            said.unwrap_or(0_u64).saturating_sub(taken(&prefix_of(id)))
        })
        .sum();
    if let Ok(room) = rustix::fs::statvfs(SHARED) {
        let free = room.f_bavail.saturating_mul(room.f_frsize);
        if needed.saturating_add(promised) > free {
            return Err(too_small(&topics, needed, promised, free));
        }
    }
    std::fs::write(folder.path().join(ROOM), needed.to_string()).map_err(say)
}

/// Bytes of shared memory that a run has taken.
fn taken(prefix: &str) -> u64 {
    let Ok(entries) = std::fs::read_dir(SHARED) else { return 0 };
    let own = entries.flatten().filter(|e| e.file_name().to_string_lossy().starts_with(prefix));
    own.filter_map(|e| Some(e.metadata().ok()?.blocks() * 512)).sum()
}

fn too_small(topics: &[Contract], needed: u64, promised: u64, free: u64) -> String {
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    let largest = topics.iter().max_by_key(|c| c.pool_bytes()).map_or("", |c| c.topic.as_str());
    let others = match promised {
        0 => String::new(),
        _ => format!(", of which other runs that are going on may still take {} MiB", mib(promised)),
    };
    let end = if promised > 0 { "end another run, " } else { "" };
    format!(
        "the pipeline's topics may take {} MiB of shared memory, and {SHARED} has {} MiB free{others}: {end}make {SHARED} \
         larger or lower the capacities (the largest topic is {largest})",
        mib(needed),
        mib(free)
    )
}
