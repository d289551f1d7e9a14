//! Which answers are accepted, and which workers are shut out.

use std::sync::Arc;

use super::open::Accepted;
use super::{Client, Event, Inside};
use crate::Hash;
use crate::call::Kind;

/// Solve times by which it is judged what is late.
const REMEMBERED: usize = 31;

impl Client {
    /// Takes what this process computed.
    pub fn settle(&mut self, key: &Hash, bytes: Vec<u8>) {
        let Some(open) = self.calls.get(key) else { return };
        let (kind, bytes) = (open.kind, Arc::new(bytes));
        let judged: Vec<(String, bool)> =
            open.answers.iter().map(|(name, answer)| (name.clone(), *answer == bytes)).collect();
        self.tally.compared += judged.len() as u64;
        for (name, right) in judged {
            match right {
                true => self.prove(&name, kind),
                false => {
                    let why =
                        format!("its answer to a {} is not the one that this process computes", kind.word());
                    self.shut_out(&name, &why);
                }
            }
        }
        self.tally.local += 1;
        self.accept(*key, bytes, None);
    }

    pub(super) fn arrived(&mut self, now: u64, key: Hash, from: &str, bytes: Vec<u8>, inside: &dyn Inside) {
        let Some(open) = self.calls.get_mut(&key) else { return };
        // Only who was asked may answer, and once.
        let Some(asked) = open.asked.remove(from) else { return };
        open.fetches.remove(from);
        let kind = open.kind;
        if let Some(worker) = self.roster.get_mut(from) {
            worker.outstanding.remove(&key);
            worker.answered += 1;
        }
        if let Err(what) = inside.check(&key, &bytes) {
            return self.shut_out(from, &format!("its answer to a {} is none: {what}", kind.word()));
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.answered(now, &key, from, &bytes);
        }
        let Some(open) = self.calls.get_mut(&key) else { return };
        open.progress = now;
        (self.progress, self.answered) = (now, now);
        let times = self.times.entry(kind).or_default();
        times.push_back(now.saturating_sub(asked.first));
        if times.len() > REMEMBERED {
            times.pop_front();
        }
        let bytes = Arc::new(bytes);
        if open.inside {
            open.answers.push((from.to_owned(), bytes));
            return;
        }
        if !open.compare {
            self.tally.remote += 1;
            return self.accept(key, bytes, Some(from.to_owned()));
        }
        open.answers.push((from.to_owned(), bytes.clone()));
        let [(one, first), (other, second)] = &open.answers[..] else { return };
        if first == second {
            let names = [one.clone(), other.clone()];
            self.tally.compared += 2;
            self.tally.remote += 1;
            names.iter().for_each(|name| self.prove(name, kind));
            self.accept(key, bytes, None);
        } else {
            open.inside = true;
            self.events.push_back(Event::Compute(key));
        }
    }

    fn prove(&mut self, name: &str, kind: Kind) {
        if let Some(worker) = self.roster.get_mut(name) {
            worker.proven.insert(kind);
        }
    }

    pub(super) fn shut_out(&mut self, name: &str, reason: &str) {
        self.news.push(format!("worker `{name}` is shut out: {reason}"));
        if let Some(worker) = self.roster.get_mut(name) {
            worker.shut_out = Some(reason.to_owned());
            worker.outstanding.clear();
        }
        for open in self.calls.values_mut() {
            open.forget(name);
            open.answers.retain(|(of, _)| of != name);
        }
        let of_worker = |(key, accepted): (&Hash, &Accepted)| {
            (accepted.unproved.as_deref() == Some(name)).then_some(*key)
        };
        let doubtful: Vec<Hash> = self.accepted.iter().filter_map(of_worker).collect();
        for key in doubtful {
            self.forget_answer(&key);
            self.tainted.insert(key);
        }
    }

    fn accept(&mut self, key: Hash, bytes: Arc<Vec<u8>>, unproved: Option<String>) {
        let kind = self.calls.get(&key).map(|open| open.kind);
        self.close(&key);
        self.order.retain(|open| *open != key);
        // Doses are kept by the caller, in files.
        let keeps = kind != Some(Kind::Dose);
        self.accepted.insert(key, Accepted { bytes: keeps.then(|| bytes.clone()), unproved });
        if keeps {
            self.retained.push_back(key);
            self.retained_bytes += bytes.len();
        }
        while self.retained_bytes > self.settings.most_retained {
            let Some(oldest) = self.retained.pop_front() else { break };
            let bytes = self.accepted.get_mut(&oldest).and_then(|accepted| accepted.bytes.take());
            self.retained_bytes -= bytes.map_or(0, |bytes| bytes.len());
        }
        self.events.push_back(Event::Answer(key, bytes));
    }

    fn forget_answer(&mut self, key: &Hash) {
        let Some(Accepted { bytes: Some(bytes), .. }) = self.accepted.remove(key) else { return };
        self.retained_bytes -= bytes.len();
        self.retained.retain(|retained| retained != key);
    }
}
