//! The best set of a ring, proved: all sets are solved roughly, and those whose bound reaches the best cost are solved again.

use std::sync::Arc;

use stillpoint_plan::Rows;
use stillpoint_plan::beams::{BeamSet, Budget, Evaluated, Evaluator, Method, Ring, choose};
use stillpoint_plan::fluence::Goals;

/// Tolerance of the rough solves. The certificate of each bounds the optimum from below.
const ROUGH: f64 = 1e-3;
/// Solves of the search that finds a good set before the proof begins.
const BEFOREHAND: usize = 60;

/// The best set, and what its proof took.
#[derive(Clone, Debug, PartialEq)]
pub struct Proved {
    pub set: BeamSet,
    pub cost: f64,
    /// Sets of the ring.
    pub sets: usize,
    /// Solves of the proof.
    pub solves: usize,
}

/// Finds the best set of `beams` beams on a ring of at most 20 angles. `on_solve` gets the number of rough solves.
pub fn prove(
    doses: &[Rows],
    goals: &Goals,
    ring: Ring,
    beams: usize,
    mut on_solve: impl FnMut(usize),
) -> Result<Proved, Box<dyn std::error::Error>> {
    let angles = ring.count();
    if angles > 20 || ring.gap() > 1 {
        return Err(
            format!("a proof needs a ring of at most 20 angles that are all legal, not {angles}").into()
        );
    }
    let mut evaluator = Evaluator::new(doses, goals, ring, beams, Budget { solves: BEFOREHAND });
    let good = choose(&Method::Exchange(Vec::new()), &mut evaluator, None, 0)?.best;
    let mut best = (good.beams.clone(), good.cost);
    // An evaluator keeps what it solved: one for each set keeps the memory small.
    let evaluator = || Evaluator::new(doses, goals, ring, beams, Budget { solves: 1 });
    let (mut sets, mut near, mut doubtful) = (0, None::<Arc<Evaluated>>, Vec::new());
    for mask in subsets(angles, beams) {
        let set: Vec<u16> = (0..angles).filter(|beam| mask >> beam & 1 == 1).collect();
        let solved = evaluator().with_tolerance(ROUGH)?.evaluate(&ring.set(&set)?, near.as_deref())?;
        let bound = solved.cost - solved.plan.certificate.excess;
        if bound < best.1 {
            doubtful.push((bound, solved.clone()));
        }
        near = Some(solved);
        sets += 1;
        on_solve(sets);
    }
    doubtful.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut solves = sets;
    for (bound, rough) in doubtful {
        if bound < best.1 {
            let solved = evaluator().evaluate(&rough.beams, Some(&rough))?;
            solves += 1;
            if solved.cost < best.1 {
                best = (solved.beams.clone(), solved.cost);
            }
        }
    }
    let (set, cost) = best;
    Ok(Proved { set, cost, sets, solves })
}

/// All subsets of `size` of `count` bits, rising.
fn subsets(count: u16, size: usize) -> impl Iterator<Item = u32> {
    let end = 1_u64 << count;
    let mut next = (1_u64 << size) - 1;
    std::iter::from_fn(move || {
        if size == 0 || next >= end {
            return None;
        }
        let chosen = next;
        // The next number with as many bits (Gosper).
        let low = chosen & chosen.wrapping_neg();
        let ripple = chosen + low;
        next = ripple | (((chosen ^ ripple) >> 2) / low);
        Some(chosen as u32)
    })
}

#[cfg(test)]
mod tests {
    use rand::{RngExt as _, SeedableRng as _};
    use stillpoint_plan::Csc;
    use stillpoint_plan::fluence::{Objective, Overdose, StructureObjectives, Underdose};

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
        let requested = |name: &str, voxels: std::ops::Range<u32>, objectives| StructureObjectives {
            name: name.into(),
            voxels: voxels.collect(),
            volumes: Vec::new(),
            to_target_mm: Vec::new(),
            objectives,
        };
        let over = |dose, weight| Objective::Overdose(Overdose { dose, weight });
        let target = vec![over(60.0, 10.0), Objective::Underdose(Underdose { dose: 60.0, weight: 20.0 })];
        let goals =
            vec![requested("target", 0..12, target), requested("organ", 12..30, vec![over(20.0, 5.0)])];
        (doses, Goals::new(goals, 30).unwrap())
    }

    #[test]
    fn the_proved_set_is_that_of_solving_all_sets_exactly() {
        let (doses, goals) = problem();
        let ring = Ring::new(10, 1).unwrap();
        let proved = prove(&doses, &goals, ring, 3, |_| ()).unwrap();
        let mut best = (None, f64::INFINITY);
        for mask in subsets(10, 3) {
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
        assert!((121..140).contains(&proved.solves), "{}", proved.solves);
    }

    #[test]
    fn subsets_are_all_of_their_size_once() {
        let found: Vec<u32> = subsets(6, 3).collect();
        assert_eq!(found.len(), 20);
        assert!(found.iter().all(|set| set.count_ones() == 3 && *set < 64));
        assert!(found.is_sorted_by(|a, b| a < b));
        assert_eq!(subsets(2, 3).count(), 0);
    }
}
