//! A client that asks the calls of its script in their rounds. Its own time passes as it was recorded.

use std::collections::BTreeSet;
use std::rc::Rc;

use super::script::Script;
use crate::client::Inside;
use crate::{CallError, Client, ClientSettings, Event, Hash, Message, Tally, To};

/// Longest time between two looks at the clock, ns, as in [`crate::Pool`].
pub const TICK: u64 = 20_000_000;

/// A client with its script.
pub struct Player<'s> {
    /// When it has all answers, ns.
    pub ended: Option<u64>,
    /// Until when it is at work, ns.
    pub free_at: u64,
    /// Messages with their time.
    pub out: Vec<(u64, To, Message)>,
    /// When its next round begins, ns, if that is to be noted.
    pub next_round: Option<u64>,
    client: Client,
    script: &'s Script,
    contents: Contents<'s>,
    round: usize,
    /// Whether it is in the round, and not in its own work before it.
    is_asking: bool,
    answered: BTreeSet<usize>,
}

/// Contents as zeros: a worker of the simulation counts them only.
struct Contents<'s> {
    script: &'s Script,
    zeros: Rc<[u8]>,
}

impl Inside for Contents<'_> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        self.script.lengths.get(hash).and_then(|length| self.zeros.get(..*length as usize))
    }

    fn check(&self, _: &Hash, _: &[u8]) -> Result<(), CallError> {
        Ok(())
    }
}

impl<'s> Player<'s> {
    /// Of this script.
    pub fn new(script: &'s Script, zeros: Rc<[u8]>) -> Self {
        let settings = ClientSettings::new(script.build.clone());
        Self {
            ended: None,
            free_at: 0,
            out: Vec::new(),
            next_round: None,
            client: Client::new(0, settings),
            script,
            contents: Contents { script, zeros },
            round: 0,
            is_asking: false,
            answered: BTreeSet::new(),
        }
    }

    /// How its calls were answered.
    pub fn tally(&self) -> Tally {
        self.client.tally()
    }

    /// Asks the calls of its next round.
    pub fn begin_round(&mut self, now: u64) {
        self.is_asking = true;
        let is_open = |place: &&usize| {
            let after = self.script.calls[**place].after;
            !self.answered.contains(place) && after.is_none_or(|after| self.answered.contains(&after))
        };
        for place in self.script.rounds[self.round].calls.iter().filter(is_open) {
            self.client.submit(now, &self.script.calls[*place].call);
        }
        self.go_on(now);
    }

    /// Looks at its clock, unless it is at work.
    pub fn tick(&mut self, now: u64) {
        if self.is_asking && now >= self.free_at {
            self.go_on(now);
        }
    }

    /// Takes a message.
    pub fn handle(&mut self, now: u64, from: &str, bytes: &[u8]) {
        self.client.handle(now, from, bytes, &self.contents);
        let now = now + (bytes.len() as f64 * self.script.handled) as u64;
        self.free_at = now;
        if self.is_asking {
            self.go_on(now);
        }
    }

    fn go_on(&mut self, mut now: u64) {
        loop {
            self.client.tick(now);
            let messages = self.client.take_messages();
            self.out.extend(messages.into_iter().map(|(to, message)| (now, to, message)));
            if self.script.rounds[self.round].needs.iter().all(|place| self.answered.contains(place)) {
                self.end_round(now);
                return;
            }
            match self.client.next_event() {
                Some(Event::Answer(key, _)) => {
                    if let Some(place) = self.script.places.get(&key) {
                        self.answered.insert(*place);
                        let asked = &self.script.calls[*place];
                        now += asked.taken;
                        for follower in asked.followers.iter().filter(|place| !self.answered.contains(place))
                        {
                            self.client.submit(now, &self.script.calls[*follower].call);
                        }
                    }
                }
                Some(Event::Compute(key)) => {
                    if let Some(place) = self.script.places.get(&key) {
                        let asked = &self.script.calls[*place];
                        now += asked.computed;
                        self.client.settle(&key, asked.body());
                    }
                }
                None => break,
            }
            self.free_at = now;
        }
        self.free_at = now;
    }

    /// Goes on behind a round.
    fn end_round(&mut self, now: u64) {
        self.is_asking = false;
        match self.script.after(self.round) {
            Some(own) => {
                self.round += 1;
                (self.free_at, self.next_round) = (now + own, Some(now + own));
            }
            None => self.ended = Some(now),
        }
    }
}
