//! The search with couch angles, from the best set of beams without them.

use thiserror::Error;

use super::search::{PlanRun, PlanSearch};
use super::setup::PlanSetup;
use super::spec::RobustBy;
use crate::beams::{
    Budget, ChoiceError, Evaluated, Evaluator, LazyDoses, RingError, Stop, candidates, improve,
};
use crate::dose::{BeamAngles, CacheError, DoseCache};

/// Least rise of a mean dose that is reported, Gy.
const LEAST_RISE_GY: f64 = 0.5;

/// What a search with couch angles found.
#[derive(Clone, Debug)]
pub struct CouchRun {
    /// The search. Its cost is never above that of the set it began with.
    pub run: PlanRun,
    /// Directions among which it chose.
    pub candidates: usize,
    /// Of these, the directions whose doses at all points were needed.
    pub doses: usize,
    /// Structures whose mean dose at the points is higher than in the plan it began with.
    pub higher: Vec<Higher>,
}

/// A structure that gets more than in the plan without couch angles.
#[derive(Clone, Debug, PartialEq)]
pub struct Higher {
    /// Its name.
    pub structure: String,
    /// Mean dose without couch angles, gray.
    pub coplanar_gy: f64,
    /// Mean dose with couch angles, gray.
    pub mean_gy: f64,
}

/// The reasons why there is no search with couch angles.
#[derive(Debug, Error)]
pub enum CouchError {
    /// The robust game has no such search.
    #[error(
        "the robust game of the worst set-up has no search with couch angles: leave out --couch, or plan for the mean"
    )]
    Game,
    /// The candidates cannot be listed.
    #[error(transparent)]
    Ring(#[from] RingError),
    /// A dose cannot be computed.
    #[error(transparent)]
    Dose(#[from] CacheError),
    /// No set of beams was solved.
    #[error(transparent)]
    Choice(#[from] ChoiceError),
}

impl PlanSearch {
    /// Exchanges beams of a plan without couch angles for others at couch angles up to `most_deg` to both sides, where gantry and
    /// couch of the machine have room, as long as that is better. The budget is that of this search once more; it begins
    /// with a solve of the set of the plan, so its objective is never worse. Directions that have no beam are no candidates: a beam that enters
    /// the patient by the end of the images is none.
    ///
    /// # Errors
    /// A dose cannot be computed, or the goals are those of the robust game.
    pub fn with_couch(
        &self,
        setup: &PlanSetup,
        cache: &DoseCache,
        coplanar: &PlanRun,
        most_deg: f64,
    ) -> Result<CouchRun, CouchError> {
        if setup.spec.robust_by == RobustBy::Worst && setup.parts.is_some() {
            return Err(CouchError::Game);
        }
        let before = &coplanar.choice.best;
        let beams = coplanar.directions.all(before.beams.beams());
        let has_beam = |angles: BeamAngles| setup.engines().iter().all(|engine| engine.has_beam(angles));
        let directions = candidates(&beams, most_deg, &setup.spec.machine.free_angles(), has_beam)?;
        let start = directions.set_of(&beams)?;
        let doses = LazyDoses::new(&directions, &setup.goals, setup.engines(), cache, self.threads);
        let budget = Budget { solves: self.budget };
        let evaluator = Evaluator::new(&doses, &setup.goals, directions.ring(), self.beams, budget);
        let mut evaluator = evaluator.with_threads(self.threads).with_leaves(self.leaves);
        let ended = improve(&mut evaluator, &start);
        let (history, prices) = (evaluator.history().to_vec(), evaluator.prices());
        let best = evaluator.best().cloned();
        drop(evaluator);
        let needed = doses.needed();
        // A fault of a dose is the reason of what a search says of it.
        doses.check()?;
        let spent = match ended {
            Ok(()) => false,
            Err(Stop::Spent) => true,
            Err(other) => return Err(ChoiceError::Stop(other).into()),
        };
        let few = ChoiceError::TooFew { solves: history.len(), beams: self.beams };
        let best = best.ok_or(few)?;
        Ok(CouchRun {
            higher: higher(setup, before, &best),
            candidates: usize::from(directions.ring().count()),
            doses: needed,
            run: PlanRun {
                name: self.name,
                budget: self.budget,
                leaves: self.leaves,
                choice: crate::beams::Choice { best, spent },
                history,
                prices,
                directions,
            },
        })
    }
}

/// Structures whose mean dose at the points is higher in the second plan.
fn higher(setup: &PlanSetup, coplanar: &Evaluated, plan: &Evaluated) -> Vec<Higher> {
    let rows = setup.goals.voxels();
    let mean = |plan: &Evaluated, voxels: &[u32], volumes: &[f64]| {
        let (mut sum, mut volume) = (0.0, 0.0);
        for (at, voxel) in voxels.iter().enumerate() {
            let Some(dose) = rows.binary_search(voxel).ok().and_then(|row| plan.plan.dose.get(row)) else {
                continue;
            };
            let share = volumes.get(at).copied().unwrap_or(1.0);
            sum += share * dose;
            volume += share;
        }
        if volume > 0.0 { sum / volume } else { 0.0 }
    };
    let of = |structure: &crate::fluence::StructureObjectives| {
        let [coplanar_gy, mean_gy] =
            [coplanar, plan].map(|plan| mean(plan, &structure.voxels, &structure.volumes));
        let structure = structure.name.clone();
        (mean_gy - coplanar_gy >= LEAST_RISE_GY).then_some(Higher { structure, coplanar_gy, mean_gy })
    };
    setup.objective_set.structures.iter().filter_map(of).collect()
}
