//! Messages of a topic that wait to be put.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::TypedTopic;
use crate::Sent;

/// The most messages that wait, if they are small; one on top costs the oldest.
const MOST: usize = 64;
/// The most bytes that wait, beside the newest message.
const MOST_BYTES: usize = 4 << 20;

/// Messages of a topic that wait to be put.
pub struct Outbox {
    pub topic: TypedTopic,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Vec<u8>>,
    bytes: usize,
    sent: Sent,
    has_listener: bool,
}

impl State {
    fn is_over(&self) -> bool {
        self.waiting.len() > 1 && (self.waiting.len() > MOST || self.bytes > MOST_BYTES)
    }

    fn pop(&mut self) -> Option<Vec<u8>> {
        let oldest = self.waiting.pop_front()?;
        self.bytes -= oldest.len();
        Some(oldest)
    }
}

impl Outbox {
    /// Of a topic.
    pub fn new(topic: TypedTopic) -> Self {
        Self { topic, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets a message wait. `None` is one that could not be made.
    pub fn offer(&self, message: Option<Vec<u8>>) {
        let mut state = self.state();
        state.sent.offered += 1;
        match message {
            None => {
                state.sent.put += 1;
                state.sent.refused += 1;
            }
            Some(_) if !state.has_listener => state.sent.unheard += 1,
            Some(message) => {
                state.bytes += message.len();
                state.waiting.push_back(message);
                while state.is_over() {
                    state.pop();
                    state.sent.replaced += 1;
                }
            }
        }
    }

    /// States whether somebody takes the topic. What waits for nobody is dropped: it would come as a flood later.
    pub fn set_has_listener(&self, has_listener: bool) {
        let mut state = self.state();
        if !has_listener {
            state.sent.unheard += state.waiting.len() as u64;
            state.waiting.clear();
            state.bytes = 0;
        }
        state.has_listener = has_listener;
    }

    /// Whether somebody takes the topic.
    pub fn has_listener(&self) -> bool {
        self.state().has_listener
    }

    /// The oldest message that waits, to be put.
    pub fn next(&self) -> Option<Vec<u8>> {
        let mut state = self.state();
        let next = state.pop()?;
        state.sent.put += 1;
        // Those who take it tell nobody: what was put counts as received.
        state.sent.received += 1;
        Some(next)
    }

    /// Its account.
    pub fn sent(&self) -> Sent {
        let state = self.state();
        Sent { waiting: state.waiting.len() as u64, ..state.sent }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn outbox() -> Outbox {
        Outbox::new(TypedTopic::new("/a", ("a/msg/A", "uint8 a\n")).unwrap())
    }

    #[test]
    fn every_message_is_in_one_count() {
        let outbox = outbox();
        outbox.offer(Some(vec![1]));
        outbox.set_has_listener(true);
        outbox.offer(None);
        (0..70).for_each(|n| outbox.offer(Some(vec![n])));
        // The newest 64 wait.
        assert_eq!(outbox.next(), Some(vec![6]));
        let sent = outbox.sent();
        assert_eq!((sent.offered, sent.replaced, sent.unheard, sent.put, sent.waiting), (72, 6, 1, 2, 63));
        assert_eq!((sent.received, sent.refused), (1, 1));
        outbox.set_has_listener(false);
        let sent = outbox.sent();
        assert_eq!(sent.offered, sent.replaced + sent.unheard + sent.put + sent.waiting);
        assert_eq!((sent.unheard, sent.waiting), (64, 0));
    }

    #[test]
    fn long_messages_wait_within_a_bound_of_bytes_and_the_newest_always_does() {
        let outbox = outbox();
        outbox.set_has_listener(true);
        (0..9).for_each(|_| outbox.offer(Some(vec![0; 1 << 20])));
        assert_eq!((outbox.sent().waiting, outbox.sent().replaced), (4, 5));
        outbox.offer(Some(vec![0; 9 << 20]));
        assert_eq!((outbox.sent().waiting, outbox.sent().replaced), (1, 9));
    }
}
