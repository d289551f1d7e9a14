//! What reaches sources from outside the pipeline while a live run goes on.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use stillpoint_samples::Command;

/// Datagrams that may wait for their operator; a burst beyond them costs the oldest.
pub const MOST_DATAGRAMS: usize = 256;
/// Datagrams of one sender that may wait; more cost its own oldest, so that who floods pushes out nobody else.
pub const MOST_FROM_ONE: usize = 16;

/// What reaches an operator from outside.
#[derive(Clone, Default)]
pub struct Outside {
    /// Commands of people, for a console.
    pub inbox: Inbox,
    /// Datagrams or samples from other processes and machines, for the far end of a link; `None` where nothing comes over
    /// a wire.
    pub arrivals: Option<Arrivals>,
}

/// Commands that arrived from people and were not sent on yet. Executors fill it; only a console takes from it.
#[derive(Clone, Default)]
pub struct Inbox(Arc<Mutex<VecDeque<Command>>>);

impl Inbox {
    /// Adds a command.
    pub fn put(&self, command: Command) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push_back(command);
    }

    /// The oldest command.
    pub fn take(&self) -> Option<Command> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }
}

/// Datagrams or samples that arrived and were not taken yet.
#[derive(Clone)]
pub struct Arrivals {
    waiting: Arc<Mutex<Waiting>>,
    most: usize,
}

#[derive(Default)]
struct Waiting {
    /// Who sent each is known for datagrams.
    datagrams: VecDeque<(Option<SocketAddr>, Vec<u8>)>,
    /// Buffers to be used again.
    spare: Vec<Vec<u8>>,
    dropped: u64,
}

impl Arrivals {
    /// Room for so many; what comes on top costs the oldest.
    pub fn at_most(most: usize) -> Self {
        Self { waiting: Arc::default(), most }
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds one.
    pub fn put(&self, bytes: &[u8]) {
        self.add(None, bytes);
    }

    /// Adds one of this sender.
    pub fn put_from(&self, sender: SocketAddr, bytes: &[u8]) {
        self.add(Some(sender), bytes);
    }

    fn add(&self, sender: Option<SocketAddr>, bytes: &[u8]) {
        let mut waiting = self.waiting();
        let of_sender = |waiting: &Waiting| waiting.datagrams.iter().filter(|(s, _)| *s == sender).count();
        let too_many = sender.is_some() && of_sender(&waiting) >= MOST_FROM_ONE;
        let oldest = match too_many {
            true => waiting.datagrams.iter().position(|(s, _)| *s == sender),
            false => (waiting.datagrams.len() >= self.most).then_some(0),
        };
        let mut buffer = match oldest.and_then(|oldest| waiting.datagrams.remove(oldest)) {
            Some((_, buffer)) => {
                waiting.dropped += 1;
                buffer
            }
            None => waiting.spare.pop().unwrap_or_default(),
        };
        buffer.clear();
        buffer.extend_from_slice(bytes);
        waiting.datagrams.push_back((sender, buffer));
    }

    /// The oldest.
    pub fn take(&self) -> Option<Vec<u8>> {
        self.waiting().datagrams.pop_front().map(|(_, buffer)| buffer)
    }

    /// Gives a buffer back.
    pub fn give_back(&self, buffer: Vec<u8>) {
        self.waiting().spare.push(buffer);
    }

    /// How many went because too many waited, since the last call.
    pub fn dropped(&self) -> u64 {
        std::mem::take(&mut self.waiting().dropped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_floods_pushes_out_nobody_else() {
        let arrivals = Arrivals::at_most(MOST_DATAGRAMS);
        let address = |port: u16| SocketAddr::from(([127, 0, 0, 1], port));
        arrivals.put_from(address(1), b"order 1");
        (0..1000_u32).for_each(|i| arrivals.put_from(address(2), &i.to_le_bytes()));
        arrivals.put_from(address(1), b"order 2");
        assert_eq!(arrivals.dropped(), 1000 - MOST_FROM_ONE as u64);
        let taken: Vec<Vec<u8>> = std::iter::from_fn(|| arrivals.take()).collect();
        assert_eq!((taken.len(), &taken[0][..]), (MOST_FROM_ONE + 2, &b"order 1"[..]));
        // What is left of the flood is its newest.
        assert_eq!(taken[1], (1000 - MOST_FROM_ONE as u32).to_le_bytes());
        assert_eq!(taken[MOST_FROM_ONE + 1], b"order 2");
    }

    #[test]
    fn a_burst_costs_the_oldest_and_says_how_many() {
        let arrivals = Arrivals::at_most(256);
        for i in 0..259_u32 {
            arrivals.put(&i.to_le_bytes());
        }
        assert_eq!(arrivals.dropped(), 3);
        assert_eq!(arrivals.dropped(), 0);
        assert_eq!(arrivals.take().unwrap(), 3_u32.to_le_bytes());
    }
}
