//! The solver of a search whose answers come later: it collects the calls that it has no answer for.
//!
//! A search that is begun again with the answers, and with the memo of the run before, goes on behind the place where it
//! waited: so a search needs no thread of its own that waits.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use stillpoint_plan::beams::{BeamSet, Evaluated, Solver, Stop};

use crate::setup::DoseFiles;
use crate::{Build, Call, Hash, PoolSetup, answer};

/// Solves and prices by answers that are there, and collects calls for the others.
pub struct LaterSolver<'a, I: DoseFiles + ?Sized> {
    setup: &'a PoolSetup<'a, I>,
    build: &'a Build,
    /// By the key of the call.
    answers: &'a BTreeMap<Hash, Arc<Vec<u8>>>,
    requested: Requested,
}

/// Calls without an answer.
#[derive(Default)]
pub struct Requested {
    /// The calls, by key.
    pub calls: BTreeMap<Hash, Call>,
    /// The plans that they name, by name.
    pub plans: BTreeMap<Hash, Vec<u8>>,
    /// Keys of the calls without which the search cannot go on. The others are of leaves that it takes later.
    pub awaited: BTreeSet<Hash>,
    /// Keys of solves that were begun and are not taken yet.
    pub begun: BTreeSet<Hash>,
}

impl<'a, I: DoseFiles + ?Sized> LaterSolver<'a, I> {
    /// With these answers, which have the form that their calls ask for.
    pub fn new(
        setup: &'a PoolSetup<'a, I>,
        build: &'a Build,
        answers: &'a BTreeMap<Hash, Arc<Vec<u8>>>,
    ) -> Self {
        Self { setup, build, answers, requested: Requested::default() }
    }

    /// The calls for whose answers the search waits.
    pub fn into_requested(self) -> Requested {
        self.requested
    }

    /// The answers of all these calls, or none: then the calls without an answer are wanted.
    fn answers(&mut self, calls: Vec<Call>) -> Option<Vec<&'a [u8]>> {
        let keys: Vec<Hash> = calls.iter().map(|call| call.key(self.build)).collect();
        let known: Option<Vec<&[u8]>> =
            keys.iter().map(|key| Some(self.answers.get(key)?.as_slice())).collect();
        match known {
            Some(_) => self.requested.begun.retain(|key| !keys.contains(key)),
            None => {
                self.requested.awaited.extend(&keys);
                self.request(keys.into_iter().zip(calls));
            }
        }
        known
    }

    fn request(&mut self, calls: impl Iterator<Item = (Hash, Call)>) {
        self.requested.calls.extend(calls.filter(|(key, _)| !self.answers.contains_key(key)));
    }
}

impl<I: DoseFiles + ?Sized> Solver for LaterSolver<'_, I> {
    fn solve(
        &mut self,
        sets: &[&BeamSet],
        near: Option<&Evaluated>,
        tolerance: f64,
    ) -> Result<Vec<Evaluated>, Stop> {
        let setup = self.setup;
        let usable = sets.iter().all(|set| !set.beams().is_empty() && setup.holds(set.beams()));
        if sets.is_empty() || !usable {
            return setup.local().solve(sets, near, tolerance);
        }
        let answers = self.answers(setup.solve_calls(sets, near, tolerance)).ok_or(Stop::Waiting)?;
        // Answers are checked before they come here; this process finds the same.
        setup.evaluated(sets, &answers).or_else(|_| setup.local().solve(sets, near, tolerance))
    }

    fn begin(&mut self, sets: &[&BeamSet], near: Option<&Evaluated>, tolerance: f64) -> Result<(), Stop> {
        if sets.iter().all(|set| !set.beams().is_empty() && self.setup.holds(set.beams())) {
            let calls = self.setup.solve_calls(sets, near, tolerance);
            let keyed: Vec<(Hash, Call)> =
                calls.into_iter().map(|call| (call.key(self.build), call)).collect();
            self.requested.begun.extend(keyed.iter().map(|(key, _)| *key));
            self.request(keyed.into_iter());
        }
        Ok(())
    }

    fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        let setup = self.setup;
        if candidates.is_empty() || !setup.holds(candidates) {
            return setup.local().price(base, candidates);
        }
        let (calls, plan) = setup.price_calls(base, candidates);
        let counts: Vec<usize> = calls.iter().map(Call::candidates).collect();
        let Some(answers) = self.answers(calls) else {
            self.requested.plans.extend(plan);
            return Err(Stop::Waiting);
        };
        let prices = answers.iter().zip(counts).map(|(bytes, count)| answer::prices(bytes, count));
        match prices.collect::<Result<Vec<_>, _>>() {
            Ok(prices) => Ok(prices.concat()),
            Err(_) => setup.local().price(base, candidates),
        }
    }
}
