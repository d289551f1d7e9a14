//! The thread that puts: one per zenoh session.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use crate::sender::Outgoing;

/// The longest sample of the small lane, bytes.
const SMALL: usize = 16 * 1024;
/// How often a lane looks for what it was not told of: an acknowledgement that is overdue.
const LOOK: Duration = Duration::from_millis(50);

/// One of the two sessions of a host: each has a connection of its own, so that bulk does not hold up small samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lane {
    /// Small samples and beats.
    Small,
    /// All longer samples.
    Bulk,
}

impl Lane {
    /// The lane of samples that are at most this long.
    pub fn of(longest: usize) -> Self {
        if longest <= SMALL { Self::Small } else { Self::Bulk }
    }
}

/// What the thread of a lane shares with the senders.
#[derive(Default)]
pub struct LaneShared {
    state: Mutex<LaneState>,
    signal: Condvar,
}

#[derive(Default)]
struct LaneState {
    outgoing: Vec<Weak<Outgoing>>,
    has_news: bool,
    is_closed: bool,
}

impl LaneShared {
    fn state(&self) -> MutexGuard<'_, LaneState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a sender.
    pub fn add(&self, outgoing: &Arc<Outgoing>) {
        self.state().outgoing.push(Arc::downgrade(outgoing));
    }

    /// There may be something to put.
    pub fn wake(&self) {
        self.state().has_news = true;
        self.signal.notify_one();
    }

    /// Ends the thread.
    pub fn close(&self) {
        self.state().is_closed = true;
        self.signal.notify_one();
    }

    /// The body of the thread: it takes a sample of each sender in turn.
    pub fn run(&self) {
        loop {
            let mut state = self.state();
            if !state.has_news && !state.is_closed {
                state = self.signal.wait_timeout(state, LOOK).unwrap_or_else(PoisonError::into_inner).0;
            }
            if state.is_closed {
                return;
            }
            state.has_news = false;
            state.outgoing.retain(|o| o.strong_count() > 0);
            let outgoing: Vec<Arc<Outgoing>> = state.outgoing.iter().filter_map(Weak::upgrade).collect();
            drop(state);
            loop {
                let put = outgoing.iter().filter(|o| o.put_next()).count();
                if put == 0 || self.state().is_closed {
                    break;
                }
            }
        }
    }
}
