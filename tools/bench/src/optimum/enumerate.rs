//! The best set of a ring, by solving every set.

use std::collections::BTreeMap;

use stillpoint_plan::beams::{BeamSet, Budget, Evaluated, Evaluator};

use super::pelvis::Pelvis;

/// Best sets that are kept.
const KEPT: usize = 10;

/// The best sets of `beams` beams with their costs, the best first, after all were solved. `on_set` is called for each.
pub fn enumerate(
    pelvis: &Pelvis,
    beams: usize,
    mut on_set: impl FnMut(),
) -> Result<Vec<(BeamSet, f64)>, Box<dyn std::error::Error>> {
    let ring = pelvis.ring;
    let mut by_first: BTreeMap<Vec<u16>, Vec<BeamSet>> = BTreeMap::new();
    let mut beams_of_set: Vec<u16> = (0..beams as u16).collect();
    loop {
        if let Ok(set) = ring.set(&beams_of_set) {
            by_first.entry(beams_of_set[..2.min(beams)].to_vec()).or_default().push(set);
        }
        if !next(&mut beams_of_set, ring.count()) {
            break;
        }
    }
    let mut best: Vec<(BeamSet, f64)> = Vec::new();
    for sets in by_first.values() {
        // An evaluator keeps what it solved: one for each group keeps the memory small.
        let budget = Budget { solves: sets.len() };
        let mut evaluator = Evaluator::new(&pelvis.doses[..], &pelvis.goals, ring, beams, budget);
        let mut near: Option<std::sync::Arc<Evaluated>> = None;
        for set in sets {
            let solved = evaluator.evaluate(set, near.as_deref())?;
            best.push((set.clone(), solved.cost));
            near = Some(solved);
            on_set();
        }
        best.sort_by(|a, b| a.1.total_cmp(&b.1));
        best.truncate(KEPT);
    }
    Ok(best)
}

/// The next rising choice of beams out of `count`.
fn next(beams: &mut [u16], count: u16) -> bool {
    let k = beams.len();
    for i in (0..k).rev() {
        if usize::from(beams[i]) < usize::from(count) - (k - i) {
            beams[i] += 1;
            for j in i + 1..k {
                beams[j] = beams[j - 1] + 1;
            }
            return true;
        }
    }
    false
}
