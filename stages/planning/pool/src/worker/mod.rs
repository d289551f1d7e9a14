//! A worker as a state machine: messages and time go in, messages and jobs come out. It holds nothing that matters: a
//! worker that is lost loses no plan.
//!
//! - `contents`: what calls need, fetched from whoever has it and given to others

mod contents;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

use crate::fetch::part_of;
use crate::message::{Hello, INLINE, MOST_HELD, Message, Spent};
use crate::opened::{Files, Opened};
use crate::{Build, Call, CallError, Hash, Ready, Store, To};
use contents::Fetching;

/// Time between two greetings, ns.
pub const HELLO: u64 = 200_000_000;
/// Calls that wait at most.
const MOST_WAITING: usize = 256;
/// Askers of one call at most.
const MOST_ASKERS: usize = 16;
/// How long a worker that drains stays after it last gave something, ns: a part that was lost is asked for again.
const LINGER: u64 = 1_500_000_000;
/// How long the number of calls of one who asks is remembered, ns: it comes twice a second.
const DEMAND: u64 = 2_500_000_000;
/// Those who ask whose number is remembered, at most.
const MOST_DEMANDS: usize = 256;
/// Answers that are remembered by their call.
const MOST_ANSWERS: usize = 65_536;

/// What a worker is.
pub struct WorkerSettings {
    /// The build.
    pub build: Build,
    /// Number of this life: a later one has a higher number.
    pub incarnation: u64,
    /// Calls that are computed at the same time.
    pub slots: usize,
    /// The most bytes of arguments that are kept open.
    pub most_open: u64,
}

/// A worker.
pub struct Worker {
    settings: WorkerSettings,
    store: Store,
    opened: Arc<Mutex<Opened>>,
    waiting: VecDeque<Waiting>,
    running: BTreeMap<Hash, Vec<String>>,
    answers: BTreeMap<Hash, Hash>,
    fetch: Option<Fetching>,
    /// Other workers that gave something else than was asked for: nothing is fetched from them any more.
    doubtful: BTreeSet<String>,
    /// When those who ask last said how many of their calls have no answer, ns, and the number.
    demands: BTreeMap<String, (u64, u32)>,
    out: Vec<(To, Message)>,
    counts: WorkerCounts,
    next_hello: u64,
    draining: bool,
    /// When it last gave an answer or a part of a content, ns.
    gave: Option<u64>,
    /// It gave an answer since time last passed.
    gives: bool,
}

/// What a worker has done since it began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorkerCounts {
    /// Calls that were answered.
    pub answered: u64,
    /// Those of them whose answer was in the cache.
    pub known: u64,
    /// Calls that failed.
    pub failed: u64,
    /// Calls that were not taken: another build, or not written as a call.
    pub refused: u64,
    /// Calls for which there was no room; who asks may ask again.
    pub busy: u64,
}

struct Waiting {
    key: Hash,
    call: Call,
    askers: Vec<String>,
}

/// A call to compute, on any thread.
pub struct Job {
    /// Key of the call.
    pub key: Hash,
    call: Call,
    files: Files,
    opened: Arc<Mutex<Opened>>,
}

impl Job {
    /// The call with its arguments, which are opened if no job before opened them.
    ///
    /// # Errors
    /// An argument is not what the call takes it for.
    pub fn open(mut self) -> Result<Ready, CallError> {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        opened.ready(&mut self.files, self.call)
    }
}

impl Worker {
    /// With this cache.
    pub fn new(settings: WorkerSettings, store: Store) -> Self {
        Self {
            opened: Arc::new(Mutex::new(Opened::new(settings.most_open))),
            settings,
            store,
            waiting: VecDeque::new(),
            running: BTreeMap::new(),
            answers: BTreeMap::new(),
            fetch: None,
            doubtful: BTreeSet::new(),
            demands: BTreeMap::new(),
            out: Vec::new(),
            counts: WorkerCounts::default(),
            next_hello: 0,
            draining: false,
            gave: None,
            gives: false,
        }
    }

    /// Takes no more calls: those that wait go back to those who asked, who ask others; those that run are finished.
    pub fn drain(&mut self) {
        if std::mem::replace(&mut self.draining, true) {
            return;
        }
        for Waiting { key, askers, .. } in std::mem::take(&mut self.waiting) {
            self.report(&askers, Message::Busy { key });
        }
        self.next_hello = 0;
    }

    /// Whether a worker that drains has finished its calls, and nobody has fetched an answer for a while.
    pub fn is_drained(&self, now: u64) -> bool {
        let is_quiet = self.gave.is_none_or(|gave| now.saturating_sub(gave) >= LINGER);
        self.draining && self.running.is_empty() && self.out.is_empty() && !self.gives && is_quiet
    }

    /// Takes a message. Bytes that are no message are ignored.
    pub fn handle(&mut self, now: u64, from: &str, bytes: &[u8]) {
        let Ok(message) = Message::from_bytes(bytes) else { return };
        match message {
            Message::Ask { key, call } => self.ask(from, key, &call),
            Message::Cancel { key } => self.cancel(from, &key),
            Message::Want { content, part, .. } => {
                self.gave = Some(now);
                self.give(from, content, part);
            }
            Message::Part { content, part, length, bytes } => {
                self.take_part(from, content, part, length, bytes);
            }
            Message::Absent { content } => self.miss(from, content),
            Message::Elsewhere { content, peer } => self.turn_to(from, content, peer),
            Message::Demand { calls } => self.note_demand(now, from, calls),
            _ => {}
        }
        self.go_on(now);
    }

    /// Lets time pass.
    pub fn tick(&mut self, now: u64) {
        if std::mem::take(&mut self.gives) {
            self.gave = Some(now);
        }
        if now >= self.next_hello {
            self.next_hello = now + HELLO;
            let hello = self.hello();
            self.out.push((To::All, Message::Hello(hello)));
        }
        self.go_on(now);
    }

    /// What it tells of itself.
    pub fn hello(&self) -> Hello {
        let (cache, cache_most) = self.store.size();
        Hello {
            build: self.settings.build.text().to_owned(),
            incarnation: self.settings.incarnation,
            // One that drains has no free slot; with none at all it would count as gone, and its calls be asked again.
            slots: if self.draining { self.running.len().max(1) } else { self.settings.slots } as u32,
            running: self.running.len() as u32,
            waiting: self.waiting.len() as u32,
            answered: self.counts.answered,
            known: self.counts.known,
            cache,
            cache_most,
        }
    }

    /// Calls in the pool without an answer, of all who ask and said it of late.
    pub fn demand(&self, now: u64) -> u64 {
        let recent = self.demands.values().filter(|(at, _)| now.saturating_sub(*at) <= DEMAND);
        recent.map(|(_, calls)| u64::from(*calls)).sum()
    }

    fn note_demand(&mut self, now: u64, from: &str, calls: u32) {
        if self.demands.len() >= MOST_DEMANDS {
            self.demands.retain(|_, (at, _)| now.saturating_sub(*at) <= DEMAND);
        }
        if self.demands.len() < MOST_DEMANDS || self.demands.contains_key(from) {
            self.demands.insert(from.to_owned(), (now, calls));
        }
    }

    /// What it has done.
    pub fn counts(&self) -> WorkerCounts {
        self.counts
    }

    /// Messages to send.
    pub fn take_messages(&mut self) -> Vec<(To, Message)> {
        std::mem::take(&mut self.out)
    }

    /// The next call to compute, as long as a slot is free.
    pub fn next_job(&mut self) -> Option<Job> {
        while self.running.len() < self.settings.slots {
            let store = &mut self.store;
            let is_ready = |(_, w): &(usize, &Waiting)| w.call.inputs().iter().all(|hash| store.holds(hash));
            let (at, _) = by_haste(&self.waiting).find(is_ready)?;
            let Waiting { key, call, askers } = self.waiting.remove(at)?;
            match Files::of(store, call.inputs()) {
                Ok(files) => {
                    self.running.insert(key, askers);
                    return Some(Job { key, call, files, opened: self.opened.clone() });
                }
                Err(error) => self.fail(&askers, key, error.to_string()),
            }
        }
        None
    }

    /// Takes the result of a job, and on what this worker spent its time for it.
    pub fn finish(&mut self, key: Hash, result: Result<Vec<u8>, CallError>, spent: Spent) {
        let askers = self.running.remove(&key).unwrap_or_default();
        let length = result.as_ref().map_or(0, |bytes| bytes.len() as u64);
        let spent = Spent { length, ..spent };
        let retained = result.and_then(|bytes| Ok((self.store.put(&bytes, &self.requested())?, bytes)));
        match retained {
            Ok((answer, bytes)) => {
                self.counts.answered += 1;
                if self.answers.len() >= MOST_ANSWERS {
                    self.answers.pop_first();
                }
                self.answers.insert(key, answer);
                self.gives = true;
                self.report(&askers, Message::Spent { key, spent });
                self.report(&askers, answer_message(key, answer, bytes));
            }
            Err(error) => self.fail(&askers, key, error.to_string()),
        }
    }

    fn ask(&mut self, from: &str, key: Hash, bytes: &[u8]) {
        let call = match Call::from_bytes(bytes) {
            Ok(call) => call,
            Err(e) => return self.refuse(from, key, format!("the call cannot be read: {e}")),
        };
        if Call::key_of(bytes, &self.settings.build) != key {
            let reason = format!("this worker has another build: {}", self.settings.build.text());
            return self.refuse(from, key, reason);
        }
        if let Some(answer) = self.answers.get(&key).copied() {
            if let Ok(file) = self.store.read(&answer) {
                self.counts.answered += 1;
                self.counts.known += 1;
                let message = answer_message(key, answer, file.bytes().to_vec());
                return self.out.push((To::one(from), message));
            }
            self.answers.remove(&key);
        }
        let is_full = self.draining || self.waiting.len() >= MOST_WAITING;
        let waiting = self.waiting.iter_mut().find(|w| w.key == key).map(|w| &mut w.askers);
        let reply = match waiting.or(self.running.get_mut(&key)) {
            Some(askers) => {
                let known = askers.iter().any(|asker| asker == from);
                if !known && askers.len() < MOST_ASKERS {
                    askers.push(from.to_owned());
                }
                Message::Working { key }
            }
            None if is_full => {
                self.counts.busy += 1;
                Message::Busy { key }
            }
            None => {
                let held: Vec<Hash> =
                    call.inputs().into_iter().filter(|hash| self.store.holds(hash)).collect();
                let message = |held: &[Hash]| (To::one(from), Message::Holds { contents: held.to_vec() });
                self.out.extend(held.chunks(MOST_HELD).map(message));
                self.waiting.push_back(Waiting { key, call, askers: vec![from.to_owned()] });
                Message::Working { key }
            }
        };
        self.out.push((To::one(from), reply));
    }

    /// A call that runs is computed to its end: another may ask for it.
    fn cancel(&mut self, from: &str, key: &Hash) {
        for waiting in self.waiting.iter_mut().filter(|w| w.key == *key) {
            waiting.askers.retain(|asker| asker != from);
        }
        self.waiting.retain(|w| !w.askers.is_empty());
        if let Some(askers) = self.running.get_mut(key) {
            askers.retain(|asker| asker != from);
        }
    }

    fn refuse(&mut self, from: &str, key: Hash, reason: String) {
        self.counts.refused += 1;
        self.out.push((To::one(from), Message::Failed { key, reason }));
    }

    fn fail(&mut self, askers: &[String], key: Hash, reason: String) {
        self.counts.failed += 1;
        self.report(askers, Message::Failed { key, reason });
    }

    fn report(&mut self, askers: &[String], message: Message) {
        self.out.extend(askers.iter().map(|asker| (To::one(asker), message.clone())));
    }
}

/// Calls that wait with their places, those first for which a search waits.
fn by_haste(waiting: &VecDeque<Waiting>) -> impl Iterator<Item = (usize, &Waiting)> {
    let of = move |is_hasty: bool| {
        waiting.iter().enumerate().filter(move |(_, w)| w.call.kind().is_hasty() == is_hasty)
    };
    of(true).chain(of(false))
}

fn answer_message(key: Hash, answer: Hash, bytes: Vec<u8>) -> Message {
    if bytes.len() <= INLINE { Message::Answer { key, bytes } } else { Message::Done { key, answer } }
}

/// The part of a content in memory, as a message.
pub fn part_message(content: Hash, bytes: Option<&[u8]>, part: u32) -> Message {
    match bytes.and_then(|all| Some((all.len() as u64, part_of(all, part)?.to_vec()))) {
        Some((length, bytes)) => Message::Part { content, part, length, bytes },
        None => Message::Absent { content },
    }
}
