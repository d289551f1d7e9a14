//! Whom a call is asked, and when: again, another worker, or this process.

use std::collections::{BTreeSet, VecDeque};

use super::open::Asked;
use super::{Client, Event};
use crate::message::Message;
use crate::{Hash, To};

/// Time after which a call that was not answered is sent again to the same worker, ns. The worker computes it once.
const AGAIN: u64 = 1_000_000_000;
/// Times of patience after which a call is computed by this process, even if a worker says that it works on it.
const MOST_PATIENCE: u64 = 10;

impl Client {
    /// Lets time pass: asks, asks again, asks others, and asks this process.
    pub fn tick(&mut self, now: u64) {
        let gone: Vec<String> =
            self.roster.workers().keys().filter(|name| !self.roster.is_usable(now, name)).cloned().collect();
        for name in gone {
            self.calls.values_mut().for_each(|open| open.forget(&name));
            if let Some(worker) = self.roster.get_mut(&name) {
                worker.outstanding.clear();
            }
        }
        let crew: BTreeSet<String> = self.roster.usable(now).map(str::to_owned).collect();
        if !crew.is_empty() {
            self.attended = now;
        }
        let deserted = now.saturating_sub(self.attended) >= self.settings.patience;
        for key in self.order.clone() {
            self.go_on(now, &key, &crew, deserted);
        }
    }

    fn go_on(&mut self, now: u64, key: &Hash, crew: &BTreeSet<String>, deserted: bool) {
        let Some(open) = self.calls.get_mut(key).filter(|open| !open.inside) else { return };
        let mut stuck = Vec::new();
        for (name, fetch) in &mut open.fetches {
            match fetch.wants(now) {
                Ok(parts) => {
                    let content = fetch.content();
                    self.out.extend(
                        parts.into_iter().map(|part| (To::one(name), Message::Want { content, part })),
                    );
                }
                Err(_) => stuck.push(name.clone()),
            }
        }
        stuck.iter().for_each(|name| drop(open.fetches.remove(name)));
        for (name, asked) in open.asked.iter_mut().filter(|(name, _)| !open.fetches.contains_key(*name)) {
            if now.saturating_sub(asked.last) >= AGAIN {
                asked.last = now;
                self.out.push((To::one(name), Message::Ask { key: *key, call: open.bytes.clone() }));
            }
        }
        let others = crew.iter().any(|name| {
            !open.failed.contains(name)
                && !open.asked.contains_key(name)
                && open.answers.iter().all(|(of, _)| of != name)
        });
        let nobody = open.asked.is_empty() && !others;
        let failed = nobody && !open.failed.is_empty();
        let alone = nobody && !open.answers.is_empty();
        // A worker that says for ever that it works is not believed for ever.
        let impatient = now.saturating_sub(open.progress) >= self.settings.patience
            || now.saturating_sub(open.since) >= MOST_PATIENCE.saturating_mul(self.settings.patience);
        if deserted || failed || alone || (impatient && !crew.is_empty()) {
            open.inside = true;
            self.events.push_back(Event::Compute(*key));
            return;
        }
        let late = self.times.get(&open.kind).map_or(0, |times| 4 * median(times)).max(self.settings.late);
        let newest = open.asked.values().map(|asked| asked.first).max();
        let is_late = newest.is_some_and(|first| now.saturating_sub(first) >= late);
        let wanted = 1 + usize::from(open.compare && others);
        let have = open.asked.len() + open.answers.len();
        if have >= wanted && !is_late {
            return;
        }
        let except = |name: &str| {
            open.asked.contains_key(name)
                || open.failed.contains(name)
                || open.answers.iter().any(|(of, _)| of == name)
        };
        let Some(name) = self.roster.pick(now, except) else {
            // The answer that is there is compared with that of this process.
            if is_late && !others && !open.answers.is_empty() {
                open.inside = true;
                self.events.push_back(Event::Compute(*key));
            }
            return;
        };
        let Some(worker) = self.roster.get_mut(&name) else { return };
        worker.outstanding.insert(*key);
        if !worker.proven.contains(&open.kind) && !open.compare {
            open.compare = true;
        }
        if have >= wanted {
            self.tally.hedged += 1;
        }
        open.asked.insert(name.clone(), Asked { first: now, last: now });
        self.out.push((To::One(name), Message::Ask { key: *key, call: open.bytes.clone() }));
    }

    pub(super) fn release(&mut self, key: &Hash, from: &str) {
        if let Some(open) = self.calls.get_mut(key) {
            open.forget(from);
        }
        if let Some(worker) = self.roster.get_mut(from) {
            worker.outstanding.remove(key);
        }
    }

    /// Ends a call and tells those who still work on it.
    pub(super) fn close(&mut self, key: &Hash) {
        let Some(open) = self.calls.remove(key) else { return };
        for name in open.asked.into_keys() {
            if let Some(worker) = self.roster.get_mut(&name) {
                worker.outstanding.remove(key);
            }
            self.out.push((To::One(name), Message::Cancel { key: *key }));
        }
    }
}

fn median(times: &VecDeque<u64>) -> u64 {
    let mut sorted: Vec<u64> = times.iter().copied().collect();
    sorted.sort_unstable();
    sorted.get(sorted.len() / 2).copied().unwrap_or(0)
}
