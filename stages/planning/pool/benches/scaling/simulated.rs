//! Workers and a network in simulated time.
//!
//! Every host has a link of the same bandwidth in each direction to a switch that never is the narrowest part. Messages
//! above 16 KiB follow each other on a link; shorter ones travel beside them, as on the pool's two connections. A
//! worker has one slot, an empty cache, and fetches contents from the client, or from the worker that the client names, as
//! `Worker` does.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::rc::Rc;

use stillpoint_pool::{Arrival, Call, Courier, CourierError, Hash, Hello, INLINE, Message, PART, To};

use crate::oracle::{Oracle, build, cpu};

/// Time between two greetings, ns.
const HELLO: u64 = 200_000_000;
/// Longest message that travels beside bulk, bytes.
const SMALL: usize = 16 << 10;
/// Parts that a worker asks for at a time.
const OUTSTANDING: u32 = 4;

#[derive(Clone, Copy)]
pub struct Network {
    pub bits_per_s: f64,
    /// Time of a message without its bytes, ns.
    pub delay: u64,
}

/// When the two directions of a host's link are free, ns.
#[derive(Clone, Copy, Default)]
struct SimulatedLink {
    up: u64,
    down: u64,
}

/// A worker: what it holds, and what it does.
struct Model {
    name: String,
    line: SimulatedLink,
    holds: BTreeSet<Hash>,
    waiting: VecDeque<(Hash, Vec<u8>, Call)>,
    /// End of the computation and its call.
    running: Option<(u64, Hash, Vec<u8>)>,
    /// Answers that are fetched in parts.
    answers: BTreeMap<Hash, Rc<Vec<u8>>>,
    fetch: Option<Fetched>,
    /// When the contents that arrived are checked and kept.
    taken_in: u64,
    next_hello: u64,
}

/// A content on its way to a worker, from the client or from another worker.
struct Fetched {
    from: Option<usize>,
    content: Hash,
    length: Option<u64>,
    asked: u32,
    bytes: Vec<u8>,
}

/// A message: to which worker, from which worker (none: the client), bytes.
type Posted = (Option<usize>, Option<usize>, Vec<u8>);
/// Messages of a worker: to which worker, or to the client.
type Out = Vec<(Option<usize>, Message)>;

pub struct Simulated {
    now: u64,
    /// CPU time when this thread last went back to the client.
    mark: u64,
    client: u64,
    sent: u64,
    oracle: Rc<RefCell<Oracle>>,
    network: Network,
    line: SimulatedLink,
    models: Vec<Model>,
    number: u64,
    /// By time of arrival and number.
    posted: BTreeMap<(u64, u64), Posted>,
}

impl Simulated {
    pub fn new(oracle: &Rc<RefCell<Oracle>>, network: Network, workers: usize) -> Self {
        let model = |place: usize| Model {
            name: format!("w{place:02}"),
            line: SimulatedLink::default(),
            holds: BTreeSet::new(),
            waiting: VecDeque::new(),
            running: None,
            answers: BTreeMap::new(),
            fetch: None,
            taken_in: 0,
            // They greet one after the other.
            next_hello: place as u64 * HELLO / workers as u64,
        };
        Self {
            now: 0,
            mark: cpu(),
            client: 0,
            sent: 0,
            oracle: oracle.clone(),
            network,
            line: SimulatedLink::default(),
            models: (0..workers).map(model).collect(),
            number: 0,
            posted: BTreeMap::new(),
        }
    }

    /// CPU time of the client, s.
    pub fn client_s(&self) -> f64 {
        self.client as f64 * 1e-9
    }

    /// What the client sent, MB.
    pub fn sent_mb(&self) -> f64 {
        self.sent as f64 * 1e-6
    }

    /// The time that the client has worked since it was last here passes.
    fn enter(&mut self) {
        let worked = cpu() - self.mark;
        self.now += worked;
        self.client += worked;
        self.mark = cpu();
    }

    fn line(&mut self, of: Option<usize>) -> &mut SimulatedLink {
        match of {
            Some(place) => &mut self.models[place].line,
            None => &mut self.line,
        }
    }

    fn post(&mut self, at: u64, from: Option<usize>, to: Option<usize>, bytes: Vec<u8>) {
        let span = (bytes.len() as f64 * 8e9 / self.network.bits_per_s) as u64;
        let arrival = if bytes.len() <= SMALL {
            at + span + self.network.delay
        } else {
            let up = &mut self.line(from).up;
            *up = at.max(*up) + span;
            let sent = *up + self.network.delay;
            let down = &mut self.line(to).down;
            *down = sent.max(*down + span);
            *down
        };
        self.number += 1;
        self.posted.insert((arrival, self.number), (to, from, bytes));
    }

    /// The next moment at which a worker does something by itself.
    fn next_of(model: &Model) -> u64 {
        model.running.as_ref().map_or(u64::MAX, |(end, ..)| *end).min(model.next_hello)
    }

    /// What a worker does at this moment by itself.
    fn act(&mut self, now: u64, place: usize) {
        let mut out: Out = Vec::new();
        let model = &mut self.models[place];
        if let Some((_, key, call)) = model.running.take_if(|(end, ..)| *end <= now) {
            let mut oracle = self.oracle.borrow_mut();
            let bytes = oracle.answer(key, &call).0.to_vec();
            if bytes.len() <= INLINE {
                out.push((None, Message::Answer { key, bytes }));
            } else {
                let answer = Hash::of(&bytes);
                // Its own answers are among its contents: a dose that it computed needs no fetch.
                model.holds.insert(answer);
                if !oracle.holds(&answer) {
                    oracle.give(answer, bytes.clone());
                }
                model.answers.insert(answer, Rc::new(bytes));
                out.push((None, Message::Done { key, answer }));
            }
        }
        if model.next_hello <= now {
            model.next_hello += HELLO;
            out.push((None, Message::Hello(hello())));
        }
        out.extend(model.go_on(now, &mut self.oracle.borrow_mut()));
        out.into_iter().for_each(|(to, message)| self.post(now, Some(place), to, message.to_bytes()));
    }

    fn deliver(&mut self, now: u64, from: Option<usize>, place: usize, bytes: &[u8]) {
        let message = Message::from_bytes(bytes).unwrap();
        // Names of workers are their places.
        let peer = match &message {
            Message::Elsewhere { peer, .. } => self.models.iter().position(|model| model.name == *peer),
            _ => None,
        };
        let model = &mut self.models[place];
        let mut out = model.handle(now, (from, message, peer), &mut self.oracle.borrow_mut());
        out.extend(model.go_on(now, &mut self.oracle.borrow_mut()));
        out.into_iter().for_each(|(to, message)| self.post(now, Some(place), to, message.to_bytes()));
    }
}

impl Model {
    fn handle(
        &mut self,
        now: u64,
        (from, message, peer): (Option<usize>, Message, Option<usize>),
        oracle: &mut Oracle,
    ) -> Out {
        match message {
            Message::Ask { key, call } => {
                let is_new = self.waiting.iter().all(|(of, ..)| *of != key)
                    && self.running.as_ref().is_none_or(|(_, of, _)| *of != key);
                let mut out = vec![(None, Message::Working { key })];
                if is_new {
                    let read = Call::from_bytes(&call).unwrap();
                    let held = |hash: &Hash| self.holds.contains(hash);
                    let contents: Vec<Hash> = read.inputs().into_iter().filter(held).collect();
                    if !contents.is_empty() {
                        out.push((None, Message::Holds { contents }));
                    }
                    self.waiting.push_back((key, call, read));
                }
                out
            }
            Message::Cancel { key } => {
                self.waiting.retain(|(of, ..)| *of != key);
                Vec::new()
            }
            Message::Want { content, part, .. } => {
                let answer = self.answers.get(&content).cloned();
                let held = answer.as_deref().map(Vec::as_slice);
                let held =
                    held.or_else(|| self.holds.contains(&content).then(|| oracle.content(&content))?);
                let Some(bytes) = held else { return vec![(from, Message::Absent { content })] };
                let start = part as usize * PART;
                let end = bytes.len().min(start + PART);
                let (length, bytes) = (bytes.len() as u64, bytes[start..end].to_vec());
                vec![(from, Message::Part { content, part, length, bytes })]
            }
            Message::Elsewhere { content, .. } => {
                if let Some(fetch) = self.fetch.as_mut().filter(|fetch| fetch.content == content) {
                    *fetch = Fetched { from: peer, ..Fetched::of(content) };
                }
                Vec::new()
            }
            Message::Absent { content } => panic!("{content:?} is not where the client says"),
            Message::Part { content, length, bytes, .. } => {
                let mut out = Vec::new();
                if let Some(fetch) = self.fetch.as_mut().filter(|fetch| fetch.content == content) {
                    // Parts come in their order on a link.
                    fetch.length = Some(length);
                    fetch.bytes.extend(bytes);
                    if fetch.bytes.len() as u64 == length
                        && let Some(fetch) = self.fetch.take()
                    {
                        self.holds.insert(content);
                        out.push((None, Message::Holds { contents: vec![content] }));
                        self.taken_in = now.max(self.taken_in) + oracle.intake(length);
                        if !oracle.holds(&content) {
                            assert!(Hash::of(&fetch.bytes) == content);
                            oracle.give(content, fetch.bytes);
                        }
                    }
                }
                out
            }
            other => panic!("{other:?} is nothing that a client sends to a worker"),
        }
    }

    /// Fetches what is missing, and begins to compute.
    fn go_on(&mut self, now: u64, oracle: &mut Oracle) -> Out {
        if self.running.is_none()
            && let Some((_, _, call)) = self.waiting.front()
            && call.inputs().iter().all(|content| self.holds.contains(content))
            && let Some((key, call, _)) = self.waiting.pop_front()
        {
            let (_, time) = oracle.answer(key, &call);
            self.running = Some((now.max(self.taken_in) + time, key, call));
        }
        if self.fetch.is_none() {
            let missing = self.waiting.iter().flat_map(|(.., call)| call.inputs());
            let missing = missing.into_iter().find(|content| !self.holds.contains(content));
            self.fetch = missing.map(Fetched::of);
        }
        let Some(fetch) = &mut self.fetch else { return Vec::new() };
        // The first part says how many there are.
        let parts = fetch.length.map_or(1, |length| length.div_ceil(PART as u64) as u32);
        let until = parts.min((fetch.bytes.len() / PART) as u32 + OUTSTANDING);
        let (from, content) = (fetch.from, fetch.content);
        let want = |part| (from, Message::Want { content, part, only: false });
        let wants = (fetch.asked..until).map(want).collect();
        fetch.asked = fetch.asked.max(until);
        wants
    }
}

impl Fetched {
    fn of(content: Hash) -> Self {
        Self { from: None, content, length: None, asked: 0, bytes: Vec::new() }
    }
}

fn hello() -> Hello {
    Hello {
        build: build().text().to_owned(),
        incarnation: 1,
        slots: 1,
        running: 0,
        waiting: 0,
        answered: 0,
        known: 0,
        cache: 0,
        cache_most: 1 << 40,
    }
}

impl Courier for Simulated {
    fn now(&self) -> u64 {
        self.now + (cpu() - self.mark)
    }

    fn send(&mut self, to: &To, bytes: Vec<u8>) {
        self.enter();
        self.sent += bytes.len() as u64;
        if let Some(place) = self.models.iter().position(|model| *to == To::One(model.name.clone())) {
            self.post(self.now, None, Some(place), bytes);
        }
        self.mark = cpu();
    }

    fn receive(&mut self, until: u64) -> Result<Option<Arrival>, CourierError> {
        self.enter();
        let until = until.max(self.now);
        let arrival = loop {
            let posted = self.posted.first_key_value().map_or(u64::MAX, |((at, _), _)| *at);
            let (of_model, place) = (self.models.iter().enumerate())
                .map(|(place, model)| (Self::next_of(model), place))
                .min()
                .unwrap_or((u64::MAX, 0));
            if posted.min(of_model) > until {
                self.now = until;
                break None;
            }
            if of_model < posted {
                self.act(of_model, place);
                continue;
            }
            let Some(((at, _), (to, from, bytes))) = self.posted.pop_first() else { break None };
            match (to, from) {
                (Some(place), from) => self.deliver(at, from, place, &bytes),
                (None, Some(place)) => {
                    self.now = self.now.max(at);
                    break Some(Arrival { from: self.models[place].name.clone(), bytes });
                }
                (None, None) => {}
            }
        };
        self.mark = cpu();
        Ok(arrival)
    }
}
