//! A worker as a model: it fetches what its calls need, one content after the other, and computes one call at a time.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::WorkersSpent;
use super::network::Node;
use super::script::{Rates, Script};
use crate::fetch::OUTSTANDING;
use crate::message::{Hello, INLINE, Message, PART, Spent};
use crate::{Call, Hash};

pub use crate::worker::HELLO;

/// What names of workers begin with; their place follows.
const NAME: &str = "worker-";

/// The place of the worker of this name.
pub fn place_of(to: &crate::To) -> Option<usize> {
    match to {
        crate::To::One(name) => name.strip_prefix(NAME)?.parse().ok(),
        crate::To::All => None,
    }
}

/// A call that waits.
struct Waiting {
    key: Hash,
    client: usize,
    place: usize,
    inputs: Vec<Hash>,
    since: u64,
}

/// A call that is computed.
struct Running {
    end: u64,
    key: Hash,
    client: usize,
    place: usize,
    spent: Spent,
}

/// A content on its way.
struct Fetched {
    from: Node,
    asker: usize,
    content: Hash,
    length: Option<u64>,
    asked: u32,
    received: u64,
    only: bool,
}

impl Fetched {
    fn of(content: Hash, asker: usize) -> Self {
        let from = Node::Client(asker);
        Self { from, asker, content, length: None, asked: 0, received: 0, only: false }
    }
}

/// A worker.
pub struct Model {
    /// Its name.
    pub name: String,
    /// Messages, with the time of sending; to all clients where nobody is named.
    pub out: Vec<(u64, Option<Node>, Message)>,
    /// Times at which it does something by itself, ns.
    pub wakes: Vec<u64>,
    /// On what it spent its slot.
    pub spent: WorkersSpent,
    rates: Rates,
    holds: BTreeSet<Hash>,
    opened: BTreeSet<Hash>,
    waiting: VecDeque<Waiting>,
    running: Option<Running>,
    /// Calls that were answered, with their times.
    done: BTreeMap<Hash, Spent>,
    fetch: Option<Fetched>,
    /// When what arrived is compared with its name and stored, ns.
    stored_at: u64,
    /// When it greets next, ns.
    next_hello: u64,
    /// When its slot was last given free, ns.
    free_since: u64,
}

impl Model {
    /// At this place, greeting from this time on.
    pub fn new(place: usize, rates: Rates, next_hello: u64) -> Self {
        Self {
            name: format!("{NAME}{place}"),
            next_hello,
            out: Vec::new(),
            wakes: vec![next_hello],
            spent: WorkersSpent::default(),
            rates,
            holds: BTreeSet::new(),
            opened: BTreeSet::new(),
            waiting: VecDeque::new(),
            running: None,
            done: BTreeMap::new(),
            fetch: None,
            stored_at: 0,
            free_since: 0,
        }
    }

    fn send(&mut self, at: u64, to: Node, message: Message) {
        self.out.push((at, Some(to), message));
    }

    /// Takes a message.
    pub fn handle(&mut self, now: u64, (from, message): (Node, Message), scripts: &[Script]) {
        match message {
            Message::Ask { key, call } => self.ask(now, from, (key, &call), scripts),
            Message::Cancel { key } => self.waiting.retain(|waiting| waiting.key != key),
            Message::Want { content, part, .. } => {
                let message = self.part(content, part, scripts);
                self.send(now, from, message);
            }
            Message::Elsewhere { content, peer } => {
                let to = crate::To::one(&peer);
                if let Some(fetch) = self.fetch.as_mut().filter(|fetch| fetch.content == content)
                    && let Some(peer) = place_of(&to)
                {
                    *fetch = Fetched { from: Node::Worker(peer), ..Fetched::of(content, fetch.asker) };
                }
            }
            Message::Absent { content } => {
                if let Some(fetch) = self.fetch.as_mut().filter(|fetch| fetch.content == content) {
                    *fetch = Fetched { only: true, ..Fetched::of(content, fetch.asker) };
                }
            }
            Message::Part { content, length, bytes, .. } => self.take_part(now, content, length, bytes.len()),
            _ => {}
        }
    }

    fn ask(&mut self, now: u64, from: Node, (key, bytes): (Hash, &[u8]), scripts: &[Script]) {
        let Node::Client(client) = from else { return };
        if let Some(spent) = self.done.get(&key).copied() {
            return self.answer(now, (key, client), spent, scripts);
        }
        let is_known = self.waiting.iter().any(|waiting| waiting.key == key)
            || self.running.as_ref().is_some_and(|running| running.key == key);
        self.send(now, from, Message::Working { key });
        let (Ok(call), Some(place)) = (Call::from_bytes(bytes), scripts[client].places.get(&key)) else {
            return;
        };
        if is_known {
            return;
        }
        let inputs = call.inputs();
        let contents: Vec<Hash> = inputs.iter().copied().filter(|input| self.holds.contains(input)).collect();
        if !contents.is_empty() {
            self.send(now, from, Message::Holds { contents });
        }
        self.waiting.push_back(Waiting { key, client, place: *place, inputs, since: now });
    }

    fn part(&self, content: Hash, part: u32, scripts: &[Script]) -> Message {
        let held = self.holds.contains(&content);
        let answer = scripts.iter().find_map(|script| Some(&script.calls[*script.answers.get(&content)?]));
        let other = || {
            let length = scripts.iter().find_map(|script| script.lengths.get(&content))?;
            let rest = length.checked_sub(u64::from(part) * PART as u64)?;
            Some((*length, vec![0; rest.min(PART as u64) as usize]))
        };
        let bytes = match answer {
            Some(asked) => asked.part(part, PART).map(|bytes| (asked.length, bytes)),
            None => other(),
        };
        match bytes.filter(|_| held) {
            Some((length, bytes)) => Message::Part { content, part, length, bytes },
            None => Message::Absent { content },
        }
    }

    fn take_part(&mut self, now: u64, content: Hash, length: u64, bytes: usize) {
        let Some(fetch) = self.fetch.as_mut().filter(|fetch| fetch.content == content) else { return };
        fetch.length = Some(length);
        fetch.received += bytes as u64;
        let time = (bytes as f64 * self.rates.received) as u64;
        self.stored_at = self.stored_at.max(now) + time;
        if fetch.received >= length {
            self.fetch = None;
            self.holds.insert(content);
            let askers: BTreeSet<usize> = self.waiting.iter().map(|waiting| waiting.client).collect();
            for asker in askers {
                self.send(now, Node::Client(asker), Message::Holds { contents: vec![content] });
            }
        }
    }

    /// What it does at this time by itself.
    pub fn act(&mut self, now: u64, scripts: &[Script], begun: &mut BTreeSet<Hash>) {
        if self.running.as_ref().is_some_and(|running| running.end <= now)
            && let Some(Running { key, client, place, spent, .. }) = self.running.take()
        {
            self.done.insert(key, spent);
            self.free_since = now;
            // Its own answers are among its contents: a dose that it computed needs no fetch.
            let asked = &scripts[client].calls[place];
            self.holds.insert(asked.answer);
            let stored = now + (asked.length as f64 * self.rates.received) as u64;
            self.answer(stored, (key, client), spent, scripts);
        }
        if self.running.is_none() {
            let is_ready = |waiting: &Waiting| waiting.inputs.iter().all(|input| self.holds.contains(input));
            let at = self.by_haste(scripts).into_iter().find(|at| is_ready(&self.waiting[*at]));
            if let Some(waiting) = at.and_then(|at| self.waiting.remove(at)) {
                self.begin(now, &waiting, scripts, begun);
            }
        }
        if self.next_hello <= now {
            self.next_hello = now + HELLO;
            self.wakes.push(self.next_hello);
            for (client, script) in scripts.iter().enumerate() {
                self.send(now, Node::Client(client), Message::Hello(self.hello(script.build.text())));
            }
        }
        self.fetch(now, scripts);
    }

    /// Places of calls that wait, those first for which a search waits.
    fn by_haste(&self, scripts: &[Script]) -> Vec<usize> {
        let is_hasty = |at: &usize| {
            let Waiting { client, place, .. } = self.waiting[*at];
            scripts[client].calls[place].call.kind().is_hasty()
        };
        let (hasty, others): (Vec<usize>, Vec<usize>) = (0..self.waiting.len()).partition(is_hasty);
        [hasty, others].concat()
    }

    fn begin(&mut self, now: u64, waiting: &Waiting, scripts: &[Script], begun: &mut BTreeSet<Hash>) {
        let Waiting { key, client, place, ref inputs, since } = *waiting;
        let script = &scripts[client];
        let asked = &script.calls[place];
        let rate = self.rates.of_kind(asked.call.kind());
        let fresh = inputs.iter().filter(|input| self.opened.insert(**input));
        let bytes: u64 = fresh.filter_map(|input| script.lengths.get(input)).sum();
        let opened = (bytes as f64 * rate) as u64;
        let start = now.max(self.stored_at);
        let end = start + opened + asked.computed;
        let is_first = begun.insert(key);
        let computed_s = asked.computed as f64 * 1e-9;
        match is_first {
            true => self.spent.computed_s += computed_s,
            false => self.spent.repeated_s += computed_s,
        }
        self.spent.opened_s += opened as f64 * 1e-9;
        self.spent.starved_s += start.saturating_sub(since.max(self.free_since)) as f64 * 1e-9;
        let spent = Spent { received: 0, opened, computed: asked.computed, length: asked.length };
        self.running = Some(Running { end, key, client, place, spent });
        self.wakes.push(end);
    }

    fn answer(&mut self, at: u64, (key, client): (Hash, usize), spent: Spent, scripts: &[Script]) {
        let to = Node::Client(client);
        let Some(asked) = scripts[client].places.get(&key).map(|place| &scripts[client].calls[*place]) else {
            return;
        };
        self.send(at, to, Message::Spent { key, spent });
        let message = match asked.length as usize <= INLINE {
            true => Message::Answer { key, bytes: asked.body() },
            false => Message::Done { key, answer: asked.answer },
        };
        self.send(at, to, message);
    }

    /// Asks for parts of the first content that a waiting call lacks.
    fn fetch(&mut self, now: u64, scripts: &[Script]) {
        let is_needed = |content: &Hash, waiting: &VecDeque<Waiting>| {
            waiting.iter().any(|waiting| waiting.inputs.contains(content))
        };
        if self.fetch.as_ref().is_some_and(|fetch| !is_needed(&fetch.content, &self.waiting)) {
            self.fetch = None;
        }
        if self.fetch.is_none() {
            let missing = self.by_haste(scripts).into_iter().find_map(|at| {
                let waiting = &self.waiting[at];
                let content = waiting.inputs.iter().find(|input| !self.holds.contains(input))?;
                Some((*content, waiting.client))
            });
            self.fetch = missing.map(|(content, client)| Fetched::of(content, client));
        }
        let Some(fetch) = &mut self.fetch else { return };
        // The first part says how many there are.
        let parts = fetch.length.map_or(1, |length| length.div_ceil(PART as u64).max(1) as u32);
        let until = parts.min((fetch.received / PART as u64) as u32 + OUTSTANDING as u32);
        let (from, content, only) = (fetch.from, fetch.content, fetch.only);
        let wants = fetch.asked..until;
        fetch.asked = fetch.asked.max(until);
        for part in wants {
            self.send(now, from, Message::Want { content, part, only });
        }
    }

    fn hello(&self, build: &str) -> Hello {
        Hello {
            build: build.to_owned(),
            incarnation: 1,
            slots: 1,
            running: u32::from(self.running.is_some()),
            waiting: self.waiting.len() as u32,
            answered: self.done.len() as u64,
            known: 0,
            cache: 0,
            cache_most: 1 << 40,
        }
    }
}
