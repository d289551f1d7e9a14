//! A call that is open, and an answer that was accepted.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::Hash;
use crate::call::Kind;
use crate::fetch::Fetch;

/// Times of patience after which a call is computed by this process, even if a worker says that it works on it.
const MOST_PATIENCE: u64 = 10;

/// A call without an accepted answer.
pub(super) struct Open {
    pub bytes: Vec<u8>,
    pub kind: Kind,
    /// Contents that it needs.
    pub inputs: Vec<Hash>,
    /// Answers that are compared before one is accepted.
    pub compare: bool,
    /// When a worker was first asked.
    pub begun: Option<u64>,
    /// When it was submitted, a worker was first asked, or one last showed that it works on the call.
    pub progress: u64,
    pub asked: BTreeMap<String, Asked>,
    pub answers: Vec<(String, Arc<Vec<u8>>)>,
    pub fetches: BTreeMap<String, Fetch>,
    pub failed: BTreeSet<String>,
    /// This process computes it.
    pub inside: bool,
}

/// When a worker was asked, first and last.
pub(super) struct Asked {
    pub first: u64,
    pub last: u64,
    /// Bytes of its answer, which it reported before the answer.
    pub length: Option<u64>,
    /// It has no slot for the call yet: it fetches what the call needs, and computes it after another one.
    pub is_ahead: bool,
}

/// An answer that was given to the caller.
pub(super) struct Accepted {
    pub bytes: Option<Arc<Vec<u8>>>,
    /// The worker, unless the answer was compared or computed here.
    pub unproved: Option<String>,
}

impl Open {
    /// Whether this process is to wait no longer. `progress`: when a worker last showed that it works on any call;
    /// `answered`: when one last gave an answer.
    pub fn is_impatient(&self, now: u64, patience: u64, progress: u64, answered: u64) -> bool {
        // A call that nobody has yet waits as long as workers work on others.
        let sign = if self.asked.is_empty() { self.progress.max(progress) } else { self.progress };
        let begun = self.begun.unwrap_or(self.progress.max(answered));
        now.saturating_sub(sign) >= patience
            || now.saturating_sub(begun) >= MOST_PATIENCE.saturating_mul(patience)
    }

    /// Expects nothing of a worker any more.
    pub fn forget(&mut self, name: &str) {
        self.asked.remove(name);
        self.fetches.remove(name);
    }
}
