//! The solver of a search over the pool: the same bytes as on the threads of this process.

use stillpoint_plan::beams::{BeamSet, Evaluated, RingDoses, Solver, Stop};

use crate::setup::DoseFiles;
use crate::{Call, CallError, Courier, Hash, Home, Pool, PoolSetup, answer};

/// Solves and prices on a pool.
pub struct PoolSolver<'a, C: Courier, I: DoseFiles + ?Sized = RingDoses> {
    pool: &'a mut Pool<C>,
    setup: &'a PoolSetup<'a, I>,
    /// Why the pool cannot be used any more: this process goes on alone.
    broken: Option<String>,
}

impl<'a, C: Courier, I: DoseFiles + ?Sized> PoolSolver<'a, C, I> {
    /// On this pool.
    pub fn new(pool: &'a mut Pool<C>, setup: &'a PoolSetup<'a, I>) -> Self {
        Self { pool, setup, broken: None }
    }

    /// Why the pool could not be used to the end.
    pub fn broken(&self) -> Option<&str> {
        self.broken.as_deref()
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
        let usable = sets.iter().all(|set| !set.beams().is_empty() && setup.holds(set.beams()));
        if sets.is_empty() || self.broken.is_some() || !usable {
            return setup.local().solve(sets, near, tolerance);
        }
        let calls = setup.solve_calls(sets, near, tolerance);
        let answers = self.pool.call_all(&calls, &Asking { setup, calls: &calls, plan: None });
        let solved = answers.and_then(|answers| {
            let bytes: Vec<&[u8]> = answers.iter().map(|answer| answer.as_slice()).collect();
            setup.evaluated(sets, &bytes)
        });
        // This process finds the same fault of the problem, or goes on without the pool.
        solved.or_else(|reason| {
            self.broken = Some(reason.to_string());
            setup.local().solve(sets, near, tolerance)
        })
    }

    fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        let setup = self.setup;
        if candidates.is_empty() || self.broken.is_some() || !setup.holds(candidates) {
            return setup.local().price(base, candidates);
        }
        let (calls, plan) = setup.price_calls(base, candidates);
        let answers = self.pool.call_all(&calls, &Asking { setup, calls: &calls, plan: plan.as_ref() });
        let prices = answers.and_then(|answers| {
            let mut prices = Vec::new();
            for (call, bytes) in calls.iter().zip(answers) {
                let Call::Price { candidates, .. } = call else { continue };
                prices.extend(answer::prices(&bytes, candidates.len())?);
            }
            Ok(prices)
        });
        prices.or_else(|reason| {
            self.broken = Some(reason.to_string());
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
