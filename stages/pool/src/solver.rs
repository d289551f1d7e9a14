//! The solver of a search over the pool: the same bytes as on the threads of this process.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;

use stillpoint_plan::beams::{BeamSet, Evaluated, Influence, Local, RingDoses, Solver, start_weights};
use stillpoint_plan::fluence::{Goals, GoalsError};

use crate::call::BeamDoses;
use crate::{Call, Courier, Hash, Home, Pool, answer, goals};

/// Candidates of one call.
const SHARD: usize = 8;

/// What a search stands on, with the names of its contents.
pub struct PoolGround<'a> {
    doses: &'a RingDoses,
    goals: &'a Goals,
    goals_bytes: Vec<u8>,
    goals_hash: Hash,
    /// Names of the dose files of each beam of the ring.
    names: Vec<BeamDoses>,
    contents: BTreeMap<Hash, &'a [u8]>,
}

impl<'a> PoolGround<'a> {
    /// Of the doses of a ring of `beams` angles. It reads all of them once.
    pub fn new(doses: &'a RingDoses, goals: &'a Goals, beams: u16) -> Self {
        let mut contents = BTreeMap::new();
        let mut names = Vec::new();
        for beam in 0..beams {
            let mut of_beam = Vec::new();
            for file in doses.files(beam) {
                let hash = Hash::of(file.bytes());
                contents.insert(hash, file.bytes());
                of_beam.push(hash);
            }
            names.push(of_beam);
        }
        let goals_bytes = goals::to_bytes(goals);
        Self { doses, goals, goals_hash: Hash::of(&goals_bytes), goals_bytes, names, contents }
    }

    fn of(&self, beams: &[u16]) -> Vec<BeamDoses> {
        beams.iter().map(|beam| self.names.get(usize::from(*beam)).cloned().unwrap_or_default()).collect()
    }

    /// Whether all these beams have a dose; a problem without is this process's own to refuse.
    fn holds(&self, beams: &[u16]) -> bool {
        beams.iter().all(|beam| self.names.get(usize::from(*beam)).is_some_and(|names| !names.is_empty()))
    }

    fn columns(&self, set: &BeamSet) -> Vec<usize> {
        set.beams().iter().map(|beam| self.doses.beam(*beam).columns()).collect()
    }

    fn local(&self) -> Local<'a, RingDoses> {
        Local { influence: self.doses, goals: self.goals, threads: NonZeroUsize::MIN }
    }
}

/// Solves and prices on a pool.
pub struct PoolSolver<'a, C: Courier> {
    pool: &'a mut Pool<C>,
    ground: &'a PoolGround<'a>,
    /// Why the pool cannot be used any more: this process goes on alone.
    broken: Option<String>,
}

impl<'a, C: Courier> PoolSolver<'a, C> {
    /// On this pool.
    pub fn new(pool: &'a mut Pool<C>, ground: &'a PoolGround<'a>) -> Self {
        Self { pool, ground, broken: None }
    }

    /// Why the pool could not be used to the end.
    pub fn broken(&self) -> Option<&str> {
        self.broken.as_deref()
    }
}

impl<C: Courier> Solver for PoolSolver<'_, C> {
    fn solve(
        &mut self,
        sets: &[&BeamSet],
        near: Option<&Evaluated>,
        tolerance: f64,
    ) -> Result<Vec<Evaluated>, GoalsError> {
        let ground = self.ground;
        let usable = sets.iter().all(|set| !set.beams().is_empty() && ground.holds(set.beams()));
        if sets.is_empty() || self.broken.is_some() || !usable {
            return ground.local().solve(sets, near, tolerance);
        }
        let columns: Vec<Vec<usize>> = sets.iter().map(|set| ground.columns(set)).collect();
        let call = |(set, columns): (&&BeamSet, &Vec<usize>)| {
            let start = start_weights(set, columns, near);
            Call::solve(ground.goals_hash, ground.of(set.beams()), start, tolerance)
        };
        let calls: Vec<Call> = sets.iter().zip(&columns).map(call).collect();
        let home = Solving { ground, sets, near, tolerance, columns: &columns };
        match self.pool.call_all(&calls, &home) {
            Ok(answers) => {
                let mut solved = Vec::new();
                for (place, bytes) in answers.iter().enumerate() {
                    match home.plan(place, bytes) {
                        Ok(plan) => solved.push(Evaluated::new(sets[place], &columns[place], plan)),
                        // An answer is checked before it is given out; so this is one of this process.
                        Err(_) => return ground.local().solve(sets, near, tolerance),
                    }
                }
                Ok(solved)
            }
            // This process finds the same fault of the problem, or goes on without the pool.
            Err(reason) => {
                self.broken = Some(reason);
                ground.local().solve(sets, near, tolerance)
            }
        }
    }

    fn price(&mut self, beside: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, GoalsError> {
        let ground = self.ground;
        if candidates.is_empty() || self.broken.is_some() || !ground.holds(candidates) {
            return ground.local().price(beside, candidates);
        }
        let plan = beside.map(|beside| answer::of_plan(&beside.plan));
        let plan = plan.map(|bytes| (Hash::of(&bytes), bytes));
        let call = |shard: &[u16]| Call::Price {
            goals: ground.goals_hash,
            beside: plan.as_ref().map(|(hash, _)| *hash),
            candidates: ground.of(shard),
        };
        let shards: Vec<&[u16]> = candidates.chunks(SHARD).collect();
        let calls: Vec<Call> = shards.iter().map(|shard| call(shard)).collect();
        let home = Pricing { ground, shards: &shards, beside, plan: plan.as_ref() };
        let answers = self.pool.call_all(&calls, &home);
        let prices = answers.and_then(|answers| {
            let mut prices = Vec::new();
            for (shard, bytes) in shards.iter().zip(answers) {
                prices.extend(answer::prices(&bytes, shard.len()).map_err(|e| e.to_string())?);
            }
            Ok(prices)
        });
        prices.or_else(|reason| {
            self.broken = Some(reason);
            ground.local().price(beside, candidates)
        })
    }
}

struct Solving<'a> {
    ground: &'a PoolGround<'a>,
    sets: &'a [&'a BeamSet],
    near: Option<&'a Evaluated>,
    tolerance: f64,
    columns: &'a [Vec<usize>],
}

impl Solving<'_> {
    fn plan(&self, place: usize, bytes: &[u8]) -> Result<stillpoint_plan::fluence::Plan, String> {
        let bixels = self.columns[place].iter().sum();
        answer::plan(bytes, Some(bixels), self.ground.goals.voxels().len()).map_err(|e| e.to_string())
    }
}

impl Home for Solving<'_> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        content(self.ground, hash)
    }

    fn check(&self, call: usize, answer: &[u8]) -> Result<(), String> {
        self.plan(call, answer).map(|_| ())
    }

    fn compute(&self, call: usize) -> Result<Vec<u8>, String> {
        let solved = self.ground.local().solve(&[self.sets[call]], self.near, self.tolerance);
        let solved = solved.map_err(|e| e.to_string())?;
        solved.first().map(|solved| answer::of_plan(&solved.plan)).ok_or_else(|| "no plan".to_owned())
    }
}

struct Pricing<'a> {
    ground: &'a PoolGround<'a>,
    shards: &'a [&'a [u16]],
    beside: Option<&'a Evaluated>,
    plan: Option<&'a (Hash, Vec<u8>)>,
}

impl Home for Pricing<'_> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        let plan = self.plan.filter(|(of, _)| of == hash).map(|(_, bytes)| bytes.as_slice());
        plan.or_else(|| content(self.ground, hash))
    }

    fn check(&self, call: usize, answer: &[u8]) -> Result<(), String> {
        answer::prices(answer, self.shards[call].len()).map(|_| ()).map_err(|e| e.to_string())
    }

    fn compute(&self, call: usize) -> Result<Vec<u8>, String> {
        let prices = self.ground.local().price(self.beside, self.shards[call]);
        Ok(answer::of_prices(&prices.map_err(|e| e.to_string())?))
    }
}

fn content<'a>(ground: &'a PoolGround<'_>, hash: &Hash) -> Option<&'a [u8]> {
    if *hash == ground.goals_hash {
        return Some(&ground.goals_bytes);
    }
    ground.contents.get(hash).copied()
}
