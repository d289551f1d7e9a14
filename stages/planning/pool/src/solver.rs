//! The solver of a search over the pool: the same bytes as on the threads of this process.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use stillpoint_plan::beams::{BeamSet, Evaluated, RingDoses, Solver, Stop};

use crate::setup::DoseFiles;
use crate::{Call, CallError, Courier, Hash, Home, Pool, PoolSetup, answer};

/// Solves and prices on a pool.
pub struct PoolSolver<'a, C: Courier, I: DoseFiles + ?Sized = RingDoses> {
    pool: &'a mut Pool<C>,
    setup: &'a PoolSetup<'a, I>,
    /// Calls that were begun and have no answer yet, in their order.
    ahead: Vec<(Hash, Call)>,
    /// Answers of calls that were begun and are not asked for yet.
    early: BTreeMap<Hash, Arc<Vec<u8>>>,
    /// Sets that were begun last, with the keys of their solves.
    begun: Vec<(BeamSet, Hash)>,
    /// Solves that were begun, and the candidates that are priced beside each as soon as it is solved.
    expected: BTreeMap<Hash, (BeamSet, Vec<u16>)>,
    /// Plans that the prices among `ahead` name.
    plans: BTreeMap<Hash, Vec<u8>>,
    /// Why the pool cannot be used any more: this process goes on alone.
    broken: Option<String>,
}

impl<'a, C: Courier, I: DoseFiles + ?Sized> PoolSolver<'a, C, I> {
    /// On this pool.
    pub fn new(pool: &'a mut Pool<C>, setup: &'a PoolSetup<'a, I>) -> Self {
        Self {
            pool,
            setup,
            ahead: Vec::new(),
            early: BTreeMap::new(),
            begun: Vec::new(),
            expected: BTreeMap::new(),
            plans: BTreeMap::new(),
            broken: None,
        }
    }

    /// Why the pool could not be used to the end.
    pub fn broken(&self) -> Option<&str> {
        self.broken.as_deref()
    }

    fn is_usable(&self, sets: &[&BeamSet]) -> bool {
        let setup = self.setup;
        self.broken.is_none() && sets.iter().all(|set| !set.beams().is_empty() && setup.holds(set.beams()))
    }

    /// Answers of these calls, in their order. Those of calls that were begun may come meanwhile, and prices that are
    /// expected beside one of them are begun then.
    fn call_all(&mut self, calls: Vec<Call>) -> Result<Vec<Arc<Vec<u8>>>, CallError> {
        let keys: Vec<Hash> = calls.iter().map(|call| self.pool.key(call)).collect();
        let mut found: BTreeMap<Hash, Arc<Vec<u8>>> =
            keys.iter().filter_map(|key| self.early.remove_entry(key)).collect();
        self.ahead.retain(|(key, _)| !keys.contains(key));
        let all_of_them: Vec<(Hash, Call)> = keys.iter().copied().zip(calls).collect();
        self.pool.note_needs(&keys);
        loop {
            let missing = all_of_them.iter().filter(|(key, _)| !found.contains_key(key));
            let mut all: Vec<(Hash, Call)> = missing.cloned().collect();
            let awaited = all.len();
            all.extend(self.ahead.iter().cloned());
            let (all_keys, all): (Vec<Hash>, Vec<Call>) = all.into_iter().unzip();
            let asking = Asking { setup: self.setup, calls: &all, plans: &self.plans };
            let (early, expected) = (&mut self.early, &self.expected);
            let mut solved = Vec::new();
            self.pool.call_first(&all, awaited, &asking, |place, answer| {
                let key = all_keys[place];
                let into = if place < awaited { &mut found } else { &mut *early };
                into.insert(key, Arc::clone(answer));
                if !expected.contains_key(&key) {
                    return Ok(ControlFlow::Continue(()));
                }
                solved.push((key, Arc::clone(answer)));
                Ok(ControlFlow::Break(()))
            })?;
            self.ahead.retain(|(key, _)| !self.early.contains_key(key));
            let (ahead, plans) = (&self.ahead, &mut self.plans);
            plans.retain(|plan, _| {
                ahead.iter().chain(&all_of_them).any(|(_, call)| is_priced_with(call, plan))
            });
            for (key, answer) in solved {
                self.begin_prices(&key, &answer)?;
            }
            if keys.iter().all(|key| found.contains_key(key)) {
                return keys.iter().map(|key| found.get(key).cloned().ok_or(CallError::NoAnswer)).collect();
            }
            self.pool.note_needs(&keys);
        }
    }

    /// Asks the prices that are expected beside a solve, whose answer is there.
    fn begin_prices(&mut self, solve: &Hash, answer: &Arc<Vec<u8>>) -> Result<(), CallError> {
        let Some((set, candidates)) = self.expected.remove(solve) else { return Ok(()) };
        let solved = self.setup.evaluated(&[&set], &[answer.as_slice()])?;
        let (calls, plan) = self.setup.price_calls(solved.first(), &candidates);
        self.plans.extend(plan);
        let keys = self.begin_calls(calls)?;
        self.pool.note_followers(&keys, solve);
        Ok(())
    }

    /// Asks calls without waiting for an answer. It gives their keys.
    fn begin_calls(&mut self, calls: Vec<Call>) -> Result<Vec<Hash>, CallError> {
        self.pool.begin(&calls, &Asking { setup: self.setup, calls: &calls, plans: &self.plans })?;
        let keys: Vec<Hash> = calls.iter().map(|call| self.pool.key(call)).collect();
        self.ahead.extend(keys.iter().copied().zip(calls));
        Ok(keys)
    }

    /// Goes on without the pool.
    fn give_up(&mut self, reason: &CallError) {
        self.broken = Some(reason.to_string());
        self.ahead.clear();
        self.early.clear();
        self.begun.clear();
        self.expected.clear();
        self.plans.clear();
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
        let answers = self.call_all(setup.solve_calls(sets, near, tolerance));
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
        match self.begin_calls(self.setup.solve_calls(sets, near, tolerance)) {
            Ok(keys) => self.begun = sets.iter().copied().cloned().zip(keys).collect(),
            Err(reason) => self.give_up(&reason),
        }
        Ok(())
    }

    fn expect_prices(&mut self, set: &BeamSet, candidates: &[u16]) {
        let begun = self.begun.iter().find(|(begun, _)| begun == set);
        if let Some((_, key)) = begun.filter(|_| !candidates.is_empty() && self.setup.holds(candidates)) {
            self.expected.insert(*key, (set.clone(), candidates.to_vec()));
        }
    }

    fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        let setup = self.setup;
        if candidates.is_empty() || self.broken.is_some() || !setup.holds(candidates) {
            return setup.local().price(base, candidates);
        }
        let (calls, plan) = setup.price_calls(base, candidates);
        let counts: Vec<usize> = calls.iter().map(Call::candidates).collect();
        self.plans.extend(plan);
        let prices = self.call_all(calls).and_then(|answers| {
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
    /// The plans beside which beams are priced.
    plans: &'a BTreeMap<Hash, Vec<u8>>,
}

/// Whether a call asks for prices beside this plan.
fn is_priced_with(call: &Call, plan: &Hash) -> bool {
    matches!(call, Call::Price { base: Some(base), .. } if base == plan)
}

impl<I: DoseFiles + ?Sized> Home for Asking<'_, I> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        self.plans.get(hash).map(Vec::as_slice).or_else(|| self.setup.content(hash))
    }

    fn check(&self, call: usize, answer: &[u8]) -> Result<(), CallError> {
        self.setup.check(&self.calls[call], answer)
    }

    fn compute(&self, call: usize) -> Result<Vec<u8>, CallError> {
        let call = &self.calls[call];
        let plan = match call {
            Call::Price { base: Some(base), .. } => self.plans.get(base),
            _ => None,
        };
        self.setup.compute(call, plan.map(Vec::as_slice))
    }
}
