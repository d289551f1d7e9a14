//! The solver of a search over the pool: the same bytes as on the threads of this process.

use std::collections::BTreeMap;
use std::sync::Arc;

use stillpoint_plan::beams::{BeamSet, Evaluated, RingDoses, Solver, Stop};

use crate::setup::DoseFiles;
use crate::{Call, CallError, Courier, Hash, Home, Pool, PoolSetup, answer};

/// Solves and prices on a pool.
pub struct PoolSolver<'a, C: Courier, I: DoseFiles + ?Sized = RingDoses> {
    pool: &'a mut Pool<C>,
    setup: &'a PoolSetup<'a, I>,
    /// Solves that were begun and have no answer yet, in their order.
    ahead: Vec<(Hash, Call)>,
    /// Answers of solves that were begun and are not asked for yet.
    early: BTreeMap<Hash, Arc<Vec<u8>>>,
    /// Why the pool cannot be used any more: this process goes on alone.
    broken: Option<String>,
}

impl<'a, C: Courier, I: DoseFiles + ?Sized> PoolSolver<'a, C, I> {
    /// On this pool.
    pub fn new(pool: &'a mut Pool<C>, setup: &'a PoolSetup<'a, I>) -> Self {
        Self { pool, setup, ahead: Vec::new(), early: BTreeMap::new(), broken: None }
    }

    /// Why the pool could not be used to the end.
    pub fn broken(&self) -> Option<&str> {
        self.broken.as_deref()
    }

    fn is_usable(&self, sets: &[&BeamSet]) -> bool {
        let setup = self.setup;
        self.broken.is_none() && sets.iter().all(|set| !set.beams().is_empty() && setup.holds(set.beams()))
    }

    /// Answers of these calls, in their order. Those of solves that were begun may come meanwhile.
    fn call_all(
        &mut self,
        calls: Vec<Call>,
        plan: Option<&(Hash, Vec<u8>)>,
    ) -> Result<Vec<Arc<Vec<u8>>>, CallError> {
        let keys: Vec<Hash> = calls.iter().map(|call| self.pool.key(call)).collect();
        self.pool.note_needs(&keys);
        let mut found: BTreeMap<Hash, Arc<Vec<u8>>> =
            keys.iter().filter_map(|key| self.early.remove_entry(key)).collect();
        self.ahead.retain(|(key, _)| !keys.contains(key));
        let missing = keys.iter().zip(calls).filter(|(key, _)| !found.contains_key(*key));
        let (mut all_keys, mut all): (Vec<Hash>, Vec<Call>) = missing.map(|(key, call)| (*key, call)).unzip();
        let awaited = all.len();
        all_keys.extend(self.ahead.iter().map(|(key, _)| *key));
        all.extend(self.ahead.iter().map(|(_, call)| call.clone()));
        let asking = Asking { setup: self.setup, calls: &all, plan };
        let early = &mut self.early;
        self.pool.call_first(&all, awaited, &asking, |place, answer| {
            let into = if place < awaited { &mut found } else { &mut *early };
            into.insert(all_keys[place], Arc::clone(answer));
            Ok(())
        })?;
        self.ahead.retain(|(key, _)| !self.early.contains_key(key));
        keys.iter().map(|key| found.get(key).cloned().ok_or(CallError::NoAnswer)).collect()
    }

    /// Goes on without the pool.
    fn give_up(&mut self, reason: &CallError) {
        self.broken = Some(reason.to_string());
        self.ahead.clear();
        self.early.clear();
    }
}

impl<C: Courier, I: DoseFiles + ?Sized> Drop for PoolSolver<'_, C, I> {
    fn drop(&mut self) {
        if !self.ahead.is_empty() {
            self.pool.cancel();
        }
    }
}

impl<C: Courier, I: DoseFiles + ?Sized> Solver for PoolSolver<'_, C, I> {
    fn solve(
        &mut self,
        sets: &[&BeamSet],
        near: Option<&Evaluated>,
        tolerance: f64,
    ) -> Result<Vec<Evaluated>, Stop> {
        let setup = self.setup;
        if sets.is_empty() || !self.is_usable(sets) {
            return setup.local().solve(sets, near, tolerance);
        }
        let answers = self.call_all(setup.solve_calls(sets, near, tolerance), None);
        let solved = answers.and_then(|answers| {
            let bytes: Vec<&[u8]> = answers.iter().map(|answer| answer.as_slice()).collect();
            setup.evaluated(sets, &bytes)
        });
        // This process finds the same fault of the problem, or goes on without the pool.
        solved.or_else(|reason| {
            self.give_up(&reason);
            setup.local().solve(sets, near, tolerance)
        })
    }

    fn begin(&mut self, sets: &[&BeamSet], near: Option<&Evaluated>, tolerance: f64) -> Result<(), Stop> {
        if !self.is_usable(sets) {
            return Ok(());
        }
        let calls = self.setup.solve_calls(sets, near, tolerance);
        let begun = self.pool.begin(&calls, &Asking { setup: self.setup, calls: &calls, plan: None });
        match begun {
            Ok(()) => {
                let keyed = calls.into_iter().map(|call| (self.pool.key(&call), call));
                self.ahead.extend(keyed);
            }
            Err(reason) => self.give_up(&reason),
        }
        Ok(())
    }

    fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        let setup = self.setup;
        if candidates.is_empty() || self.broken.is_some() || !setup.holds(candidates) {
            return setup.local().price(base, candidates);
        }
        let (calls, plan) = setup.price_calls(base, candidates);
        let counts: Vec<usize> = calls.iter().map(Call::candidates).collect();
        let prices = self.call_all(calls, plan.as_ref()).and_then(|answers| {
            let prices = answers.iter().zip(counts).map(|(bytes, count)| answer::prices(bytes, count));
            Ok(prices.collect::<Result<Vec<_>, _>>().map_err(CallError::of)?.concat())
        });
        prices.or_else(|reason| {
            self.give_up(&reason);
            setup.local().price(base, candidates)
        })
    }
}

struct Asking<'a, I: DoseFiles + ?Sized> {
    setup: &'a PoolSetup<'a, I>,
    calls: &'a [Call],
    /// The plan beside which beams are priced.
    plan: Option<&'a (Hash, Vec<u8>)>,
}

impl<I: DoseFiles + ?Sized> Home for Asking<'_, I> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        let plan = self.plan.filter(|(of, _)| of == hash).map(|(_, bytes)| bytes.as_slice());
        plan.or_else(|| self.setup.content(hash))
    }

    fn check(&self, call: usize, answer: &[u8]) -> Result<(), CallError> {
        self.setup.check(&self.calls[call], answer)
    }

    fn compute(&self, call: usize) -> Result<Vec<u8>, CallError> {
        self.setup.compute(&self.calls[call], self.plan.map(|(_, bytes)| bytes.as_slice()))
    }
}
