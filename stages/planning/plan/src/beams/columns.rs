//! Column generation over beams: the columns of a beam enter by price and leave by how little they carry.

use super::evaluator::{Evaluator, Influence, Stop};
use super::exchange::by_burden;
use super::greedy::{self, dearest};

/// Beams beyond the number wanted that the plan grows to, as a part of that number.
const SURPLUS: f64 = 0.6;

/// Grows the greedy plan beyond its number by price, takes the beams away that carry least, one at a time, and does so
/// again from what remains while that is better.
pub fn search<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>) -> Result<(), Stop> {
    let mut now = greedy::search(evaluator)?;
    let (ring, requested) = (evaluator.ring(), evaluator.beams());
    let most = requested + ((SURPLUS * requested as f64).ceil() as usize).max(1);
    loop {
        let before = now.cost;
        let mut grown = now;
        while grown.beams.beams().len() < most {
            let legal = ring.legal(grown.beams.beams());
            let Some(beam) = dearest(evaluator, Some(&grown), &legal)? else { break };
            let Ok(set) = ring.set(&[grown.beams.beams(), &[beam]].concat()) else { break };
            grown = evaluator.evaluate(&set, Some(&grown))?;
        }
        while grown.beams.beams().len() > requested {
            let mut beams = grown.beams.beams().to_vec();
            beams.remove(by_burden(&grown)[0]);
            let Ok(set) = ring.set(&beams) else { break };
            grown = evaluator.evaluate(&set, Some(&grown))?;
        }
        if grown.cost >= before {
            return Ok(());
        }
        now = grown;
    }
}
