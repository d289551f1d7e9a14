//! The thread that writes: a slow disk keeps nobody from taking samples out of shared memory.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crossbeam_channel::Receiver;
use stillpoint_recorder::{ClockSample, Encoded, PartWriter, TopicId, WriteError};

use super::flushed::Flushed;
use crate::clock::{SessionClock, realtime};

/// How often the file is flushed, ns: what is flushed survives a kill.
const FLUSH_EVERY: u64 = 250_000_000;
/// How often the clock's relation to realtime is noted, ns.
const CLOCK_EVERY: u64 = 10_000_000_000;
/// Buffers of a topic that are kept to be used again. They stay with their topic: a short sample must not hold the memory
/// of a long one.
const SPARE: usize = 8;

/// Buffers that were written. The last one back is the first to go out again: it is the one in the caches, and those that
/// nobody needs are never touched.
#[derive(Clone, Default)]
pub struct Spare(Arc<Mutex<Vec<Vec<u8>>>>);

impl Spare {
    pub fn take(&self) -> Vec<u8> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    pub fn put(&self, buffer: Vec<u8>) {
        let mut retained = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if retained.len() < SPARE {
            retained.push(buffer);
        }
    }
}

/// What the writing thread is given.
pub enum Item {
    /// A sample, laid out as its message.
    Sample { topic: TopicId, sample: Encoded, size: usize, log_time: u64, spare: Spare },
    /// Samples that could not be kept.
    Lost { topic: TopicId, incarnation: u32, first: u64, count: u64 },
}

/// A part that is written and not ended yet.
pub struct Written {
    pub part: PartWriter<std::fs::File>,
    pub samples: u64,
    pub bytes: u64,
}

/// The body of the writing thread: writes what comes until nobody sends any more.
pub fn write(
    mut part: PartWriter<std::fs::File>,
    inbox: &Receiver<Vec<Item>>,
    waiting: &AtomicUsize,
    clock: SessionClock,
    mut numbers: Flushed,
) -> Result<Written, WriteError> {
    let (mut samples, mut bytes) = (0, 0);
    let (mut flushed, mut related) = (clock.now(), clock.now());
    let mut dirty = false;
    loop {
        let items = match inbox.recv_timeout(std::time::Duration::from_nanos(FLUSH_EVERY / 2)) {
            Ok(items) => items,
            Err(crossbeam_channel::RecvTimeoutError::Timeout) => Vec::new(),
            Err(crossbeam_channel::RecvTimeoutError::Disconnected) => {
                return Ok(Written { part, samples, bytes });
            }
        };
        dirty |= !items.is_empty();
        for item in items {
            match item {
                Item::Sample { topic, sample, size, log_time, spare } => {
                    part.write_encoded(topic, &sample, log_time)?;
                    let (incarnation, sequence) = sample.number();
                    numbers.note(topic, incarnation, sequence.saturating_add(1));
                    samples += 1;
                    bytes += size as u64;
                    waiting.fetch_sub(size, Ordering::Relaxed);
                    spare.put(sample.into_buffer());
                }
                Item::Lost { topic, incarnation, first, count } => {
                    part.note_lost(topic, incarnation, first, count, realtime())?;
                    numbers.note(topic, incarnation, first.saturating_add(count));
                }
            }
        }
        let now = clock.now();
        if now - related >= CLOCK_EVERY {
            related = now;
            part.clock(ClockSample { logical_ns: now, realtime_ns: realtime() })?;
            dirty = true;
        }
        if dirty && now - flushed >= FLUSH_EVERY {
            flushed = now;
            dirty = false;
            part.flush()?;
            numbers.store();
        }
    }
}
