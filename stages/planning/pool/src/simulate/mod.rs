//! A recorded run with other workers and another network, in simulated time.
//!
//! The clients are those of the product: they choose workers, compare answers, and name from whom contents are fetched. A
//! client asks the recorded calls in their rounds, spends the recorded time between rounds, and its recorded time for each
//! byte of a message. Workers are modelled: a call takes the recorded time on each of them. The same record, workers and
//! network give the same outcome.
//!
//! - `script`: what a client asks, from a record
//! - `network`: hosts, their links, and messages under way
//! - `worker`: a worker as a model
//! - `player`: a client that follows its script

mod network;
mod player;
mod script;
mod worker;

use std::collections::BTreeSet;

pub use network::Network;
use network::{Links, Node, Posted};
use player::Player;
use script::Script;
pub use script::SimulationError;
use worker::Model;

use crate::{Hash, Message, Record, Tally};

/// What a simulation is of.
#[derive(Clone, Copy, Debug)]
pub struct Simulation {
    /// Workers, each with one slot and an empty cache.
    pub workers: usize,
    /// The network between all hosts. The clients are on one host.
    pub network: Network,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Number of workers.
    pub workers: usize,
    /// Time until the last client has all answers, s.
    pub seconds: f64,
    /// Computation of all different calls, s.
    pub work_s: f64,
    /// What workers did, sums over all of them.
    pub spent: WorkersSpent,
    /// Time of the clients between rounds, the longest of them, s.
    pub between_s: f64,
    /// Bytes that the host of the clients sent and received.
    pub sent: u64,
    /// See `sent`.
    pub received: u64,
    /// How calls were answered, sums over all clients.
    pub tally: Tally,
}

/// On what workers spent their slots, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorkersSpent {
    /// Computations of calls that no other worker computes.
    pub computed_s: f64,
    /// Computations of calls that another worker computes, too.
    pub repeated_s: f64,
    /// Opening arguments.
    pub opened_s: f64,
    /// A call is there, and its arguments are not.
    pub starved_s: f64,
}

impl Outcome {
    /// Computation of all different calls, for the time and the workers: 1 is perfect.
    pub fn efficiency(&self) -> f64 {
        self.work_s / self.seconds / self.workers as f64
    }
}

impl Simulation {
    /// Runs one client for each record.
    ///
    /// # Errors
    /// A record cannot be simulated.
    pub fn run(&self, records: &[&Record]) -> Result<Outcome, SimulationError> {
        let scripts: Result<Vec<Script>, _> =
            records.iter().enumerate().map(|(client, record)| Script::new(record, client)).collect();
        let scripts = scripts?;
        let connect = records.iter().map(|record| connect(record)).max().unwrap_or(0);
        let mut world = World::new(self, &scripts, connect);
        world.run();
        let mut spent = WorkersSpent::default();
        for model in &world.workers {
            spent.computed_s += model.spent.computed_s;
            spent.repeated_s += model.spent.repeated_s;
            spent.opened_s += model.spent.opened_s;
            spent.starved_s += model.spent.starved_s;
        }
        let ended = world.players.iter().filter_map(|player| player.ended).max().unwrap_or(0);
        let mut tally = Tally::default();
        for of in world.players.iter().map(Player::tally) {
            tally.remote += of.remote;
            tally.local += of.local;
            tally.compared += of.compared;
            tally.hedged += of.hedged;
        }
        let (sent, received) = world.links.of_clients();
        Ok(Outcome {
            workers: self.workers,
            seconds: ended as f64 * 1e-9,
            work_s: scripts.iter().map(Script::work_s).sum(),
            spent,
            between_s: scripts.iter().map(Script::between_s).fold(0.0, f64::max),
            sent,
            received,
            tally,
        })
    }
}

/// Time from the first round until the first worker was asked, ns: the way into the network.
fn connect(record: &Record) -> u64 {
    let begun_s = record.rounds.first().map_or(0.0, |round| round.begun_s);
    let asked =
        record.calls.iter().flat_map(|call| &call.attempts).filter(|attempt| attempt.worker.is_some());
    let first_s = asked.map(|attempt| attempt.asked_s).fold(f64::INFINITY, f64::min);
    if first_s.is_finite() { ((first_s - begun_s).max(0.0) * 1e9) as u64 } else { 0 }
}

/// What is under way at a time.
enum Happening {
    /// A message arrives.
    Arrival(Posted),
    /// A client looks at its clock.
    Tick(usize),
    /// A client begins its next round.
    Round(usize),
    /// A worker ends a call or greets.
    Worker(usize),
}

struct World<'s> {
    links: Links<Happening>,
    workers: Vec<Model>,
    players: Vec<Player<'s>>,
    scripts: &'s [Script],
    /// Calls that a worker began to compute.
    begun: BTreeSet<Hash>,
}

impl<'s> World<'s> {
    fn new(simulation: &Simulation, scripts: &'s [Script], connect: u64) -> Self {
        let mut links = Links::new(simulation.network, simulation.workers);
        let rates = script::Rates::of(scripts);
        let mut workers: Vec<Model> = (0..simulation.workers)
            .map(|place| {
                Model::new(
                    place,
                    rates,
                    connect + place as u64 * worker::HELLO / simulation.workers.max(1) as u64,
                )
            })
            .collect();
        for (place, model) in workers.iter_mut().enumerate() {
            model.wakes.drain(..).for_each(|at| links.at(at, Happening::Worker(place)));
        }
        let longest = scripts.iter().map(Script::longest_content).max().unwrap_or(0);
        let zeros: std::rc::Rc<[u8]> = vec![0; longest as usize].into();
        let players = scripts.iter().map(|script| Player::new(script, zeros.clone())).collect();
        for client in 0..scripts.len() {
            links.at(0, Happening::Round(client));
            links.at(player::TICK, Happening::Tick(client));
        }
        Self { links, workers, players, scripts, begun: BTreeSet::new() }
    }

    fn run(&mut self) {
        while self.players.iter().any(|player| player.ended.is_none()) {
            let Some((now, number, happening)) = self.links.next() else { return };
            match happening {
                Happening::Arrival(posted) => self.deliver(now, number, posted),
                Happening::Tick(client) => {
                    self.play(client, now, |player, now| player.tick(now));
                    if self.players[client].ended.is_none() {
                        self.links.at(now + player::TICK, Happening::Tick(client));
                    }
                }
                Happening::Round(client) => match self.players[client].free_at {
                    free_at if now < free_at => self.links.put_off(free_at, number, Happening::Round(client)),
                    _ => self.play(client, now, |player, now| player.begin_round(now)),
                },
                Happening::Worker(place) => self.act(now, place),
            }
        }
    }

    /// A client does something, and what it sends is under way.
    fn play(&mut self, client: usize, now: u64, action: impl FnOnce(&mut Player<'s>, u64)) {
        let player = &mut self.players[client];
        action(player, now);
        for (at, to, message) in std::mem::take(&mut player.out) {
            if let Some(worker) = worker::place_of(&to).filter(|worker| *worker < self.workers.len()) {
                let posted = Posted {
                    from: Node::Client(client),
                    to: Node::Worker(worker),
                    bytes: message.to_bytes(),
                };
                self.links.post(at, posted, Happening::Arrival);
            }
        }
        if let Some(at) = player.next_round.take() {
            self.links.at(at, Happening::Round(client));
        }
    }

    fn deliver(&mut self, now: u64, number: u64, posted: Posted) {
        match posted.to {
            Node::Client(client) => {
                let free_at = self.players[client].free_at;
                if now < free_at {
                    // The client is at work: the message waits, in front of those behind it.
                    return self.links.put_off(free_at, number, Happening::Arrival(posted));
                }
                let Node::Worker(worker) = posted.from else { return };
                let from = self.workers[worker].name.clone();
                self.play(client, now, |player, now| player.handle(now, &from, &posted.bytes));
            }
            Node::Worker(place) => {
                let Ok(message) = Message::from_bytes(&posted.bytes) else { return };
                self.workers[place].handle(now, (posted.from, message), self.scripts);
                self.act(now, place);
            }
        }
    }

    /// What a worker does by itself at this time.
    fn act(&mut self, now: u64, place: usize) {
        let model = &mut self.workers[place];
        model.act(now, self.scripts, &mut self.begun);
        model.wakes.drain(..).for_each(|at| self.links.at(at, Happening::Worker(place)));
        for (at, to, message) in std::mem::take(&mut model.out) {
            let bytes = message.to_bytes();
            let clients: Vec<Node> = match to {
                Some(node) => vec![node],
                None => (0..self.players.len()).map(Node::Client).collect(),
            };
            for to in clients {
                let posted = Posted { from: Node::Worker(place), to, bytes: bytes.clone() };
                self.links.post(at, posted, Happening::Arrival);
            }
        }
    }
}

#[cfg(test)]
mod tests;
