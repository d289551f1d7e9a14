//! The workers that a client knows.

use std::collections::{BTreeMap, BTreeSet};

use crate::call::Kind;
use crate::message::Hello;
use crate::{Build, Hash};

/// Time without a greeting after which a worker counts as gone, ns.
pub const SILENCE: u64 = 1_500_000_000;
/// Time for which a worker that was full is not asked, ns.
const FULL: u64 = 500_000_000;
/// The most workers.
const MOST: usize = 4096;

/// A worker, as a client sees it.
#[derive(Clone, Debug)]
pub struct WorkerState {
    /// Its last greeting.
    pub hello: Hello,
    /// When that came, ns.
    pub received: u64,
    /// Calls that it was asked and has not answered.
    pub outstanding: BTreeSet<Hash>,
    /// Calls that it answered.
    pub answered: u64,
    /// Kinds of calls of which an answer was found right.
    pub proven: BTreeSet<Kind>,
    /// Why it is not asked any more.
    pub shut_out: Option<String>,
    /// Whether that is for its build, which a new life may mend. A wrong answer is never forgotten.
    is_for_build: bool,
    full_until: u64,
    /// Another life greeted while this one was there.
    has_rival: bool,
}

/// All workers by name.
#[derive(Default)]
pub struct Roster {
    workers: BTreeMap<String, WorkerState>,
}

impl Roster {
    /// Takes a greeting. It gives an event to tell, and whether the worker has lost its calls: it began a new life.
    pub fn greet(&mut self, now: u64, name: &str, hello: Hello, build: &Build) -> (Option<String>, bool) {
        let other = (hello.build != build.text())
            .then(|| format!("it has another build: `{}` here, `{}` there", build.text(), hello.build));
        match self.workers.get_mut(name) {
            Some(worker) if worker.hello.incarnation == hello.incarnation => {
                (worker.received, worker.hello) = (now, hello);
                (None, false)
            }
            // A late greeting of an earlier life, or a second worker of this name. A new life waits until the life before it
            // is silent: so no other program takes the place of a worker that is there.
            Some(worker) if now.saturating_sub(worker.received) < SILENCE => {
                let is_new = worker.hello.incarnation < hello.incarnation && !worker.has_rival;
                worker.has_rival |= is_new;
                let event = is_new.then(|| {
                    format!(
                        "worker `{name}` was started anew, or another one has its name: it is asked when the one before has \
                         been silent for {:.1} s",
                        SILENCE as f64 * 1e-9
                    )
                });
                (event, false)
            }
            known => {
                if known.is_none() && self.workers.len() >= MOST {
                    return (None, false);
                }
                let before = self.workers.get(name).filter(|w| !w.is_for_build);
                let wrong = before.and_then(|w| w.shut_out.clone());
                let is_for_build = wrong.is_none() && other.is_some();
                let shut_out = wrong.or(other);
                let event = match &shut_out {
                    Some(reason) => format!("worker `{name}` is not asked: {reason}"),
                    None => format!("worker `{name}` is there, with {} slots", hello.slots),
                };
                let state = WorkerState {
                    hello,
                    received: now,
                    outstanding: BTreeSet::new(),
                    answered: 0,
                    proven: BTreeSet::new(),
                    shut_out,
                    is_for_build,
                    full_until: 0,
                    has_rival: false,
                };
                let was_there = self.workers.insert(name.to_owned(), state).is_some();
                (Some(event), was_there)
            }
        }
    }

    /// All of them.
    pub fn workers(&self) -> &BTreeMap<String, WorkerState> {
        &self.workers
    }

    /// One of them.
    pub fn get_mut(&mut self, name: &str) -> Option<&mut WorkerState> {
        self.workers.get_mut(name)
    }

    /// Whether a worker can be asked at all.
    pub fn is_usable(&self, now: u64, name: &str) -> bool {
        self.workers.get(name).is_some_and(|worker| is_usable(worker, now))
    }

    /// Whether a worker has more calls than slots.
    pub fn is_ahead(&self, name: &str) -> bool {
        self.workers.get(name).is_some_and(|w| w.outstanding.len() > w.hello.slots as usize)
    }

    /// Names of workers that can be asked at all.
    pub fn usable(&self, now: u64) -> impl Iterator<Item = &str> {
        self.workers.iter().filter(move |(_, w)| is_usable(w, now)).map(|(name, _)| name.as_str())
    }

    /// The worker with the most room that is none of these: by whether it is a second choice, by outstanding calls for its
    /// slots, by how many contents it lacks, then by name. It has at most `ahead` calls beyond its slots afterwards.
    pub fn pick(
        &self,
        now: u64,
        ahead: usize,
        except: impl Fn(&str) -> bool,
        is_second: impl Fn(&WorkerState) -> bool,
        lacks: impl Fn(&str) -> usize,
    ) -> Option<String> {
        let room = |w: &WorkerState| {
            is_usable(w, now) && now >= w.full_until && w.outstanding.len() < w.hello.slots as usize + ahead
        };
        let load = |w: &WorkerState| w.outstanding.len() as f64 / f64::from(w.hello.slots.max(1));
        let free = self.workers.iter().filter(|(name, w)| room(w) && !except(name));
        let by = |(one, a): &(&String, &WorkerState), (other, b): &(&String, &WorkerState)| {
            let rank = is_second(a).cmp(&is_second(b)).then_with(|| load(a).total_cmp(&load(b)));
            rank.then_with(|| lacks(one).cmp(&lacks(other)))
        };
        free.min_by(by).map(|(name, _)| name.clone())
    }

    /// A worker said that it has no room.
    pub fn full(&mut self, now: u64, name: &str) {
        if let Some(worker) = self.workers.get_mut(name) {
            worker.full_until = now + FULL;
        }
    }
}

fn is_usable(worker: &WorkerState, now: u64) -> bool {
    worker.shut_out.is_none() && now.saturating_sub(worker.received) < SILENCE && worker.hello.slots > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hello(incarnation: u64) -> Hello {
        Hello {
            build: "b".to_owned(),
            incarnation,
            slots: 1,
            running: 0,
            waiting: 0,
            answered: 0,
            known: 0,
            cache: 0,
            cache_most: 0,
        }
    }

    #[test]
    fn a_worker_that_is_gone_comes_back_although_its_clock_was_set_back_and_a_late_greeting_does_not() {
        let (mut roster, build) = (Roster::default(), Build::of("b"));
        roster.greet(0, "w", hello(1000), &build);
        assert_eq!(roster.greet(SILENCE - 1, "w", hello(997), &build), (None, false));
        assert!(!roster.is_usable(SILENCE, "w"));
        let (event, is_new_life) = roster.greet(SILENCE, "w", hello(997), &build);
        assert!(event.is_some() && is_new_life && roster.is_usable(SILENCE, "w"));
    }

    #[test]
    fn another_program_cannot_take_the_name_of_a_worker_that_is_there() {
        let (mut roster, build) = (Roster::default(), Build::of("b"));
        roster.greet(0, "w", hello(1), &build);
        let (event, is_new_life) = roster.greet(1, "w", hello(2), &build);
        assert!(event.unwrap().contains("or another one has its name") && !is_new_life);
        // The worker goes on to greet, and so does the other: nothing changes, and it is printed once.
        for at in (SILENCE / 2..4 * SILENCE).step_by(SILENCE as usize / 2) {
            assert_eq!(roster.greet(at, "w", hello(1), &build), (None, false));
            assert_eq!(roster.greet(at + 1, "w", hello(2), &build), (None, false));
        }
        assert_eq!(roster.workers()["w"].hello.incarnation, 1);
        // When the worker has ended, the other one is a new life.
        let (event, is_new_life) = roster.greet(6 * SILENCE, "w", hello(2), &build);
        assert!(event.unwrap().contains("is there") && is_new_life);
    }

    #[test]
    fn a_worker_is_asked_again_once_its_build_is_right_and_never_after_a_wrong_answer() {
        let (mut roster, build) = (Roster::default(), Build::of("b"));
        let other = |incarnation| Hello { build: "c".to_owned(), ..hello(incarnation) };
        let (event, _) = roster.greet(0, "w", other(1), &build);
        assert!(event.unwrap().contains("is not asked: it has another build") && !roster.is_usable(0, "w"));
        let (event, _) = roster.greet(SILENCE, "w", hello(2), &build);
        assert!(event.unwrap().contains("is there") && roster.is_usable(SILENCE, "w"));
        roster.get_mut("w").unwrap().shut_out = Some("its answer was wrong".to_owned());
        // Neither a new life nor another build in between is a way round it.
        for (at, hello) in [(2, hello(3)), (3, other(4)), (4, hello(5))] {
            let at = at * SILENCE;
            let (event, _) = roster.greet(at, "w", hello, &build);
            assert!(event.unwrap().contains("is not asked: its answer was wrong"), "{at}");
            assert!(!roster.is_usable(at, "w"), "{at}");
        }
    }
}
