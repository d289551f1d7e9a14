//! A checked request: the search for the beams of a plan.

use std::collections::BTreeSet;
use std::fmt;
use std::num::NonZeroUsize;

use super::doses::PlanDoses;
use super::name::MethodName;
use super::setup::PlanSetup;
use crate::beams::{
    BeamSet, Budget, Choice, ChoiceError, Directions, Evaluator, Influence, Method, Mixture, Prior, Progress,
    Ring, RingDoses, RingError, SecondPlayer, choose, set_of_prior,
};
use crate::dose::{BeamAngles, EngineName};

/// What a trained network says of a case.
pub trait LearnedBeams: fmt::Debug + Send + Sync {
    /// Scores of beams.
    fn prior(&self) -> Box<dyn Prior>;
    /// At most so many sets of beams, the best first.
    ///
    /// # Errors
    /// So many beams do not fit on the ring.
    fn proposals(&self, ring: Ring, beams: usize, most: usize) -> Result<Vec<BeamSet>, RingError>;
}

/// The search of a checked [`super::PlanRequest`].
pub struct PlanSearch {
    /// Name of the method.
    pub name: MethodName,
    pub(super) method: Method,
    pub(super) directions: Directions,
    /// Beams of the plan.
    pub beams: usize,
    /// Most sets of beams that are solved.
    pub budget: usize,
    /// Leaves that the search may have under way.
    pub leaves: NonZeroUsize,
    pub(super) mixture: Option<Mixture<'static>>,
    /// Seed of the random methods.
    pub seed: u64,
    /// Threads; no plan depends on them.
    pub threads: NonZeroUsize,
}

/// A search that has ended.
#[derive(Clone, Debug)]
pub struct PlanRun {
    /// Name of the method.
    pub name: MethodName,
    /// Most sets of beams that were allowed to be solved.
    pub budget: usize,
    /// Leaves that the search had under way at most.
    pub leaves: NonZeroUsize,
    /// The best set of beams with its fluence.
    pub choice: Choice,
    /// Every solve.
    pub history: Vec<Progress>,
    /// Beams priced.
    pub prices: usize,
    /// The angles behind the numbers of the beams of the history.
    pub directions: Directions,
}

impl PlanRun {
    /// Its name for people, among others.
    pub fn label(&self) -> String {
        match self.directions.step_deg() {
            None if self.history.len() > 1 => format!("{}, couch angles", self.name),
            _ => self.name.to_string(),
        }
    }

    /// Solves.
    pub fn solves(&self) -> usize {
        self.history.last().map_or(0, |last| last.solves)
    }
}

impl PlanSearch {
    /// What is known of beams without a solve.
    pub fn prior(&self) -> Option<&dyn Prior> {
        self.mixture.as_ref().map(|mixture| mixture as &dyn Prior)
    }

    /// Beams that need a dose, rising: all of the ring, unless the method is sure to use fewer.
    pub fn needed_beams(&self) -> Vec<u16> {
        let ring = self.directions.ring();
        let all = || (0..ring.count()).collect();
        let nearest = |angles: &[f64]| -> Vec<u16> {
            let beams: BTreeSet<u16> = angles.iter().map(|angle| ring.nearest(*angle)).collect();
            beams.into_iter().collect()
        };
        match &self.method {
            Method::Prior => {
                let set = self.prior().and_then(|prior| set_of_prior(prior, ring, self.beams).ok());
                set.map_or_else(all, |set| set.beams().to_vec())
            }
            Method::Sets(sets) => {
                let beams: BTreeSet<u16> = sets.iter().flat_map(BeamSet::beams).copied().collect();
                beams.into_iter().collect()
            }
            Method::Class(angles) => nearest(angles),
            _ => all(),
        }
    }

    /// The beams of the plan, rising, where they are known without a search.
    pub fn only_beams(&self) -> Option<Vec<u16>> {
        let beams = self.needed_beams();
        (beams.len() == self.beams).then_some(beams)
    }

    /// The evaluator of the search on the doses of a set-up.
    pub fn evaluator<'a>(
        &self,
        setup: &'a PlanSetup,
        doses: &'a PlanDoses,
        second: Option<&'a SecondPlayer<'a>>,
    ) -> Evaluator<'a, RingDoses> {
        let evaluator = self.evaluator_on(setup, &doses.solved);
        match second {
            Some(second) => evaluator.against(second),
            None => evaluator,
        }
    }

    /// The evaluator of the search on dose matrices of the planned set-up or of another one.
    pub fn evaluator_on<'a, I: Influence + ?Sized>(
        &self,
        setup: &'a PlanSetup,
        influence: &'a I,
    ) -> Evaluator<'a, I> {
        let budget = Budget { solves: self.budget };
        let evaluator = Evaluator::new(influence, &setup.goals, self.directions.ring(), self.beams, budget);
        let evaluator = evaluator.with_threads(self.threads).with_leaves(self.leaves);
        // One set by superposition is solved again on corrected columns, which move its optimum by more than this.
        let is_settled = setup.engine_name() != EngineName::Pencil
            && matches!(&self.method, Method::Sets(sets) if sets.len() == 1);
        if is_settled { evaluator.coarse() } else { evaluator }
    }

    /// The search whose only set are all beams of these directions.
    ///
    /// # Errors
    /// The directions make no set.
    pub fn of_directions(&self, directions: &Directions, angles: &[BeamAngles]) -> Result<Self, RingError> {
        let set = directions.set_of(angles)?;
        Ok(Self { directions: directions.clone(), ..self.of_beams(&set) })
    }

    /// The search whose only set of beams is this: the plan of its beams on other doses.
    pub fn of_beams(&self, beams: &BeamSet) -> Self {
        Self {
            name: self.name,
            method: Method::Sets(vec![beams.clone()]),
            directions: self.directions.clone(),
            beams: self.beams,
            budget: 1,
            leaves: NonZeroUsize::MIN,
            mixture: None,
            seed: self.seed,
            threads: self.threads,
        }
    }

    /// Searches until the method ends or the evaluator stops it.
    ///
    /// # Errors
    /// No set of beams was solved.
    pub fn choose<I: Influence + ?Sized>(
        &self,
        evaluator: &mut Evaluator<'_, I>,
    ) -> Result<Choice, ChoiceError> {
        choose(&self.method, evaluator, self.prior(), self.seed)
    }

    /// The same, with the course of the search.
    ///
    /// # Errors
    /// No set of beams was solved.
    pub fn run<I: Influence + ?Sized>(
        &self,
        mut evaluator: Evaluator<'_, I>,
    ) -> Result<PlanRun, ChoiceError> {
        let choice = self.choose(&mut evaluator)?;
        let (history, prices) = (evaluator.history().to_vec(), evaluator.prices());
        Ok(PlanRun {
            name: self.name,
            budget: self.budget,
            leaves: self.leaves,
            choice,
            history,
            prices,
            directions: self.directions.clone(),
        })
    }
}
