//! What a set of beams costs: solved, cached and counted.

use std::collections::{BTreeMap, VecDeque};
use std::num::NonZeroUsize;
use std::sync::Arc;

use thiserror::Error;

use super::ahead::Group;
use super::ring::{BeamSet, Ring};
use super::second::{Answer, SecondPlayer};
use super::solver::{COARSEST_TOLERANCE, Local, SOLVE_TOLERANCE, Solver, ToleranceError, checked_tolerance};
use crate::dose::{BeamFile, CachedBeam};
use crate::fluence::{Goals, GoalsError, Plan};
use crate::threads::on_threads;
use crate::{Rows, Setups};

/// The dose matrices of the beams of a ring.
pub trait Influence: Sync {
    /// The matrix of a beam: rows are voxels of the dose grid, in one set-up or several; columns its bixels.
    fn beam(&self, beam: u16) -> Setups<'_>;

    /// The candidates that are worth a price beside a solved set, or beside no beam; `None` where all are. The others have no
    /// price: that of minus infinity.
    fn shortlist(&self, _base: Option<&Evaluated>, _candidates: &[u16]) -> Option<Vec<u16>> {
        None
    }
}

impl Influence for [Rows] {
    fn beam(&self, beam: u16) -> Setups<'_> {
        self[usize::from(beam)].view().into()
    }
}

impl Influence for [BeamFile] {
    fn beam(&self, beam: u16) -> Setups<'_> {
        let dose = &self[usize::from(beam)];
        Setups::from(dose.dose()).placed(dose.bixels_mm())
    }
}

impl Influence for [CachedBeam] {
    fn beam(&self, beam: u16) -> Setups<'_> {
        let dose = &self[usize::from(beam)].beam;
        Setups::from(dose.dose()).placed(dose.bixels_mm())
    }
}

/// How many sets may be solved. A solve is any evaluation of a set to 1e-3 or better, cut short or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Solves.
    pub solves: usize,
}

/// A set of beams with its best fluence.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// The beams.
    pub beams: BeamSet,
    /// What the plan costs: its objective, or with a second player that under the worst set-up error.
    pub cost: f64,
    /// What a second player answered.
    pub answer: Option<Answer>,
    /// Where each beam's weights start in the plan's; one more at the end.
    pub starts: Vec<usize>,
    /// The fluence.
    pub plan: Plan,
}

/// Why an evaluation was not made.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Stop {
    /// The budget is spent.
    #[error("the budget of solves is spent")]
    Spent,
    /// The solver does not have the answers yet. A search that begins again with them, and with the memo of this one, takes
    /// the same way.
    #[error("the answers are not there yet")]
    Waiting,
    /// The goals and matrices make no problem.
    #[error(transparent)]
    Goals(#[from] GoalsError),
}

/// Progress, after each solve.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Solves until now.
    pub solves: usize,
    /// Beams priced by a gradient until now.
    pub prices: usize,
    /// Cost of the set just solved.
    pub cost: f64,
    /// Least cost of a set of as many beams as the plan has; infinite before the first.
    pub best: f64,
    /// The set just solved.
    pub beams: BeamSet,
    /// The solved set from whose fluence it began: the one that the search was at.
    pub from: Option<BeamSet>,
}

/// What earlier runs solved and priced. A search of the same budget that begins again with it takes the same way at once,
/// and goes on behind its end: with [`Evaluator::with_pause`], a search is cut into parts of so many solves each.
#[derive(Clone, Debug, Default)]
pub struct Memo {
    pub(super) solved: BTreeMap<BeamSet, Arc<Evaluated>>,
    priced: BTreeMap<BeamSet, (Vec<u16>, Vec<f64>)>,
}

/// Solves sets of beams for a search, each once, and counts what that takes.
///
/// Any search stands on this: it sees costs, fluences and prices, and ends when [`Stop::Spent`] comes. Results do not
/// depend on the number of threads.
pub struct Evaluator<'a, I: Influence + ?Sized> {
    influence: &'a I,
    goals: &'a Goals,
    pub(super) ring: Ring,
    pub(super) beams: usize,
    budget: Budget,
    /// Solves after which the search pauses, whatever its budget.
    pause: usize,
    pub(super) threads: NonZeroUsize,
    /// Leaves that a search may have under way.
    pub(super) leaves: NonZeroUsize,
    /// Sets that are under way, in the order in which they are taken.
    pub(super) in_progress: VecDeque<Group>,
    /// To which part of its optimum each set is solved.
    pub(super) tolerance: f64,
    /// Who answers each plan with a set-up error.
    second: Option<&'a SecondPlayer<'a>>,
    /// Where sets are solved, if not on threads of this process.
    pub(super) elsewhere: Option<&'a mut dyn Solver>,
    cache: BTreeMap<BeamSet, Arc<Evaluated>>,
    pub(super) memo: Memo,
    prices: usize,
    best: Option<Arc<Evaluated>>,
    history: Vec<Progress>,
    on_progress: Box<dyn FnMut(&Progress) + 'a>,
}

impl<'a, I: Influence + ?Sized> Evaluator<'a, I> {
    /// For plans of `beams` beams.
    pub fn new(influence: &'a I, goals: &'a Goals, ring: Ring, beams: usize, budget: Budget) -> Self {
        Self {
            influence,
            goals,
            ring,
            beams,
            budget,
            pause: usize::MAX,
            threads: NonZeroUsize::MIN,
            leaves: NonZeroUsize::MIN,
            in_progress: VecDeque::new(),
            tolerance: SOLVE_TOLERANCE,
            second: None,
            elsewhere: None,
            cache: BTreeMap::new(),
            memo: Memo::default(),
            prices: 0,
            best: None,
            history: Vec::new(),
            on_progress: Box::new(|_| ()),
        }
    }

    /// Solves and prices on at most this many threads.
    #[must_use]
    pub fn with_threads(mut self, threads: NonZeroUsize) -> Self {
        self.threads = threads;
        self
    }

    /// Lets a search that looks ahead have so many leaves under way: each is chosen when all results but those of the
    /// leaves under way are in. The course of the search depends on this number, and on no thread or worker.
    #[must_use]
    pub fn with_leaves(mut self, leaves: NonZeroUsize) -> Self {
        self.leaves = leaves;
        self
    }

    /// Solves each set to this part of its optimum instead of [`SOLVE_TOLERANCE`], for searches that only scout.
    ///
    /// # Errors
    /// The tolerance is not above 0 and at most 1e-3.
    pub fn with_tolerance(mut self, tolerance: f64) -> Result<Self, ToleranceError> {
        self.tolerance = checked_tolerance(tolerance)?;
        Ok(self)
    }

    /// Solves each set as coarsely as counts as a solve: for sets that are solved again.
    #[must_use]
    pub(crate) fn coarse(mut self) -> Self {
        self.tolerance = COARSEST_TOLERANCE;
        self
    }

    /// Solves each set to [`SOLVE_TOLERANCE`].
    #[must_use]
    pub(crate) fn fine(mut self) -> Self {
        self.tolerance = SOLVE_TOLERANCE;
        self
    }

    /// Solves and prices by this solver instead of on threads of this process. The results are the same.
    #[must_use]
    pub fn with_solver(mut self, solver: &'a mut dyn Solver) -> Self {
        self.elsewhere = Some(solver);
        self
    }

    /// Plays the robust game: what a plan costs is what it costs under the set-up error that this player picks. Its answers
    /// are counted in the budget, each as [`SecondPlayer::share`] of a solve.
    #[must_use]
    pub fn against(mut self, second: &'a SecondPlayer<'a>) -> Self {
        self.second = Some(second);
        self
    }

    /// Takes what earlier runs with the same doses, goals, second player and tolerance solved; it counts as solved and priced when it is asked for.
    #[must_use]
    pub fn with_memo(mut self, memo: Memo) -> Self {
        self.memo = memo;
        self
    }

    /// Stops after so many solves as if the budget were spent. Searches that share out their budget share out the whole.
    #[must_use]
    pub fn with_pause(mut self, solves: usize) -> Self {
        self.pause = solves;
        self
    }

    /// All that was solved and priced, for a run that goes on.
    pub fn into_memo(mut self) -> Memo {
        self.memo.solved.append(&mut self.cache);
        self.memo
    }

    /// Calls this after each solve.
    #[must_use]
    pub fn with_progress(mut self, on_progress: impl FnMut(&Progress) + 'a) -> Self {
        self.on_progress = Box::new(on_progress);
        self
    }

    /// The ring.
    pub fn ring(&self) -> Ring {
        self.ring
    }

    /// Beams of a plan.
    pub fn beams(&self) -> usize {
        self.beams
    }

    /// Solves until now.
    pub fn solves(&self) -> usize {
        self.history.len()
    }

    /// Solves that are left.
    pub fn solves_left(&self) -> usize {
        let share = self.second.map_or(0.0, SecondPlayer::share);
        let most = (self.budget.solves as f64 / (1.0 + share)) as usize;
        // A plan takes one solve, whatever its answer takes.
        most.max(self.budget.solves.min(1)).saturating_sub(self.solves())
    }

    /// Beams priced by a gradient until now.
    pub fn prices(&self) -> usize {
        self.prices
    }

    /// The best set of as many beams as a plan has.
    pub fn best(&self) -> Option<&Arc<Evaluated>> {
        self.best.as_ref()
    }

    /// Every solve, in order.
    pub fn history(&self) -> &[Progress] {
        &self.history
    }

    /// Whether a set was solved before: evaluating it again costs nothing.
    pub fn knows(&self, set: &BeamSet) -> bool {
        self.cache.contains_key(set)
    }

    /// The set with its best fluence, found from that of a neighbouring set where one is given.
    pub fn evaluate(&mut self, set: &BeamSet, near: Option<&Evaluated>) -> Result<Arc<Evaluated>, Stop> {
        self.evaluate_all(std::slice::from_ref(set), near)?.pop().ok_or(Stop::Spent)
    }

    /// As many of the sets, in their order, as the budget allows; at least one, or [`Stop::Spent`].
    pub fn evaluate_all(
        &mut self,
        sets: &[BeamSet],
        near: Option<&Evaluated>,
    ) -> Result<Vec<Arc<Evaluated>>, Stop> {
        let room = self.solves_left().min(self.pause.saturating_sub(self.solves()));
        let mut missing: Vec<&BeamSet> = Vec::new();
        let mut within = 0;
        for set in sets {
            if !self.knows(set) && !missing.contains(&set) {
                if missing.len() >= room {
                    break;
                }
                missing.push(set);
            }
            within += 1;
        }
        if within == 0 && !sets.is_empty() {
            return Err(Stop::Spent);
        }
        let known = |set: &BeamSet| self.memo.solved.get(set).cloned();
        let unknown: Vec<&BeamSet> = missing.iter().copied().filter(|set| known(set).is_none()).collect();
        let found: Vec<Option<Arc<Evaluated>>> = missing.iter().map(|set| known(set)).collect();
        let mut solved = self.solve(&unknown, near)?.into_iter().map(Arc::new);
        for known in found {
            known.or_else(|| solved.next()).into_iter().for_each(|solved| self.take(solved, near));
        }
        Ok(sets[..within].iter().filter_map(|set| self.cache.get(set).cloned()).collect())
    }

    fn solve(&mut self, sets: &[&BeamSet], near: Option<&Evaluated>) -> Result<Vec<Evaluated>, Stop> {
        let solved = match &mut self.elsewhere {
            Some(solver) => solver.solve(sets, near, self.tolerance)?,
            None => self.local().solve(sets, near, self.tolerance)?,
        };
        self.answered(solved)
    }

    /// The plans with the answers of the second player, if there is one.
    pub(super) fn answered(&self, mut solved: Vec<Evaluated>) -> Result<Vec<Evaluated>, Stop> {
        if let Some(second) = self.second {
            let answers = on_threads(&solved, self.threads, |plan| second.answer(plan))?;
            for (plan, (cost, answer)) in solved.iter_mut().zip(answers) {
                (plan.cost, plan.answer) = (cost, Some(answer));
            }
        }
        Ok(solved)
    }

    pub(super) fn local(&self) -> Local<'a, I> {
        Local { influence: self.influence, goals: self.goals, threads: self.threads }
    }

    fn take(&mut self, solved: Arc<Evaluated>, near: Option<&Evaluated>) {
        let better = self.best.as_ref().is_none_or(|best| solved.cost < best.cost);
        if better && solved.beams.beams().len() == self.beams {
            self.best = Some(Arc::clone(&solved));
        }
        let progress = Progress {
            solves: self.solves() + 1,
            prices: self.prices,
            cost: solved.cost,
            best: self.best.as_ref().map_or(f64::INFINITY, |best| best.cost),
            beams: solved.beams.clone(),
            from: near.map(|near| near.beams.clone()),
        };
        (self.on_progress)(&progress);
        self.history.push(progress);
        self.cache.insert(solved.beams.clone(), solved);
    }

    /// How much each of `candidates` promises beside a solved set, or beside no beam at all. Counted, one for each.
    pub fn price(&mut self, base: Option<&Evaluated>, candidates: &[u16]) -> Result<Vec<f64>, Stop> {
        self.prices += candidates.len();
        let key = base.map_or_else(BeamSet::default, |base| base.beams.clone());
        if let Some((of, prices)) = self.memo.priced.get(&key)
            && of == candidates
        {
            return Ok(prices.clone());
        }
        let prices = match &mut self.elsewhere {
            Some(solver) => solver.price(base, candidates)?,
            None => self.local().price(base, candidates)?,
        };
        self.memo.priced.insert(key, (candidates.to_vec(), prices.clone()));
        Ok(prices)
    }
}

impl Evaluated {
    /// A set, the number of bixels of each of its beams, and its best fluence.
    pub fn new(set: &BeamSet, columns: &[usize], plan: Plan) -> Self {
        let mut starts = vec![0];
        for columns in columns {
            starts.push(starts[starts.len() - 1] + columns);
        }
        Self { beams: set.clone(), cost: plan.certificate.objective, answer: None, starts, plan }
    }

    /// The objective for which the fluence was solved: the cost, where no second player answered.
    pub fn solved_cost(&self) -> f64 {
        self.plan.certificate.objective
    }

    /// Weights of one of its beams.
    pub fn weights_of(&self, beam: u16) -> Option<&[f64]> {
        let at = self.beams.beams().binary_search(&beam).ok()?;
        Some(&self.plan.weights[self.starts[at]..self.starts[at + 1]])
    }
}
