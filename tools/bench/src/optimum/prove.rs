//! The best set of a ring, proved: more beams never cost more, so a set of more beams that costs more than the best set
//! known rules out all sets within it.

use std::sync::Arc;

use stillpoint_plan::Rows;
use stillpoint_plan::beams::{BeamSet, Budget, Evaluated, Evaluator, Method, Ring, choose};
use stillpoint_plan::fluence::Goals;

/// Beams beyond those of a plan in the sets that are solved at first.
const WIDER: usize = 3;
/// Solves of the search that finds a good set before the proof begins.
const BEFOREHAND: usize = 60;

/// The best set, and what its proof took.
#[derive(Clone, Debug, PartialEq)]
pub struct Proved {
    /// The set.
    pub set: BeamSet,
    /// Its cost.
    pub cost: f64,
    /// Sets of the ring.
    pub sets: usize,
    /// Solves of the proof, sets of more beams included.
    pub solves: usize,
}

/// Finds the best set of `beams` beams on a ring of at most 20 angles. `on_solve` gets the numbers of solves and of sets
/// that are neither solved nor ruled out.
///
/// A set of more beams rules out the sets within it where its cost less the excess of its certificate is above the best
/// cost. Where it does not, sets of one beam less are solved in the same way, and at last the sets themselves.
pub fn prove(
    doses: &[Rows],
    goals: &Goals,
    ring: Ring,
    beams: usize,
    on_solve: impl FnMut(usize, usize),
) -> Result<Proved, Box<dyn std::error::Error>> {
    let angles = usize::from(ring.count());
    if angles > 20 || ring.gap() > 1 {
        return Err(
            format!("a proof needs a ring of at most 20 angles that are all legal, not {angles}").into()
        );
    }
    let mut evaluator = Evaluator::new(doses, goals, ring, beams, Budget { solves: BEFOREHAND });
    let good = choose(&Method::Exchange(Vec::new()), &mut evaluator, None, 0)?.best;
    let mut open = vec![false; 1 << angles];
    let mut left = 0;
    for mask in subsets((1 << angles) - 1, beams) {
        open[mask as usize] = true;
        left += 1;
    }
    let best = (good.beams.clone(), good.cost);
    let mut proof = Proof { doses, goals, ring, beams, open, left, solves: 0, best, on_solve };
    let sets = left;
    for first in subsets((1 << angles) - 1, beams) {
        while proof.open[first as usize] {
            let wide = proof.widened(first, (beams + WIDER).min(angles));
            proof.settle(wide, None)?;
        }
    }
    let (set, cost) = proof.best;
    Ok(Proved { set, cost, sets, solves: proof.solves })
}

struct Proof<'a, F> {
    doses: &'a [Rows],
    goals: &'a Goals,
    ring: Ring,
    beams: usize,
    /// By the bits of its beams, whether a set is neither solved nor ruled out.
    open: Vec<bool>,
    left: usize,
    solves: usize,
    best: (BeamSet, f64),
    on_solve: F,
}

impl<F: FnMut(usize, usize)> Proof<'_, F> {
    /// Solves or rules out every set within `wide`.
    fn settle(&mut self, wide: u32, near: Option<&Evaluated>) -> Result<(), Box<dyn std::error::Error>> {
        let solved = self.solve(wide, near)?;
        if wide.count_ones() as usize == self.beams {
            self.close(wide);
            if solved.cost < self.best.1 {
                self.best = (solved.beams.clone(), solved.cost);
            }
            return Ok(());
        }
        if solved.cost - solved.plan.certificate.excess > self.best.1 {
            subsets(wide, self.beams).for_each(|set| self.close(set));
            return Ok(());
        }
        while let Some(narrower) = self.narrower(wide) {
            self.settle(narrower, Some(&solved))?;
        }
        Ok(())
    }

    fn solve(
        &mut self,
        mask: u32,
        near: Option<&Evaluated>,
    ) -> Result<Arc<Evaluated>, Box<dyn std::error::Error>> {
        let beams: Vec<u16> = (0..self.ring.count()).filter(|beam| mask >> beam & 1 == 1).collect();
        // An evaluator keeps what it solved: one for each set keeps the memory small.
        let budget = Budget { solves: 1 };
        let mut evaluator = Evaluator::new(self.doses, self.goals, self.ring, beams.len(), budget);
        let solved = evaluator.evaluate(&self.ring.set(&beams)?, near)?;
        self.solves += 1;
        (self.on_solve)(self.solves, self.left);
        Ok(solved)
    }

    fn close(&mut self, set: u32) {
        self.left -= usize::from(std::mem::replace(&mut self.open[set as usize], false));
    }

    fn open_within(&self, wide: u32) -> usize {
        subsets(wide, self.beams).filter(|set| self.open[*set as usize]).count()
    }

    /// The set with the beams that add the most open sets, the first among equals, up to `size` beams.
    fn widened(&self, set: u32, size: usize) -> u32 {
        let mut wide = set;
        while (wide.count_ones() as usize) < size {
            let mut best = (0, wide);
            for beam in (0..self.ring.count()).filter(|beam| wide >> beam & 1 == 0) {
                let with = wide | 1 << beam;
                let open = self.open_within(with);
                if open > best.0 {
                    best = (open, with);
                }
            }
            wide = best.1;
        }
        wide
    }

    /// The set without the beam whose absence leaves the most open sets; none where no set within `wide` is open.
    fn narrower(&self, wide: u32) -> Option<u32> {
        let without =
            (0..self.ring.count()).filter(|beam| wide >> beam & 1 == 1).map(|beam| wide & !(1 << beam));
        let counted = without.map(|set| (self.open_within(set), set)).filter(|(open, _)| *open > 0);
        counted.reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, set)| set)
    }
}

/// All subsets of `size` bits of a mask, rising.
fn subsets(mask: u32, size: usize) -> impl Iterator<Item = u32> {
    let bits: Vec<u32> = (0..32).map(|bit| 1 << bit).filter(|bit| mask & bit != 0).collect();
    let end = 1_u64 << bits.len();
    let mut next = (1_u64 << size) - 1;
    std::iter::from_fn(move || {
        if size == 0 || size > bits.len() || next >= end {
            return None;
        }
        let chosen = next;
        // The next number with as many bits (Gosper).
        let low = chosen & chosen.wrapping_neg();
        let ripple = chosen + low;
        next = ripple | (((chosen ^ ripple) >> 2) / low);
        Some(bits.iter().enumerate().filter(|(i, _)| chosen >> i & 1 == 1).map(|(_, bit)| bit).sum())
    })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use stillpoint_plan::Csc;
    use stillpoint_plan::fluence::{Objective, Wanted};

    use super::*;

    /// Ten beams of two bixels over thirty voxels.
    fn problem() -> (Vec<Rows>, Goals) {
        let mut rng = chacha20::ChaCha8Rng::seed_from_u64(3);
        let doses = (0..10).map(|_| {
            let mut column = || (0..30).map(|_| rng.random_range(0.0..1.0_f32)).collect::<Vec<_>>();
            let values = [column(), column()].concat();
            let rows = (0..2).flat_map(|_| 0..30).collect();
            Rows::from_columns(Csc::new(30, vec![0, 30, 60], rows, values).unwrap().view()).unwrap()
        });
        let doses: Vec<Rows> = doses.collect();
        let wanted = |name: &str, voxels: std::ops::Range<u32>, objectives| Wanted {
            name: name.into(),
            voxels: voxels.collect(),
            volumes: Vec::new(),
            to_target_mm: Vec::new(),
            objectives,
        };
        let over = |dose, weight| Objective::Overdose { dose, weight };
        let target = vec![over(60.0, 10.0), Objective::Underdose { dose: 60.0, weight: 20.0 }];
        let goals = vec![wanted("target", 0..12, target), wanted("organ", 12..30, vec![over(20.0, 5.0)])];
        (doses, Goals::new(goals, 30).unwrap())
    }

    #[test]
    fn the_proved_set_is_that_of_solving_all_sets_in_fewer_solves() {
        let (doses, goals) = problem();
        let ring = Ring::new(10, 1).unwrap();
        let proved = prove(&doses, &goals, ring, 3, |_, _| ()).unwrap();
        let mut best = (None, f64::INFINITY);
        for mask in subsets((1 << 10) - 1, 3) {
            let beams: Vec<u16> = (0..10).filter(|beam| mask >> beam & 1 == 1).collect();
            let mut evaluator = Evaluator::new(&doses[..], &goals, ring, 3, Budget { solves: 1 });
            let solved = evaluator.evaluate(&ring.set(&beams).unwrap(), None).unwrap();
            if solved.cost < best.1 {
                best = (Some(solved.beams.clone()), solved.cost);
            }
        }
        assert_eq!(Some(proved.set), best.0);
        assert!((proved.cost / best.1 - 1.0).abs() < 1e-6);
        assert_eq!(proved.sets, 120);
        assert!(proved.solves < 120, "{}", proved.solves);
    }

    #[test]
    fn subsets_are_all_of_their_size_once() {
        let found: Vec<u32> = subsets(0b1101_0110, 3).collect();
        assert_eq!(found.len(), 10);
        assert!(found.iter().all(|set| set.count_ones() == 3 && set & !0b1101_0110 == 0));
        assert!(found.is_sorted_by(|a, b| a < b));
        assert_eq!(subsets(0b11, 3).count(), 0);
    }
}
