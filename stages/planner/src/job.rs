//! The work on one request, in parts of a fixed size: first the doses of all angles, then solves.

use std::sync::Arc;

use stillpoint_operator::StepError;
use stillpoint_plan::Rows;
use stillpoint_plan::beams::{Budget, ChoiceError, Evaluated, Evaluator, Memo, Method, Stop, choose};
use stillpoint_plan::dose::DoseEngine;

use super::patient::Patient;

/// How much work one part does.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Beams whose doses are computed.
    pub doses: usize,
    /// Sets of beams that are solved.
    pub solves: usize,
}

/// What a request asks for.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// Sequence of the request.
    pub request: u64,
    /// The set-up: how far the patient has moved, along the axes of his frame, mm.
    pub shift_mm: [f64; 3],
    /// Beams of the plan.
    pub beams: usize,
    /// Solves of the search.
    pub budget: usize,
}

/// A request in work.
pub struct Job {
    /// What it asks for.
    pub asked: Asked,
    engine: DoseEngine,
    bixels_mm: Vec<Vec<[f64; 2]>>,
    doses: Vec<Rows>,
    /// Solves that the parts so far were allowed.
    allowed: usize,
    memo: Memo,
    /// The best plan so far.
    pub best: Option<Arc<Evaluated>>,
    /// Solves so far.
    pub solves: usize,
    /// Whether the search has ended.
    pub ended: bool,
}

impl Job {
    /// The work on a request, before its first part.
    pub fn new(patient: &Patient, asked: Asked) -> Result<Self, StepError> {
        let engine = patient.engine.shifted(asked.shift_mm).map_err(|e| fault(&e))?;
        Ok(Self {
            asked,
            engine,
            bixels_mm: Vec::new(),
            doses: Vec::new(),
            allowed: 0,
            memo: Memo::default(),
            best: None,
            solves: 0,
            ended: false,
        })
    }

    /// Whether the doses of all angles are computed.
    pub fn has_doses(&self, patient: &Patient) -> bool {
        self.doses.len() == usize::from(patient.ring.count())
    }

    /// Computes the next doses; where all are there, makes the next solves.
    pub fn work(&mut self, patient: &Patient, part: Part, seed: u64) -> Result<(), StepError> {
        if self.has_doses(patient) {
            self.search(patient, part.solves, seed)
        } else {
            self.compute(patient, part.doses)
        }
    }

    fn compute(&mut self, patient: &Patient, doses: usize) -> Result<(), StepError> {
        let missing = self.doses.len() as u16..patient.ring.count();
        for beam in missing.take(doses) {
            let dose = self.engine.beam(patient.ring.angle_deg(beam)).map_err(|e| fault(&e))?;
            self.doses.push(Rows::from_columns(dose.dose.view()).map_err(|e| fault(&e))?);
            self.bixels_mm.push(dose.bixels_mm);
        }
        Ok(())
    }

    fn search(&mut self, patient: &Patient, solves: usize, seed: u64) -> Result<(), StepError> {
        let Asked { beams, budget, .. } = self.asked;
        self.allowed = (self.allowed + solves).min(budget);
        let memo = std::mem::take(&mut self.memo);
        let whole = Budget { solves: budget };
        let evaluator = Evaluator::new(&self.doses[..], &patient.goals, patient.ring, beams, whole);
        let mut evaluator = evaluator.with_memo(memo).with_pause(self.allowed);
        // The search begins again in each part and takes the way of the whole: what earlier parts solved is known.
        let chosen = choose(&Method::Exchange(Vec::new()), &mut evaluator, None, seed);
        self.best = evaluator.best().cloned();
        self.solves = evaluator.solves();
        self.memo = evaluator.into_memo();
        let exhausted = match chosen {
            Ok(choice) => !choice.spent,
            Err(ChoiceError::TooFew { .. } | ChoiceError::Stop(Stop::Spent)) => false,
            Err(other) => return Err(fault(&other)),
        };
        self.ended = exhausted || self.allowed >= budget;
        Ok(())
    }

    /// The matrix of a beam, once it is computed.
    pub fn dose(&self, beam: u16) -> Option<&Rows> {
        self.doses.get(usize::from(beam))
    }

    /// Centres of the bixels of a beam, mm.
    pub fn bixels_mm(&self, beam: u16) -> &[[f64; 2]] {
        self.bixels_mm.get(usize::from(beam)).map_or(&[], Vec::as_slice)
    }

    /// Bixels that a plan has at most.
    pub fn most_bixels(&self) -> usize {
        let mut counts: Vec<usize> = self.bixels_mm.iter().map(Vec::len).collect();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        counts.iter().take(self.asked.beams).sum()
    }
}

fn fault(why: &dyn std::fmt::Display) -> StepError {
    StepError(why.to_string())
}
