//! The side that asks, as a state machine: calls, messages and time go in; messages and answers come out.
//!
//! Answers do not depend on who gives them, so it matters to nobody which worker is asked, and when. A call is given to
//! the worker with the most room; to another one when the first is late; to this process when nobody answers.
//! The first answers of a worker, and a share of all, are compared with those of another worker or of this process.
//!
//! - `open`: calls that are open; `asking`: whom they are asked
//! - `judging`: answers and those who give them; `parts`: long answers
//! - `sources`: from whom workers fetch contents

mod asking;
mod judging;
mod open;
mod parts;
mod sources;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use crate::call::Kind;
use crate::fetch::Fetch;
use crate::message::Message;
use crate::record::Recorder;
use crate::roster::Roster;
use crate::{Build, Call, CallError, Hash, To, WorkerState};
use open::{Accepted, Open};
use sources::Sources;

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
    /// Bytes of answers that are kept for a search that is run again.
    pub most_retained: usize,
    /// Whether everybody is sent the number of calls without an answer: `pool --wanted` counts them.
    pub tells_demand: bool,
}

impl ClientSettings {
    /// Patience of 60 s, a second worker after 2 s at the earliest, one answer in 32 compared, 512 MiB of answers kept.
    pub fn new(build: Build) -> Self {
        Self {
            build,
            patience: 60_000_000_000,
            late: 2_000_000_000,
            checked: 1.0 / 32.0,
            most_retained: 512 << 20,
            tells_demand: false,
        }
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
    fn check(&self, key: &Hash, answer: &[u8]) -> Result<(), CallError>;
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
    sources: Sources,
    calls: BTreeMap<Hash, Open>,
    /// Keys of open calls in the order in which they came.
    order: Vec<Hash>,
    accepted: BTreeMap<Hash, Accepted>,
    /// Accepted answers whose bytes are kept, the oldest first.
    retained: VecDeque<Hash>,
    retained_bytes: usize,
    tainted: BTreeSet<Hash>,
    times: BTreeMap<Kind, VecDeque<u64>>,
    events: VecDeque<Event>,
    news: Vec<String>,
    out: Vec<(To, Message)>,
    tally: Tally,
    /// When there was a worker last.
    attended: u64,
    /// When a worker last showed that it works on a call.
    progress: u64,
    /// When a worker last answered a call.
    answered: u64,
    /// When the number of calls without an answer is sent next.
    next_demand: u64,
    recorder: Option<Recorder>,
}

impl Client {
    /// Without workers yet.
    pub fn new(now: u64, settings: ClientSettings) -> Self {
        Self {
            settings,
            roster: Roster::default(),
            sources: Sources::default(),
            calls: BTreeMap::new(),
            order: Vec::new(),
            accepted: BTreeMap::new(),
            retained: VecDeque::new(),
            retained_bytes: 0,
            tainted: BTreeSet::new(),
            times: BTreeMap::new(),
            events: VecDeque::new(),
            news: Vec::new(),
            out: Vec::new(),
            tally: Tally::default(),
            attended: now,
            progress: now,
            answered: now,
            next_demand: now,
            recorder: None,
        }
    }

    /// Writes down all calls from now on.
    pub fn start_record(&mut self) {
        self.recorder = Some(Recorder::new(self.settings.build.text()));
    }

    /// What writes down calls, if they are written down.
    pub(crate) fn recorder(&mut self) -> &mut Option<Recorder> {
        &mut self.recorder
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

    /// Whether no worker has been there for the time of patience.
    pub fn is_without_workers(&self, now: u64) -> bool {
        now.saturating_sub(self.attended) >= self.settings.patience
    }

    /// How many workers can be asked.
    pub fn usable(&self, now: u64) -> usize {
        self.roster.usable(now).count()
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

    /// Keys of answers that were given to the caller, came from a worker that was shut out later, and were not
    /// compared. What was made of them must be made again.
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
            if let Some(recorder) = &mut self.recorder {
                recorder.submitted(now, key, (call.kind(), bytes.len() as u64, &call.inputs()));
            }
            let share = key.number() as f64 / u64::MAX as f64;
            let open = Open {
                bytes,
                kind: call.kind(),
                inputs: call.inputs(),
                compare: share < self.settings.checked,
                begun: None,
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
    pub fn handle(&mut self, now: u64, from: &str, bytes: &[u8], inside: &dyn Inside) {
        let Ok(message) = Message::from_bytes(bytes) else { return };
        match message {
            Message::Hello(hello) => {
                let (event, lost) = self.roster.greet(now, from, hello, &self.settings.build);
                self.news.extend(event);
                if lost {
                    self.calls.values_mut().for_each(|open| open.forget(from));
                }
            }
            Message::Want { content, part, only } => self.give(now, from, (content, part, only), inside),
            Message::Holds { contents } if self.roster.workers().contains_key(from) => {
                contents.into_iter().for_each(|content| self.sources.note(from, content));
            }
            // Only of a worker to which this process sent it for this content.
            Message::Wrong { content, peer } if self.sources.is_sent(from, &peer, &content) => {
                self.sources.doubt(&peer);
                self.news.push(format!(
                    "worker `{peer}` is no longer a source of contents: what it gave to `{from}` as {content:.16} was \
                     something else"
                ));
            }
            Message::Working { key } => {
                if let Some(open) = self.calls.get_mut(&key).filter(|open| open.asked.contains_key(from)) {
                    (open.progress, self.progress) = (now, now);
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
                    (open.progress, self.progress) = (now, now);
                    self.sources.note(from, answer);
                    let length = open.asked.get(from).and_then(|asked| asked.length);
                    let fresh = || Fetch::new(answer).at_most(open.kind.longest_answer()).of_length(length);
                    let fetch = open.fetches.entry(from.to_owned()).or_insert_with(fresh);
                    if fetch.content() != answer {
                        *fetch = fresh();
                    }
                }
            }
            Message::Part { content, part, length, bytes } => {
                self.take_part(now, from, (content, part, length, bytes), inside);
            }
            Message::Spent { key, spent } => {
                let asked = self.calls.get_mut(&key).and_then(|open| open.asked.get_mut(from));
                if let Some(asked) = asked {
                    asked.length = Some(spent.length);
                }
                if let Some(recorder) = &mut self.recorder {
                    recorder.spent(&key, from, &spent);
                }
            }
            Message::Absent { content } => self.drop_fetches(from, &content),
            Message::Ask { .. }
            | Message::Cancel { .. }
            | Message::Elsewhere { .. }
            | Message::Holds { .. }
            | Message::Wrong { .. }
            | Message::Demand { .. } => {}
        }
    }
}
