//! The work on one request, in parts of a fixed size: first the doses of all angles, then solves.

use std::sync::Arc;

use stillpoint_operator::StepError;
use stillpoint_plan::RowsRef;
use stillpoint_plan::beams::{ChoiceError, Evaluated, Memo, Solver, Stop};
use stillpoint_plan::dose::{BeamFile, DoseEngine};
use stillpoint_plan::recipe::PlanSearch;

use super::patient::Patient;
use super::remote::Remote;

/// How much work one part does.
#[derive(Clone, Copy, Debug)]
pub struct WorkShare {
    /// Beams whose doses are computed.
    pub doses: usize,
    /// Sets of beams that are solved.
    pub solves: usize,
}

/// What a request asks for.
pub struct Asked {
    /// Sequence of the request.
    pub request: u64,
    /// The set-up: how far the patient has moved, along the axes of his frame, mm.
    pub shift_mm: [f64; 3],
    /// The search, with the number of beams and the budget of the request.
    pub search: PlanSearch,
}

/// A request in work.
pub struct Job {
    /// What it asks for.
    pub asked: Asked,
    pub(super) engine: DoseEngine,
    /// Doses of the first angles of the ring.
    pub(super) doses: Vec<BeamFile>,
    /// Doses of the parts so far.
    shown: usize,
    /// Solves that the parts so far were allowed.
    allowed: usize,
    /// Solves after which the work ends, whatever the request allows.
    limit: usize,
    pub(super) memo: Memo,
    /// What a pool computes of it.
    pub(super) remote: Remote,
    /// The best plan so far.
    pub best: Option<Arc<Evaluated>>,
    /// Solves so far.
    pub solves: usize,
    /// Whether the search has ended.
    pub ended: bool,
}

/// What a search has found before it paused.
pub(super) struct Found {
    best: Option<Arc<Evaluated>>,
    solves: usize,
    /// There is nothing left to try.
    exhausted: bool,
}

impl Job {
    /// The work on a request, before its first part.
    pub fn new(patient: &Patient, asked: Asked) -> Result<Self, StepError> {
        let engine = patient.engine().shifted(asked.shift_mm).map_err(|e| fault(&e))?;
        let limit = asked.search.budget;
        Ok(Self {
            asked,
            engine,
            doses: Vec::new(),
            shown: 0,
            allowed: 0,
            limit,
            memo: Memo::default(),
            remote: Remote::default(),
            best: None,
            solves: 0,
            ended: false,
        })
    }

    /// Whether the parts so far hold the doses of all angles.
    pub fn has_doses(&self, patient: &Patient) -> bool {
        self.shown == usize::from(patient.ring().count())
    }

    /// Does the next part: computes the next doses; where all are there, makes the next solves.
    pub fn work(&mut self, patient: &Patient, part: WorkShare) -> Result<(), StepError> {
        if !self.has_doses(patient) {
            let shown = self.shown_next(patient, part);
            self.take_early_doses();
            while self.doses.len() < shown {
                let beam = self.doses.len() as u16;
                let dose = self.compute_dose(patient.ring().angle_deg(beam))?;
                self.doses.push(dose);
                self.take_early_doses();
            }
            self.shown = shown;
            return Ok(());
        }
        let allowed = self.allowed_next(part);
        let memo = std::mem::take(&mut self.memo);
        let (memo, found) = search(&self.doses, patient, &self.asked.search, memo, allowed, None);
        self.memo = memo;
        if let Some(found) = found? {
            self.take(found, allowed);
        }
        Ok(())
    }

    /// The next part without any computation, of what is there already. Gives whether that suffices.
    pub fn work_from_answers(&mut self, patient: &Patient, part: WorkShare) -> Result<bool, StepError> {
        if self.ended || !self.remote.has_news() {
            return Ok(false);
        }
        if !self.has_doses(patient) {
            let shown = self.shown_next(patient, part);
            let is_there = self.doses.len() >= shown;
            self.shown = if is_there { shown } else { self.shown };
            self.remote.note(is_there);
            return Ok(is_there);
        }
        let allowed = self.allowed_next(part);
        let found = self.search_by_answers(patient, allowed)?.ok();
        let is_there = found.is_some();
        self.remote.note(is_there);
        found.into_iter().for_each(|found| self.take(found, allowed));
        Ok(is_there)
    }

    /// Ends the work after so many solves, or after those that were made already.
    pub fn cut_short(&mut self, solves: usize) {
        self.limit = solves.clamp(self.allowed, self.limit.max(self.allowed));
        self.ended = self.allowed > 0 && self.allowed >= self.limit;
    }

    /// Makes all solves anew, with what is in `doses`.
    pub(super) fn search_anew(&mut self) {
        (self.allowed, self.solves, self.ended) = (0, 0, false);
        self.shown = self.shown.min(self.doses.len());
        self.memo = Memo::default();
        self.best = None;
    }

    fn shown_next(&self, patient: &Patient, part: WorkShare) -> usize {
        (self.shown + part.doses).min(usize::from(patient.ring().count()))
    }

    fn allowed_next(&self, part: WorkShare) -> usize {
        (self.allowed + part.solves).min(self.limit)
    }

    fn take(&mut self, found: Found, allowed: usize) {
        (self.best, self.solves, self.allowed) = (found.best, found.solves, allowed);
        self.ended = found.exhausted || allowed >= self.limit;
    }

    pub(super) fn compute_dose(&self, gantry_deg: f64) -> Result<BeamFile, StepError> {
        let bytes = self.engine.beam_file(gantry_deg).map_err(|e| fault(&e))?;
        self.engine.beam_of(gantry_deg, &bytes).map_err(|e| fault(&e))
    }

    /// The matrix of a beam, once a part has it.
    pub fn dose(&self, beam: u16) -> Option<RowsRef<'_>> {
        self.doses[..self.shown].get(usize::from(beam)).map(BeamFile::dose)
    }

    /// Centres of the bixels of a beam, mm.
    pub fn bixels_mm(&self, beam: u16) -> &[[f64; 2]] {
        self.doses.get(usize::from(beam)).map_or(&[], BeamFile::bixels_mm)
    }

    /// Bixels that a plan has at most.
    pub fn most_bixels(&self) -> usize {
        let mut counts: Vec<usize> = self.doses.iter().map(|dose| dose.bixels_mm().len()).collect();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        counts.iter().take(self.asked.search.beams).sum()
    }
}

/// Searches until so many solves are made, by this solver or on this thread: the memo, and what was found; nothing where the
/// solver waits for answers.
///
/// The search begins from the start in each part and takes the way of the whole: what earlier parts solved is known.
pub(super) fn search(
    doses: &[BeamFile],
    patient: &Patient,
    search: &PlanSearch,
    memo: Memo,
    allowed: usize,
    solver: Option<&mut dyn Solver>,
) -> (Memo, Result<Option<Found>, StepError>) {
    let evaluator = search.evaluator_on(&patient.setup, doses).with_memo(memo).with_pause(allowed);
    let mut evaluator = match solver {
        Some(solver) => evaluator.with_solver(solver),
        None => evaluator,
    };
    let chosen = search.choose(&mut evaluator);
    let (best, solves) = (evaluator.best().cloned(), evaluator.solves());
    let found = |exhausted| Ok(Some(Found { best, solves, exhausted }));
    let result = match chosen {
        Ok(choice) => found(!choice.spent),
        Err(ChoiceError::TooFew { .. } | ChoiceError::Stop(Stop::Spent)) => found(false),
        Err(ChoiceError::Stop(Stop::Waiting)) => Ok(None),
        Err(other) => Err(fault(&other)),
    };
    (evaluator.into_memo(), result)
}

pub(super) fn fault(why: &dyn std::fmt::Display) -> StepError {
    StepError(why.to_string())
}
