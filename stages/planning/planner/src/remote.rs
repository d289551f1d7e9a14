//! What a pool computes of a request: calls for its doses, solves and prices, and their answers.
//!
//! All doses are asked at once, and the search runs ahead of the parts: its calls are those of the whole budget. So many
//! workers have work, and the parts are the same as without a pool.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::sync::Arc;

use stillpoint_operator::StepError;
use stillpoint_plan::dose::BeamFile;
use stillpoint_pool::{Build, Call, CallError, Hash, Inside, LaterSolver, Names, PoolSetup, Requested};

use super::job::{Found, Job, fault, search};
use super::patient::Patient;

/// The side of a job that a pool sees.
#[derive(Default)]
pub struct Remote {
    build: Option<Build>,
    /// The dose engine, by name.
    engine: Option<(Hash, Vec<u8>)>,
    /// The name of goals and doses, when all doses are there.
    names: Option<Names>,
    /// Calls that were asked and have no answer.
    open: Requested,
    /// Answers of solves and prices that the search has not taken yet.
    answers: BTreeMap<Hash, Arc<Vec<u8>>>,
    /// Doses that came before others: those of later angles.
    early: BTreeMap<u16, BeamFile>,
    /// Beam of each call for a dose.
    beams: BTreeMap<Hash, u16>,
    /// All that was asked: what was made of the answers.
    asked: BTreeSet<Hash>,
    /// There are answers that the parts have not seen.
    news: bool,
    /// The search has run to its end: it needs no more answers.
    complete: bool,
}

impl Remote {
    /// Whether answers have come that the parts have not seen.
    pub(super) fn has_news(&self) -> bool {
        self.news
    }

    /// A part was tried: as long as the answers suffice, the next may follow.
    pub(super) fn note(&mut self, is_there: bool) {
        self.news = is_there;
    }
}

/// The search waits for answers.
pub struct Waits(Requested);

impl Job {
    /// Calls that the work can use now and that were not asked before; none while it cannot go on without an answer that is
    /// awaited, and at the end.
    pub fn calls(&mut self, patient: &Patient, build: &Build) -> Result<Vec<Call>, StepError> {
        self.remote.build.get_or_insert_with(|| build.clone());
        let open = &self.remote.open;
        if self.remote.complete || open.awaited.iter().any(|key| open.calls.contains_key(key)) {
            return Ok(Vec::new());
        }
        self.remote.news = true;
        let requested = if self.doses.len() < usize::from(patient.ring().count()) {
            self.dose_calls(patient, build)?
        } else {
            // The search goes on as far as it can: the parts follow.
            let found = self.search_by_answers(patient, usize::MAX)?;
            let Err(Waits(requested)) = found else {
                self.remote.complete = true;
                self.remote.answers.clear();
                self.remote.open = Requested::default();
                return Ok(Vec::new());
            };
            // The memo has what the search took.
            let Requested { awaited, begun, .. } = &requested;
            self.remote.answers.retain(|key, _| awaited.contains(key) || begun.contains(key));
            requested
        };
        self.remote.asked.extend(requested.calls.keys());
        let open = &mut self.remote.open;
        let fresh = requested.calls.into_iter().filter(|(key, _)| !open.calls.contains_key(key));
        let fresh: Vec<(Hash, Call)> = fresh.collect();
        let calls = fresh.iter().map(|(_, call)| call.clone()).collect();
        open.calls.extend(fresh);
        open.plans.extend(requested.plans);
        (open.awaited, open.begun) = (requested.awaited, requested.begun);
        Ok(calls)
    }

    fn dose_calls(&mut self, patient: &Patient, build: &Build) -> Result<Requested, StepError> {
        if self.remote.engine.is_none() {
            let bytes = self.engine.to_bytes().map_err(|e| fault(&e))?;
            self.remote.engine = Some((Hash::of(&bytes), bytes));
        }
        let mut requested = Requested::default();
        let Some((engine, _)) = self.remote.engine else { return Ok(requested) };
        for beam in self.doses.len() as u16..patient.ring().count() {
            if !self.remote.early.contains_key(&beam) {
                let call = Call::dose(engine, patient.ring().angle_deg(beam));
                let key = call.key(build);
                self.remote.beams.insert(key, beam);
                requested.awaited.insert(key);
                requested.calls.insert(key, call);
            }
        }
        Ok(requested)
    }

    /// Searches by the answers that are there until so many solves are made: what was found, or what it waits for.
    pub(super) fn search_by_answers(
        &mut self,
        patient: &Patient,
        until: usize,
    ) -> Result<Result<Found, Waits>, StepError> {
        let memo = std::mem::take(&mut self.memo);
        let Remote { build, names, answers, .. } = &mut self.remote;
        let beams = patient.ring().count();
        let names = names
            .get_or_insert_with(|| Names::new(&self.doses[..], patient.goals(), beams, NonZeroUsize::MIN));
        let Some(build) = build else { return Err(fault(&"the build of the pool is not known")) };
        let setup = PoolSetup::named(&self.doses[..], patient.goals(), names);
        let mut solver = LaterSolver::new(&setup, build, answers);
        let (memo, found) = search(&self.doses, patient, &self.asked.search, memo, until, Some(&mut solver));
        let requested = solver.into_requested();
        self.memo = memo;
        Ok(found?.ok_or(Waits(requested)))
    }

    /// Takes the answer of a call, which was checked.
    pub fn answer(&mut self, key: &Hash, bytes: &Arc<Vec<u8>>) -> Result<(), StepError> {
        let Some(call) = self.remote.open.calls.remove(key) else { return Ok(()) };
        self.remote.news = true;
        match call {
            Call::Dose { gantry_deg, couch_deg, .. } => {
                let dose = self.engine.beam_of([gantry_deg, couch_deg], bytes).map_err(|e| fault(&e))?;
                if let Some(beam) = self.remote.beams.get(key) {
                    self.remote.early.insert(*beam, dose);
                }
                self.take_early_doses();
            }
            Call::Solve { .. } | Call::Price { .. } => {
                self.remote.answers.insert(*key, bytes.clone());
            }
            // No work on a request is a game.
            Call::Game { .. } => {}
        }
        let open = &mut self.remote.open;
        let is_named = |plan: &Hash| {
            open.calls
                .values()
                .any(|call| matches!(call, Call::Price { base: Some(base), .. } if base == plan))
        };
        open.plans.retain(|plan, _| is_named(plan));
        Ok(())
    }

    /// Forgets all that was made of these answers; the work on it begins anew. Gives whether there was any.
    pub fn forget(&mut self, answers: &BTreeSet<Hash>) -> bool {
        if self.remote.asked.is_disjoint(answers) {
            return false;
        }
        let first = answers.iter().filter_map(|key| self.remote.beams.get(key)).min();
        if let Some(first) = first.copied() {
            let count = self.doses.len().min(usize::from(first));
            let behind = self.doses.drain(count..).enumerate().map(|(i, dose)| ((count + i) as u16, dose));
            self.remote.early.extend(behind);
            self.remote
                .early
                .retain(|beam, _| !answers.iter().any(|key| self.remote.beams.get(key) == Some(beam)));
            self.remote.names = None;
        }
        self.remote.asked.retain(|key| !answers.contains(key));
        self.leave_pool();
        self.search_anew();
        true
    }

    /// Awaits no answer any more.
    pub fn leave_pool(&mut self) {
        self.remote.open = Requested::default();
        self.remote.answers.clear();
        self.remote.complete = false;
    }

    /// Names of the answers that the work stands on.
    pub fn asked_calls(&self) -> &BTreeSet<Hash> {
        &self.remote.asked
    }

    /// Moves doses that came early behind those before them, as far as there is no gap.
    pub(super) fn take_early_doses(&mut self) {
        while let Some(dose) = self.remote.early.remove(&(self.doses.len() as u16)) {
            self.doses.push(dose);
        }
    }

    /// Computes a call that waits for its answer.
    pub fn compute(&self, patient: &Patient, key: &Hash) -> Result<Option<Vec<u8>>, StepError> {
        let Some(call) = self.remote.open.calls.get(key) else { return Ok(None) };
        if let Call::Dose { gantry_deg, couch_deg, .. } = call {
            return self.engine.beam_file([*gantry_deg, *couch_deg]).map(Some).map_err(|e| fault(&e));
        }
        let plan = match call {
            Call::Price { base: Some(base), .. } => self.remote.open.plans.get(base),
            _ => None,
        };
        let Some(names) = &self.remote.names else { return Ok(None) };
        let setup = PoolSetup::named(&self.doses[..], patient.goals(), names);
        setup.compute(call, plan.map(Vec::as_slice)).map(Some).map_err(|e| fault(&e))
    }
}

/// A job as the client of a pool sees it: the contents that workers fetch, and the form of answers.
pub struct Served<'a> {
    /// The patient.
    pub patient: &'a Patient,
    /// The job, if there is one.
    pub job: Option<&'a Job>,
}

impl Inside for Served<'_> {
    fn content(&self, hash: &Hash) -> Option<&[u8]> {
        let Remote { engine, names, open, .. } = &self.job?.remote;
        if let Some((_, bytes)) = engine.as_ref().filter(|(name, _)| name == hash) {
            return Some(bytes);
        }
        open.plans
            .get(hash)
            .map(Vec::as_slice)
            .or_else(|| names.as_ref()?.content(&self.job?.doses[..], hash))
    }

    fn check(&self, key: &Hash, answer: &[u8]) -> Result<(), CallError> {
        let Some(job) = self.job else { return Ok(()) };
        match (job.remote.open.calls.get(key), &job.remote.names) {
            (Some(Call::Dose { gantry_deg, couch_deg, .. }), _) => {
                job.engine.beam_of([*gantry_deg, *couch_deg], answer).map(drop).map_err(CallError::of)
            }
            (Some(call), Some(names)) => {
                PoolSetup::named(&job.doses[..], self.patient.goals(), names).check(call, answer)
            }
            // An answer that nobody awaits.
            _ => Ok(()),
        }
    }
}
