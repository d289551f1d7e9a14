//! What viewers ask for: the topics to which they subscribe, and the time of a session.

use std::collections::BTreeMap;
use std::io::Write;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use foxglove::websocket::{ChannelView, Client, PlaybackControlRequest, PlaybackState, ServerListener};
use stillpoint_viewer::{Asked, Topic, ask};

use super::clock::Clock;

/// What viewers ask for.
pub struct Listener {
    asks: Mutex<Box<dyn Write + Send>>,
    /// How many subscriptions each topic has.
    topics: Mutex<BTreeMap<Topic, usize>>,
    clock: Option<Mutex<Clock>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Listener {
    /// Of a run, or of a session with its clock.
    pub fn new(asks: Box<dyn Write + Send>, clock: Option<Clock>) -> Self {
        Self { asks: Mutex::new(asks), topics: Mutex::default(), clock: clock.map(Mutex::new) }
    }

    /// Hands over what is asked. If the other program is gone, this one ends by the end of its input.
    pub fn ask(&self, asked: &Asked) {
        let _ = ask(&mut *lock(&self.asks), asked);
    }

    /// Whether a session is shown.
    pub fn has_clock(&self) -> bool {
        self.clock.is_some()
    }

    /// What the clock asked for is shown: the time.
    pub fn played(&self) -> Option<u64> {
        let mut clock = lock(self.clock.as_ref()?);
        clock.played();
        Some(clock.now())
    }

    /// Lets the clock go on, if somebody looks. Gives its state where viewers do not know it.
    pub fn tick(&self, passed: Duration) -> Option<PlaybackState> {
        let is_seen = !lock(&self.topics).is_empty();
        let mut clock = lock(self.clock.as_ref()?);
        let asked = is_seen.then(|| clock.tick(passed)).flatten();
        let state = clock.changed();
        drop(clock);
        if let Some(asked) = asked {
            self.ask(&asked);
        }
        state
    }

    fn count(&self, channel: &ChannelView<'_>, change: fn(usize) -> usize) {
        let Some(topic) = Topic::named(channel.topic()) else { return };
        let mut topics = lock(&self.topics);
        let count = change(topics.remove(&topic).unwrap_or(0));
        if count > 0 {
            topics.insert(topic, count);
        }
        // Under the lock: the last line that is written is of the last change.
        self.ask(&Asked::Topics(topics.keys().copied().collect()));
    }
}

impl ServerListener for Listener {
    fn on_subscribe(&self, _client: Client, channel: ChannelView<'_>) {
        self.count(&channel, |count| count + 1);
        if let Some(clock) = &self.clock {
            lock(clock).repeat_now();
        }
    }

    fn on_unsubscribe(&self, _client: Client, channel: ChannelView<'_>) {
        self.count(&channel, |count| count.saturating_sub(1));
    }

    fn on_playback_control_request(&self, request: PlaybackControlRequest) -> Option<PlaybackState> {
        Some(lock(self.clock.as_ref()?).control(&request))
    }
}
