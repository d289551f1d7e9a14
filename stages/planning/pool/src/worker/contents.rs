//! The contents that calls need: fetched from who asks or from another worker, and given to others.
//!
//! Who asks may name another worker that holds a content. What comes from there is checked like all that comes: by the
//! checksum of each part and by the name of the whole. If it does not come, or is something else, it is fetched from who
//! asks.

use std::collections::BTreeSet;

use super::{Waiting, Worker, by_haste};
use crate::fetch::{Fetch, FetchError};
use crate::message::{Message, PART};
use crate::{Hash, StoreError, To};

/// Times that a part is asked for at another worker.
const TRIES_ELSEWHERE: u32 = 2;

/// A content on its way.
pub(super) struct Fetching {
    /// Who gives it.
    from: String,
    /// Who asks for a call that needs it.
    asker: String,
    /// Only who asks is to give it: another worker did not.
    only: bool,
    fetch: Fetch,
}

impl Fetching {
    fn from_asker(asker: String, (content, most): (Hash, u64), only: bool) -> Self {
        Self { from: asker.clone(), asker, only, fetch: Fetch::new(content).at_most(most) }
    }

    fn is_elsewhere(&self) -> bool {
        self.from != self.asker
    }
}

impl Worker {
    pub(super) fn give(&mut self, from: &str, content: Hash, part: u32) {
        let start = u64::from(part) * PART as u64;
        let message = match self.store.part(&content, start, PART) {
            Some((length, bytes)) => Message::Part { content, part, length, bytes },
            None => Message::Absent { content },
        };
        self.out.push((To::one(from), message));
    }

    pub(super) fn take_part(&mut self, from: &str, content: Hash, part: u32, length: u64, bytes: Vec<u8>) {
        let is_awaited = |f: &&mut Fetching| f.from == from && f.fetch.content() == content;
        let Some(fetching) = self.fetch.as_mut().filter(is_awaited) else { return };
        match fetching.fetch.take(part, length, bytes) {
            Ok(None) => {}
            Ok(Some(whole)) => {
                self.fetch = None;
                match self.store.put_named(content, &whole, &self.requested()) {
                    Ok(()) => self.report_held(content),
                    Err(error) => self.fail_calls_of(&content, &error.to_string()),
                }
            }
            Err(FetchError::Long(..)) if !fetching.is_elsewhere() => {
                self.fetch = None;
                let reason = StoreError::Full { most: self.store.size().1 }.to_string();
                self.fail_calls_of(&content, &reason);
            }
            Err(e) => self.not_given(&e),
        }
    }

    /// Who should give a content does not hold it.
    pub(super) fn miss(&mut self, from: &str, content: Hash) {
        let is_awaited = |f: &&Fetching| f.from == from && f.fetch.content() == content;
        let Some(fetching) = self.fetch.as_ref().filter(is_awaited) else { return };
        match fetching.is_elsewhere() {
            true => self.ask_the_asker(),
            false => self.not_to_be_had(&format!("`{from}` does not hold {content:.16}")),
        }
    }

    /// Who asks names another worker that holds a content.
    pub(super) fn turn_to(&mut self, from: &str, content: Hash, peer: String) {
        let is_awaited =
            |f: &&mut Fetching| f.from == from && f.asker == from && f.fetch.content() == content;
        let Some(fetching) = self.fetch.as_mut().filter(is_awaited) else { return };
        if self.doubtful.contains(&peer) {
            return self.ask_the_asker();
        }
        let fetch = Fetch::new(content).at_most(self.store.size().1);
        (fetching.from, fetching.fetch) = (peer, fetch.with_tries(TRIES_ELSEWHERE));
    }

    /// Parts of a content do not come, or are wrong.
    fn not_given(&mut self, error: &FetchError) {
        let Some(fetching) = self.fetch.as_ref().filter(|f| f.is_elsewhere()) else {
            return self.not_to_be_had(&error.to_string());
        };
        // A content may be longer than the cache of this worker.
        if !matches!(error, FetchError::Silent(..) | FetchError::Long(..)) {
            let (content, peer) = (fetching.fetch.content(), fetching.from.clone());
            self.out.push((To::one(&fetching.asker), Message::Wrong { content, peer: peer.clone() }));
            self.doubtful.insert(peer);
        }
        self.ask_the_asker();
    }

    fn ask_the_asker(&mut self) {
        if let Some(fetching) = self.fetch.take() {
            let content = (fetching.fetch.content(), self.store.size().1);
            self.fetch = Some(Fetching::from_asker(fetching.asker, content, true));
        }
    }

    /// Asks for the parts of the first content that a waiting call lacks: one content at a time, in order of the calls.
    pub(super) fn go_on(&mut self, now: u64) {
        loop {
            if let Some(fetching) = &self.fetch
                && !self.waiting.iter().any(|w| w.call.inputs().contains(&fetching.fetch.content()))
            {
                self.fetch = None;
            }
            if self.fetch.is_none() {
                let store = &mut self.store;
                // What does not fit into the cache is not fetched.
                let most = store.size().1;
                self.fetch = by_haste(&self.waiting).find_map(|(_, w)| {
                    let content = w.call.inputs().into_iter().find(|hash| !store.holds(hash))?;
                    Some(Fetching::from_asker(w.askers.first()?.clone(), (content, most), false))
                });
            }
            let Some(Fetching { from, only, fetch, .. }) = &mut self.fetch else { return };
            match fetch.wants(now) {
                Ok(parts) => {
                    let (content, only) = (fetch.content(), *only);
                    let want = |part| (To::one(from), Message::Want { content, part, only });
                    return self.out.extend(parts.into_iter().map(want));
                }
                Err(e) => self.not_given(&e),
            }
        }
    }

    /// Tells all who ask that a content is here: others may fetch it from this worker.
    fn report_held(&mut self, content: Hash) {
        let askers: BTreeSet<String> = self.waiting.iter().flat_map(|w| w.askers.clone()).collect();
        let message = Message::Holds { contents: vec![content] };
        self.out.extend(askers.iter().map(|asker| (To::one(asker), message.clone())));
    }

    /// The asker from whom a content was fetched goes; its calls fail if nobody else asks for them.
    fn not_to_be_had(&mut self, reason: &str) {
        let Some(Fetching { asker, fetch, .. }) = self.fetch.take() else { return };
        let content = fetch.content();
        for waiting in self.waiting.iter_mut().filter(|w| w.call.inputs().contains(&content)) {
            waiting.askers.retain(|of| *of != asker);
            let reason = reason.to_owned();
            self.out.push((To::one(&asker), Message::Failed { key: waiting.key, reason }));
        }
        self.waiting.retain(|w| !w.askers.is_empty());
    }

    fn fail_calls_of(&mut self, content: &Hash, reason: &str) {
        let has_it = |w: &Waiting| w.call.inputs().contains(content);
        let (failed, rest): (Vec<_>, Vec<_>) = self.waiting.drain(..).partition(has_it);
        self.waiting = rest.into();
        for Waiting { key, askers, .. } in failed {
            self.fail(&askers, key, reason.to_owned());
        }
    }

    /// Contents that must stay: those of the call that is next.
    pub(super) fn requested(&self) -> BTreeSet<Hash> {
        by_haste(&self.waiting).next().map(|(_, w)| w.call.inputs().into_iter().collect()).unwrap_or_default()
    }
}
