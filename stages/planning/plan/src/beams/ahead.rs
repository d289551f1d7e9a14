//! Looking ahead: sets that are under way while a search goes on, taken in the order in which they were begun.
//!
//! What a search knows when it chooses a leaf depends on the number of leaves that may be under way, never on what is
//! solved first: so its course is the same on one thread, on eight, and on a pool of workers.

use std::sync::Arc;

use super::evaluator::{Evaluated, Evaluator, Influence, Stop};
use super::ring::BeamSet;
use super::solver::Begun;

/// One leaf: sets that are begun and taken together.
pub struct Group {
    sets: Vec<BeamSet>,
    near: Option<Arc<Evaluated>>,
}

impl<I: Influence + ?Sized> Evaluator<'_, I> {
    /// Whether one more leaf may be under way.
    pub fn has_room(&self) -> bool {
        self.in_progress.len() < self.leaves.get()
    }

    /// Leaves that are under way.
    pub fn leaves_in_progress(&self) -> usize {
        self.in_progress.len()
    }

    /// Whether a set is under way.
    pub fn is_in_progress(&self, set: &BeamSet) -> bool {
        self.in_progress.iter().any(|group| group.sets.contains(set))
    }

    /// Begins a leaf: the sets that are neither solved nor under way, as many as the budget allows, each from the
    /// fluence of a neighbouring set where one is given. Gives whether there are any. What is begun is counted when it
    /// is taken, and all of it is taken, whatever the search finds meanwhile.
    ///
    /// # Errors
    /// As for [`super::Solver::begin`].
    pub fn begin(&mut self, sets: &[BeamSet], near: Option<&Arc<Evaluated>>) -> Result<bool, Stop> {
        let begun: usize = self.in_progress.iter().map(|group| group.sets.len()).sum();
        let mut fresh: Vec<BeamSet> = Vec::new();
        for set in sets {
            if !self.knows(set) && !self.is_in_progress(set) && !fresh.contains(set) {
                fresh.push(set.clone());
            }
        }
        fresh.truncate(self.solves_left().saturating_sub(begun));
        if fresh.is_empty() {
            return Ok(false);
        }
        if let Some(solver) = &mut self.elsewhere {
            let unknown: Vec<&BeamSet> =
                fresh.iter().filter(|set| !self.memo.solved.contains_key(*set)).collect();
            if !unknown.is_empty() {
                solver.begin(&unknown, near.map(|near| &**near), self.tolerance)?;
            }
            // A set without a beam is solved so that its replacements are priced.
            for set in unknown.iter().filter(|set| set.beams().len() < self.beams) {
                solver.expect_prices(set, &self.ring.legal(set.beams()));
            }
        }
        self.in_progress.push_back(Group { sets: fresh, near: near.cloned() });
        Ok(true)
    }

    /// The sets of the leaf that was begun first; nothing where none is under way.
    ///
    /// # Errors
    /// As for [`Evaluator::evaluate_all`].
    pub fn take_next(&mut self) -> Result<Option<Vec<Arc<Evaluated>>>, Stop> {
        self.solve_all_in_progress()?;
        let Some(group) = self.in_progress.pop_front() else { return Ok(None) };
        self.evaluate_all(&group.sets, group.near.as_deref()).map(Some)
    }

    /// Solves all that is under way at once, on the threads of this process, if the next leaf is not solved.
    fn solve_all_in_progress(&mut self) -> Result<(), Stop> {
        if self.elsewhere.is_some() || self.threads.get() == 1 || self.in_progress.len() < 2 {
            return Ok(());
        }
        let is_missing = |set: &&BeamSet| !self.memo.solved.contains_key(*set);
        if !self.in_progress.iter().take(1).flat_map(|group| &group.sets).any(|set| is_missing(&set)) {
            return Ok(());
        }
        let begun = self
            .in_progress
            .iter()
            .flat_map(|group| group.sets.iter().filter(is_missing).map(|set| (set, group.near.as_deref())));
        let begun: Vec<Begun<'_>> = begun.collect();
        let solved = self.local().solve_begun(&begun, self.tolerance)?;
        let solved = self.answered(solved)?;
        self.memo.solved.extend(solved.into_iter().map(|set| (set.beams.clone(), Arc::new(set))));
        Ok(())
    }
}
