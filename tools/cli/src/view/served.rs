//! What clients get. One thread puts it there, and never waits for a client: a client takes the newest when it asks.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::past::Past;
use super::picture::Picture;
use super::rows::Row;
use super::scene::Camera;

/// Rows that are retained of a run: at ten a second, of ten minutes.
const MOST_ROWS: usize = 6000;
/// For this time after a client asked for images they are copied.
const REQUESTED: Duration = Duration::from_secs(3);

/// What is served.
#[derive(Default)]
pub struct Served {
    /// What does not change, as JSON.
    pub about: Value,
    /// The camera, if there is one.
    pub camera: Option<Camera>,
    /// Session time of `t = 0`, ns.
    pub base: u64,
    /// The session that is shown; none of a run.
    pub past: Option<Past>,
    pub(super) now: Mutex<Now>,
    pub(super) changed: Condvar,
}

/// The newest state.
#[derive(Default)]
pub struct Now {
    /// Number of the state, from 1.
    pub number: u64,
    /// The state as JSON.
    pub state: Arc<str>,
    /// The graph as SVG.
    pub graph: Arc<str>,
    /// Whether the run is over.
    pub is_over: bool,
    rows: VecDeque<Row>,
    /// Number of the first of the rows.
    first: u64,
    /// The newest image, with its number from 1.
    picture: (u64, Option<Arc<Picture>>),
    asked: Option<Instant>,
}

impl Now {
    /// The rows from this number on, and the number of the next one.
    pub fn rows_from(&self, from: u64) -> (Vec<Row>, u64) {
        let skip = from.saturating_sub(self.first) as usize;
        (self.rows.iter().skip(skip).cloned().collect(), self.first + self.rows.len() as u64)
    }
}

impl Served {
    /// The newest state. A client that fell under the lock leaves it as it was.
    pub fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts the state of a time.
    pub fn put(&self, state: String, graph: String) {
        let mut now = self.now();
        now.number += 1;
        (now.state, now.graph) = (state.into(), graph.into());
        self.changed.notify_all();
    }

    /// Adds rows.
    pub fn add(&self, rows: Vec<Row>) {
        if rows.is_empty() {
            return;
        }
        let mut now = self.now();
        now.rows.extend(rows);
        while self.past.is_none() && now.rows.len() > MOST_ROWS {
            now.rows.pop_front();
            now.first += 1;
        }
        self.changed.notify_all();
    }

    /// Puts the newest image.
    pub fn show(&self, picture: Picture) {
        let mut now = self.now();
        now.picture = (now.picture.0 + 1, Some(Arc::new(picture)));
        self.changed.notify_all();
    }

    /// Says that the run is over.
    pub fn end(&self) {
        self.now().is_over = true;
        self.changed.notify_all();
    }

    /// Whether a client asked for images lately.
    pub fn shows_images(&self) -> bool {
        self.now().asked.is_some_and(|asked| asked.elapsed() < REQUESTED)
    }

    /// The newest image after that of a number, if it comes within a time.
    pub fn picture_after(&self, number: u64, within: Duration) -> Option<(u64, Arc<Picture>)> {
        let begun = Instant::now();
        let mut now = self.now();
        loop {
            now.asked = Some(Instant::now());
            if now.picture.0 > number
                && let Some(picture) = &now.picture.1
            {
                return Some((now.picture.0, picture.clone()));
            }
            let left = within.checked_sub(begun.elapsed()).filter(|_| !now.is_over)?;
            now = self.changed.wait_timeout(now, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Waits for a state or rows beyond these numbers, for a time at most.
    pub fn wait(&self, number: u64, rows: u64, within: Duration) -> MutexGuard<'_, Now> {
        let now = self.now();
        let is_old =
            |now: &mut Now| now.number == number && now.first + now.rows.len() as u64 == rows && !now.is_over;
        let waited = self.changed.wait_timeout_while(now, within, is_old);
        waited.unwrap_or_else(PoisonError::into_inner).0
    }
}
