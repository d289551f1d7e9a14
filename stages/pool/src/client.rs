//! The side that asks, as a state machine: calls, messages and time go in; messages and answers come out.
//!
//! Answers do not depend on who gives them, so it matters to nobody which worker is asked, and when. A call is given to
//! the worker with the most room; to another one when the first is late; to this process when nobody answers.
//! The first answers of a worker, and a share of all, are compared with those of another worker or of this process.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use crate::call::Kind;
use crate::fetch::Fetch;
use crate::message::Message;
use crate::roster::Roster;
use crate::worker::part_message;
use crate::{Build, Call, Hash, To, WorkerState};

/// Time after which a call that was not answered is sent again to the same worker, ns. The worker computes it once.
const AGAIN: u64 = 1_000_000_000;
/// Times of patience after which a call is computed by this process, even if a worker says that it works on it.
const MOST_PATIENCE: u64 = 10;
/// Solve times by which it is judged what is late.
const REMEMBERED: usize = 31;
/// Bytes of answers that are kept for a search that is run again.
const MOST_KEPT: usize = 512 << 20;

/// How a client asks.
#[derive(Clone, Debug)]
pub struct ClientSettings {
    /// The build.
    pub build: Build,
    /// Time without any sign of an answer after which a call is computed by this process, ns.
    pub patience: u64,
    /// Least time after which another worker is asked, ns. It is at least four times the median time of such calls.
    pub late: u64,
    /// Share of the calls whose answers are compared, from 0 to 1.
    pub checked: f64,
}

impl ClientSettings {
    /// Patience of 60 s, a second worker after 2 s at the earliest, one answer in 32 compared.
    pub fn new(build: Build) -> Self {
        Self { build, patience: 60_000_000_000, late: 2_000_000_000, checked: 1.0 / 32.0 }
    }
}

/// What the asking process can do itself.
pub trait Inside {
    /// A content that workers need.
    fn content(&self, hash: &Hash) -> Option<&[u8]>;

    /// Whether an answer has the form that the call asks for.
    ///
    /// # Errors
    /// What is wrong with it.
    fn check(&self, key: &Hash, answer: &[u8]) -> Result<(), String>;
}

/// What the client needs or has.
#[derive(Debug)]
pub enum Event {
    /// An answer.
    Answer(Hash, Arc<Vec<u8>>),
    /// This process must compute the call, and hand the result to [`Client::settle`].
    Compute(Hash),
}

/// How calls were answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Calls answered by workers.
    pub remote: u64,
    /// Calls computed by this process.
    pub local: u64,
    /// Answers that were compared.
    pub compared: u64,
    /// Calls for which another worker was asked because the first was late.
    pub hedged: u64,
}

/// The side that asks.
pub struct Client {
    settings: ClientSettings,
    roster: Roster,
    calls: BTreeMap<Hash, Open>,
    /// Keys of open calls in the order in which they came.
    order: Vec<Hash>,
    accepted: BTreeMap<Hash, Accepted>,
    /// Accepted answers whose bytes are kept, the oldest first.
    kept: VecDeque<Hash>,
    kept_bytes: usize,
    tainted: BTreeSet<Hash>,
    times: BTreeMap<Kind, VecDeque<u64>>,
    events: VecDeque<Event>,
    news: Vec<String>,
    out: Vec<(To, Message)>,
    tally: Tally,
    /// When there was a worker last.
    attended: u64,
}

struct Open {
    bytes: Vec<u8>,
    kind: Kind,
    /// Answers that are compared before one is accepted.
    compare: bool,
    /// When it was submitted.
    since: u64,
    /// When a worker last showed that it works on the call.
    progress: u64,
    asked: BTreeMap<String, Asked>,
    answers: Vec<(String, Arc<Vec<u8>>)>,
    fetches: BTreeMap<String, Fetch>,
    failed: BTreeSet<String>,
    /// This process computes it.
    inside: bool,
}

struct Asked {
    first: u64,
    last: u64,
}

struct Accepted {
    bytes: Option<Arc<Vec<u8>>>,
    /// The worker, unless the answer was compared or computed here.
    unproved: Option<String>,
}

impl Client {
    /// Without workers yet.
    pub fn new(now: u64, settings: ClientSettings) -> Self {
        Self {
            settings,
            roster: Roster::default(),
            calls: BTreeMap::new(),
            order: Vec::new(),
            accepted: BTreeMap::new(),
            kept: VecDeque::new(),
            kept_bytes: 0,
            tainted: BTreeSet::new(),
            times: BTreeMap::new(),
            events: VecDeque::new(),
            news: Vec::new(),
            out: Vec::new(),
            tally: Tally::default(),
            attended: now,
        }
    }

    /// The build.
    pub fn build(&self) -> &Build {
        &self.settings.build
    }

    /// The workers.
    pub fn workers(&self) -> &BTreeMap<String, WorkerState> {
        self.roster.workers()
    }

    /// How calls were answered.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Messages for people since the last call.
    pub fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }

    /// Messages to send.
    pub fn take_messages(&mut self) -> Vec<(To, Message)> {
        std::mem::take(&mut self.out)
    }

    /// The next answer, or the next call to compute.
    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Keys of answers that were given to the caller, came from a worker that was shut out later, and were not compared.
    /// What was made of them must be made again.
    pub fn take_tainted(&mut self) -> BTreeSet<Hash> {
        std::mem::take(&mut self.tainted)
    }

    /// Asks a call. The answer comes as an event.
    pub fn submit(&mut self, now: u64, call: &Call) -> Hash {
        let bytes = call.to_bytes();
        let key = Call::key_of(&bytes, &self.settings.build);
        if let Some(bytes) = self.accepted.get(&key).and_then(|accepted| accepted.bytes.clone()) {
            self.events.push_back(Event::Answer(key, bytes));
        } else if !self.calls.contains_key(&key) {
            let share = key.number() as f64 / u64::MAX as f64;
            let open = Open {
                bytes,
                kind: call.kind(),
                compare: share < self.settings.checked,
                since: now,
                progress: now,
                asked: BTreeMap::new(),
                answers: Vec::new(),
                fetches: BTreeMap::new(),
                failed: BTreeSet::new(),
                inside: false,
            };
            self.calls.insert(key, open);
            self.order.push(key);
        }
        key
    }

    /// Forgets all calls that have no answer, and tells the workers.
    pub fn cancel_all(&mut self) {
        for key in std::mem::take(&mut self.order) {
            self.close(&key);
        }
        self.events.clear();
    }

    /// Takes a message. Bytes that are no message are ignored.
    pub fn hear(&mut self, now: u64, from: &str, bytes: &[u8], inside: &dyn Inside) {
        let Ok(message) = Message::from_bytes(bytes) else { return };
        match message {
            Message::Hello(hello) => {
                let (event, lost) = self.roster.greet(now, from, hello, &self.settings.build);
                self.news.extend(event);
                if lost {
                    self.calls.values_mut().for_each(|open| open.forget(from));
                }
            }
            Message::Want { content, part } => {
                self.out.push((To::one(from), part_message(content, inside.content(&content), part)));
            }
            Message::Working { key } => {
                if let Some(open) = self.calls.get_mut(&key).filter(|open| open.asked.contains_key(from)) {
                    open.progress = now;
                }
            }
            Message::Busy { key } => {
                self.roster.full(now, from);
                self.release(&key, from);
            }
            Message::Failed { key, reason } => {
                if let Some(open) = self.calls.get_mut(&key).filter(|open| open.asked.contains_key(from)) {
                    open.failed.insert(from.to_owned());
                    self.news
                        .push(format!("worker `{from}` does not answer a {}: {reason}", open.kind.word()));
                    self.release(&key, from);
                }
            }
            Message::Answer { key, bytes } => self.arrived(now, key, from, bytes, inside),
            Message::Done { key, answer } => {
                if let Some(open) = self.calls.get_mut(&key).filter(|open| open.asked.contains_key(from)) {
                    open.progress = now;
                    let fetch = open.fetches.entry(from.to_owned()).or_insert_with(|| Fetch::new(answer));
                    if fetch.content() != answer {
                        *fetch = Fetch::new(answer);
                    }
                }
            }
            Message::Part { content, part, length, bytes } => {
                self.take_part(now, from, (content, part, length, bytes), inside);
            }
            Message::Absent { content } => self.drop_fetches(from, &content),
            Message::Ask { .. } | Message::Cancel { .. } => {}
        }
    }

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

    fn arrived(&mut self, now: u64, key: Hash, from: &str, bytes: Vec<u8>, inside: &dyn Inside) {
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
        let Some(open) = self.calls.get_mut(&key) else { return };
        open.progress = now;
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

    fn take_part(
        &mut self,
        now: u64,
        from: &str,
        (content, part, length, bytes): (Hash, u32, u64, Vec<u8>),
        inside: &dyn Inside,
    ) {
        let mut whole = None;
        let mut wrong = None;
        for (key, open) in &mut self.calls {
            let Some(fetch) = open.fetches.get_mut(from).filter(|fetch| fetch.content() == content) else {
                continue;
            };
            open.progress = now;
            match fetch.take(part, length, bytes) {
                Ok(Some(bytes)) => whole = Some((*key, bytes)),
                Ok(None) => {
                    let wants = fetch.wants(now).unwrap_or_default();
                    let want = |part| (To::one(from), Message::Want { content, part });
                    self.out.extend(wants.into_iter().map(want));
                }
                Err(e) => wrong = Some(e.to_string()),
            }
            break;
        }
        match (whole, wrong) {
            (Some((key, bytes)), _) => self.arrived(now, key, from, bytes, inside),
            (None, Some(reason)) => self.shut_out(from, &reason),
            (None, None) => {}
        }
    }

    /// The worker does not hold an answer any more: it is asked again.
    fn drop_fetches(&mut self, from: &str, content: &Hash) {
        for open in self.calls.values_mut() {
            if open.fetches.get(from).is_some_and(|fetch| fetch.content() == *content) {
                open.fetches.remove(from);
            }
        }
    }

    fn release(&mut self, key: &Hash, from: &str) {
        if let Some(open) = self.calls.get_mut(key) {
            open.forget(from);
        }
        if let Some(worker) = self.roster.get_mut(from) {
            worker.outstanding.remove(key);
        }
    }

    fn prove(&mut self, name: &str, kind: Kind) {
        if let Some(worker) = self.roster.get_mut(name) {
            worker.proven.insert(kind);
        }
    }

    fn shut_out(&mut self, name: &str, reason: &str) {
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
            self.kept.push_back(key);
            self.kept_bytes += bytes.len();
        }
        while self.kept_bytes > MOST_KEPT {
            let Some(oldest) = self.kept.pop_front() else { break };
            let bytes = self.accepted.get_mut(&oldest).and_then(|accepted| accepted.bytes.take());
            self.kept_bytes -= bytes.map_or(0, |bytes| bytes.len());
        }
        self.events.push_back(Event::Answer(key, bytes));
    }

    fn forget_answer(&mut self, key: &Hash) {
        let Some(Accepted { bytes: Some(bytes), .. }) = self.accepted.remove(key) else { return };
        self.kept_bytes -= bytes.len();
        self.kept.retain(|kept| kept != key);
    }

    /// Ends a call and tells those who still work on it.
    fn close(&mut self, key: &Hash) {
        let Some(open) = self.calls.remove(key) else { return };
        for name in open.asked.into_keys() {
            if let Some(worker) = self.roster.get_mut(&name) {
                worker.outstanding.remove(key);
            }
            self.out.push((To::One(name), Message::Cancel { key: *key }));
        }
    }
}

impl Open {
    fn forget(&mut self, name: &str) {
        self.asked.remove(name);
        self.fetches.remove(name);
    }
}

fn median(times: &VecDeque<u64>) -> u64 {
    let mut sorted: Vec<u64> = times.iter().copied().collect();
    sorted.sort_unstable();
    sorted.get(sorted.len() / 2).copied().unwrap_or(0)
}
