//! A call that is open, and an answer that was accepted.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::call::Kind;
use crate::fetch::Fetch;

/// A call without an accepted answer.
pub(super) struct Open {
    pub bytes: Vec<u8>,
    pub kind: Kind,
    /// Answers that are compared before one is accepted.
    pub compare: bool,
    /// When it was submitted.
    pub since: u64,
    /// When a worker last showed that it works on the call.
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
    /// Expects nothing of a worker any more.
    pub fn forget(&mut self, name: &str) {
        self.asked.remove(name);
        self.fetches.remove(name);
    }
}
