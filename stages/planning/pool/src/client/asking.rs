//! Whom a call is asked, and when: again, another worker, or this process.

use std::collections::{BTreeSet, VecDeque};

use super::open::{Asked, Open};
use super::{Client, Event};
use crate::call::Kind;
use crate::message::{MOST_CALLS, Message};
use crate::{Hash, To, WorkerState};

/// Time after which a call that was not answered is sent again to the same worker, ns. The worker computes it once.
const RETRY: u64 = 1_000_000_000;
/// Time between two messages with the number of calls that have no answer, ns.
const DEMAND: u64 = 500_000_000;
/// Calls that a worker is given beyond its slots: it fetches what they need while it computes others.
const AHEAD: usize = 1;
/// The same for a call that a worker computes before those that wait.
const AHEAD_IN_HASTE: usize = 2;

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
        let members: BTreeSet<String> = self.roster.usable(now).map(str::to_owned).collect();
        if !members.is_empty() {
            self.attended = now;
        }
        let is_without_workers = self.is_without_workers(now);
        let mut proving = self.proving();
        let mut is_busy = self.calls.values().any(|open| open.inside);
        for key in self.by_haste() {
            self.go_on(now, &key, (&members, is_without_workers), &mut proving, &mut is_busy);
        }
        if self.settings.tells_demand && now >= self.next_demand {
            self.next_demand = now + DEMAND;
            let calls = self.calls.len().min(MOST_CALLS as usize) as u32;
            self.out.push((To::All, Message::Demand { calls }));
        }
    }

    /// Open calls, those first for which a search waits: prices take little, and no leaf is chosen without them.
    fn by_haste(&self) -> Vec<Hash> {
        let mut order = self.order.clone();
        order.sort_by_key(|key| self.calls.get(key).is_some_and(|open| !open.kind.is_hasty()));
        order
    }

    /// Workers of which an answer to a kind of call is being compared.
    fn proving(&self) -> BTreeSet<(String, Kind)> {
        let compared = self.calls.values().filter(|open| open.compare);
        let of_call = |open: &Open| -> Vec<(String, Kind)> {
            let names = open.asked.keys().chain(open.answers.iter().map(|(name, _)| name));
            names.map(|name| (name.clone(), open.kind)).collect()
        };
        compared.flat_map(of_call).collect()
    }

    fn go_on(
        &mut self,
        now: u64,
        key: &Hash,
        (members, is_without_workers): (&BTreeSet<String>, bool),
        proving: &mut BTreeSet<(String, Kind)>,
        is_busy: &mut bool,
    ) {
        let Some(open) = self.calls.get_mut(key).filter(|open| !open.inside) else { return };
        let mut stuck = Vec::new();
        for (name, fetch) in &mut open.fetches {
            match fetch.wants(now) {
                Ok(parts) => {
                    let content = fetch.content();
                    let want = |part| (To::one(name), Message::Want { content, part, only: false });
                    self.out.extend(parts.into_iter().map(want));
                }
                Err(_) => stuck.push(name.clone()),
            }
        }
        stuck.iter().for_each(|name| drop(open.fetches.remove(name)));
        for (name, asked) in open.asked.iter_mut().filter(|(name, _)| !open.fetches.contains_key(*name)) {
            if now.saturating_sub(asked.last) >= RETRY {
                asked.last = now;
                self.out.push((To::one(name), Message::Ask { key: *key, call: open.bytes.clone() }));
            }
        }
        for (name, asked) in open.asked.iter_mut().filter(|(_, asked)| asked.is_ahead) {
            if !self.roster.is_ahead(name) {
                // The calls before it are answered: it is computed now.
                (asked.is_ahead, asked.first) = (false, now);
            }
        }
        let others = members.iter().any(|name| {
            !open.failed.contains(name)
                && !open.asked.contains_key(name)
                && open.answers.iter().all(|(of, _)| of != name)
        });
        let nobody = open.asked.is_empty() && !others;
        let failed = nobody && !open.failed.is_empty();
        let alone = nobody && !open.answers.is_empty();
        let impatient = open.is_impatient(now, self.settings.patience, self.progress, self.answered);
        // One after the other: a worker that comes meanwhile takes the rest.
        let is_time = (is_without_workers || (impatient && !members.is_empty())) && !*is_busy;
        if is_time || failed || alone {
            (open.inside, *is_busy) = (true, true);
            self.events.push_back(Event::Compute(*key));
            return;
        }
        let late = self.times.get(&open.kind).map_or(0, |times| 4 * median(times)).max(self.settings.late);
        let newest = open.asked.values().map(|asked| asked.first).max();
        let is_late = newest.is_some_and(|first| now.saturating_sub(first) >= late);
        let requested = 1 + usize::from(open.compare && others);
        let have = open.asked.len() + open.answers.len();
        let waits = open.asked.iter().find(|(_, asked)| asked.is_ahead).map(|(name, _)| name.clone());
        let is_late = is_late && waits.is_none();
        if have >= requested && !is_late && waits.is_none() {
            return;
        }
        let except = |name: &str| {
            open.asked.contains_key(name)
                || open.failed.contains(name)
                || open.answers.iter().any(|(of, _)| of == name)
        };
        // A call that nobody has yet may wait for a slot; a second worker is asked only where there is a free one.
        let ahead = match (have, open.kind.is_hasty()) {
            (0, true) => AHEAD_IN_HASTE,
            (0, false) => AHEAD,
            _ => 0,
        };
        // A comparison shows that both workers are right: one that has not been compared yet is the better second one.
        let (kind, compare) = (open.kind, open.compare);
        let is_second = |worker: &WorkerState| compare && have > 0 && worker.proven.contains(&kind);
        let (sources, inputs) = (&self.sources, &open.inputs);
        let lacks = |name: &str| sources.lacking(name, inputs);
        let Some(name) = self.roster.pick(now, ahead, except, is_second, lacks) else {
            // The answer that is there is compared with that of this process.
            if is_late && !others && !open.answers.is_empty() {
                open.inside = true;
                self.events.push_back(Event::Compute(*key));
            }
            return;
        };
        // One with a free slot takes over a call that waits for one.
        if let Some(waits) = waits.filter(|_| have >= requested) {
            open.forget(&waits);
            if let Some(worker) = self.roster.get_mut(&waits) {
                worker.outstanding.remove(key);
            }
            self.out.push((To::One(waits), Message::Cancel { key: *key }));
        }
        let Some(worker) = self.roster.get_mut(&name) else { return };
        let is_ahead = worker.outstanding.len() >= worker.hello.slots as usize;
        worker.outstanding.insert(*key);
        // One comparison at a time for each kind of call; were it to fail, the other answers would be in doubt.
        let is_new = !worker.proven.contains(&open.kind) && !proving.contains(&(name.clone(), open.kind));
        open.compare |= is_new;
        if open.compare {
            proving.insert((name.clone(), open.kind));
        }
        if is_late && have >= requested {
            self.tally.hedged += 1;
        }
        if open.begun.is_none() {
            (open.begun, open.progress) = (Some(now), now);
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.asked(now, key, &name);
        }
        let asked = Asked { first: now, last: now, length: None, is_ahead };
        open.asked.insert(name.clone(), asked);
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
