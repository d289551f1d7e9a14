//! From whom workers fetch contents: from workers that hold them, or from this process, whose link all of them share.

use std::collections::{BTreeMap, BTreeSet};

use super::{Client, Inside};
use crate::message::Message;
use crate::worker::part_message;
use crate::{Hash, To};

/// Workers to which one worker gives contents at a time.
const PEER_GIVES: usize = 2;
/// Time after which a worker that was told where to fetch a content, or that asked for a part, is not counted any more, ns.
const FORGOTTEN: u64 = 3_000_000_000;
/// The most contents that are known.
const MOST: usize = 65_536;

/// Who holds what, and who gives it to whom.
#[derive(Default)]
pub(super) struct Sources {
    /// Workers that said that they hold a content.
    holders: BTreeMap<Hash, BTreeSet<String>>,
    /// For each worker that fetches: who gives (none: this process), what, and when that was last seen.
    fetching: BTreeMap<String, (Option<String>, Hash, u64)>,
    /// To which worker another one was last sent for a content.
    sent: BTreeMap<(String, Hash), String>,
    /// Workers that gave something else than they were asked for.
    doubtful: BTreeSet<String>,
}

impl Sources {
    pub fn note(&mut self, worker: &str, content: Hash) {
        if self.holders.contains_key(&content) || self.holders.len() < MOST {
            self.holders.entry(content).or_default().insert(worker.to_owned());
        }
        if self.fetching.get(worker).is_some_and(|(_, of, _)| *of == content) {
            self.fetching.remove(worker);
        }
    }

    /// Whether a worker was told to fetch a content from another one.
    pub fn is_sent(&self, worker: &str, to: &str, content: &Hash) -> bool {
        self.sent.get(&(worker.to_owned(), *content)).is_some_and(|peer| peer == to)
    }

    pub fn doubt(&mut self, worker: &str) {
        self.doubtful.insert(worker.to_owned());
    }

    /// How many of these contents a worker did not say that it holds.
    pub fn lacking(&self, worker: &str, contents: &[Hash]) -> usize {
        let holds = |content: &&Hash| self.holders.get(content).is_some_and(|of| of.contains(worker));
        contents.len() - contents.iter().filter(holds).count()
    }

    /// How many workers fetch from this one (none: from this process).
    fn given(&self, by: Option<&str>, now: u64) -> usize {
        let is_given = |(from, _, at): &&(Option<String>, Hash, u64)| {
            from.as_deref() == by && now.saturating_sub(*at) < FORGOTTEN
        };
        self.fetching.values().filter(is_given).count()
    }

    /// The worker that is to give a content to another one, if not this process.
    fn elsewhere(
        &self,
        now: u64,
        content: &Hash,
        to: &str,
        is_usable: impl Fn(&str) -> bool,
    ) -> Option<String> {
        let holders = self.holders.get(content)?.iter();
        let free = holders
            .filter(|name| *name != to && !self.doubtful.contains(*name) && is_usable(name))
            .map(|name| (self.given(Some(name), now), name));
        free.filter(|(given, _)| *given < PEER_GIVES).min().map(|(_, name)| name.clone())
    }
}

impl Client {
    /// Gives a part of a content, or names a worker that holds the content.
    pub(super) fn give(
        &mut self,
        now: u64,
        to: &str,
        (content, part, only): (Hash, u32, bool),
        inside: &dyn Inside,
    ) {
        let (sources, roster) = (&mut self.sources, &self.roster);
        let peer = match part == 0 && !only {
            true => sources.elsewhere(now, &content, to, |name| roster.is_usable(now, name)),
            false => None,
        };
        sources.fetching.insert(to.to_owned(), (peer.clone(), content, now));
        let message = match peer {
            Some(peer) => {
                if sources.sent.len() >= MOST {
                    sources.sent.pop_first();
                }
                sources.sent.insert((to.to_owned(), content), peer.clone());
                Message::Elsewhere { content, peer }
            }
            None => part_message(content, inside.content(&content), part),
        };
        self.out.push((To::one(to), message));
    }
}
