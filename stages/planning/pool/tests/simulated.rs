//! Workers and a network in simulated time: everything that happens follows from a seed.

use std::collections::BTreeMap;

use stillpoint_pool::{
    Arrival, Build, CallError, Courier, CourierError, Hash, Message, Spent, Store, To, Worker, WorkerSettings,
};

pub const MS: u64 = 1_000_000;
const TICK: u64 = 50 * MS;

pub fn build() -> Build {
    Build::of("the build of the tests")
}

/// What the network does to messages.
#[derive(Clone, Copy)]
pub struct Weather {
    /// Least delay and range of the rest, ns.
    pub delay: (u64, u64),
    /// Parts of messages that are lost and sent twice, of 1,000.
    pub lost: u64,
    pub doubled: u64,
}

pub const CALM: Weather = Weather { delay: (MS, MS), lost: 0, doubled: 0 };

/// A worker with its faults.
#[derive(Clone)]
pub struct Part {
    /// Time of a job, ns.
    pub job: u64,
    /// It is killed after so many jobs of a life, and begins a new one after a while; 0: never.
    pub dies_after: usize,
    /// It drains after so many jobs, and ends; 0: never.
    pub drains_after: usize,
    /// Its answers are wrong from this one on.
    pub wrong_from: usize,
    pub build: Build,
    pub cache: u64,
    /// It greets and takes calls, and answers none.
    pub mute: bool,
    /// What it gives to other workers is something else.
    pub gives_wrong: bool,
    /// Each life has a lower number than the one before: its clock is set back.
    pub clock_goes_back: bool,
}

impl Default for Part {
    fn default() -> Self {
        Self {
            job: 40 * MS,
            dies_after: 0,
            drains_after: 0,
            wrong_from: usize::MAX,
            build: build(),
            cache: 1 << 30,
            mute: false,
            gives_wrong: false,
            clock_goes_back: false,
        }
    }
}

struct Actor {
    name: String,
    part: Part,
    worker: Option<Worker>,
    folder: tempfile::TempDir,
    running: Vec<(u64, Hash, Result<Vec<u8>, CallError>)>,
    lives: u64,
    jobs_of_life: usize,
    jobs: usize,
    next_tick: u64,
    reborn: u64,
}

/// A message under way: to which worker (none: to the client), from whom, bytes.
type Posted = (Option<usize>, String, Vec<u8>);

pub struct Simulated {
    now: u64,
    seed: u64,
    number: u64,
    weather: Weather,
    /// By time of arrival and number.
    posted: BTreeMap<(u64, u64), Posted>,
    actors: Vec<Actor>,
    pub deaths: usize,
    /// Calls that were computed, as often as they were.
    pub computed: Vec<Hash>,
    pub bytes: u64,
    /// Parts of contents that workers gave to each other.
    pub given: usize,
}

impl Simulated {
    pub fn new(seed: u64, weather: Weather, parts: &[Part]) -> Self {
        let actors = parts.iter().enumerate().map(|(i, part)| Actor {
            name: format!("w{i}"),
            part: part.clone(),
            worker: None,
            folder: tempfile::tempdir().unwrap(),
            running: Vec::new(),
            lives: 0,
            jobs_of_life: 0,
            jobs: 0,
            next_tick: 0,
            reborn: 0,
        });
        let actors = actors.collect();
        Self {
            now: 0,
            seed,
            number: 0,
            weather,
            posted: BTreeMap::new(),
            actors,
            deaths: 0,
            computed: Vec::new(),
            bytes: 0,
            given: 0,
        }
    }

    pub fn jobs(&self) -> Vec<usize> {
        self.actors.iter().map(|actor| actor.jobs).collect()
    }

    /// SplitMix64.
    fn draw(&mut self, below: u64) -> u64 {
        self.seed = self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % below.max(1)
    }

    fn post(&mut self, to: Option<usize>, from: &str, bytes: Vec<u8>) {
        let copies = match self.draw(1000) {
            n if n < self.weather.lost => 0,
            n if n < self.weather.lost + self.weather.doubled => 2,
            _ => 1,
        };
        self.bytes += bytes.len() as u64;
        for _ in 0..copies {
            let at = self.now + self.weather.delay.0 + self.draw(self.weather.delay.1);
            self.number += 1;
            self.posted.insert((at, self.number), (to, from.to_owned(), bytes.clone()));
        }
    }

    /// The next moment at which something happens, up to `until`.
    fn next(&self, until: u64) -> u64 {
        let posted = self.posted.keys().next().map(|(at, _)| *at);
        let of_actor = |actor: &Actor| match &actor.worker {
            Some(_) => actor.running.iter().map(|(at, ..)| *at).chain([actor.next_tick]).min(),
            None => Some(actor.reborn),
        };
        posted.into_iter().chain(self.actors.iter().filter_map(of_actor)).min().unwrap_or(until).min(until)
    }

    fn act(&mut self, place: usize) {
        let now = self.now;
        let actor = &mut self.actors[place];
        if actor.worker.is_none() && now >= actor.reborn {
            actor.lives += 1;
            actor.jobs_of_life = 0;
            let settings = WorkerSettings {
                build: actor.part.build.clone(),
                incarnation: if actor.part.clock_goes_back { 1000 - actor.lives } else { actor.lives },
                slots: 1,
                most_open: 8 << 20,
            };
            actor.worker =
                Some(Worker::new(settings, Store::open(actor.folder.path(), actor.part.cache).unwrap()));
            actor.next_tick = now;
        }
        let Some(worker) = &mut actor.worker else { return };
        if now >= actor.next_tick {
            worker.tick(now);
            actor.next_tick = now + TICK;
        }
        let mut killed = false;
        while let Some(at) = actor.running.iter().position(|(at, ..)| *at <= now) {
            let (_, key, result) = actor.running.remove(at);
            actor.jobs += 1;
            self.computed.push(key);
            actor.jobs_of_life += 1;
            killed = actor.part.dies_after > 0 && actor.jobs_of_life >= actor.part.dies_after;
            if killed {
                break;
            }
            if !actor.part.mute {
                let computed = actor.part.job;
                worker.finish(key, result, Spent { computed, ..Spent::default() });
            }
        }
        if killed {
            actor.worker = None;
            actor.running.clear();
            actor.reborn = now + 700 * MS;
            self.deaths += 1;
            return;
        }
        if actor.part.drains_after > 0 && actor.jobs >= actor.part.drains_after {
            worker.drain();
            if worker.is_drained(now) {
                (actor.worker, actor.reborn) = (None, u64::MAX);
                return;
            }
        }
        while let Some(job) = worker.next_job() {
            let key = job.key;
            let mut result = job.open().and_then(|ready| ready.compute());
            if let Ok(bytes) = &mut result
                && actor.jobs + actor.running.len() >= actor.part.wrong_from
            {
                // The last bit of the last number: an answer of the right form.
                let last = bytes.len() - 8;
                bytes[last] ^= 1;
            }
            actor.running.push((now + actor.part.job, key, result));
        }
        let messages = worker.take_messages();
        let (name, gives_wrong) = (actor.name.clone(), actor.part.gives_wrong);
        for (to, mut message) in messages {
            if to == To::All || to == To::one("client") {
                self.post(None, &name, message.to_bytes());
            } else if let Some(peer) = self.actors.iter().position(|other| to == To::one(&other.name)) {
                if let Message::Part { bytes, .. } = &mut message {
                    self.given += 1;
                    bytes.iter_mut().filter(|_| gives_wrong).for_each(|byte| *byte ^= 1);
                }
                self.post(Some(peer), &name, message.to_bytes());
            }
        }
    }
}

impl Courier for Simulated {
    fn now(&self) -> u64 {
        self.now
    }

    fn send(&mut self, to: &To, bytes: Vec<u8>) {
        for place in 0..self.actors.len() {
            if *to == To::All || *to == To::One(self.actors[place].name.clone()) {
                self.post(Some(place), "client", bytes.clone());
            }
        }
    }

    fn receive(&mut self, until: u64) -> Result<Option<Arrival>, CourierError> {
        // A look at what has arrived takes time, too: nothing stands still.
        let until = until.max(self.now + 1000);
        loop {
            self.now = self.next(until).max(self.now);
            if let Some((&(at, number), _)) = self.posted.iter().next()
                && at <= self.now
                && let Some((to, from, bytes)) = self.posted.remove(&(at, number))
            {
                match to {
                    None => return Ok(Some(Arrival { from, bytes })),
                    Some(place) => {
                        if let Some(worker) = &mut self.actors[place].worker {
                            worker.handle(self.now, &from, &bytes);
                        }
                        self.act(place);
                    }
                }
                continue;
            }
            (0..self.actors.len()).for_each(|place| self.act(place));
            if self.now >= until {
                return Ok(None);
            }
        }
    }
}
