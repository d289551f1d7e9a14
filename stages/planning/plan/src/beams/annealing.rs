//! Simulated annealing.

use rand::RngExt as _;

use super::evaluator::{Evaluator, Influence, Stop};
use super::greedy;
use super::random::draw;

/// Temperatures at the first and the last solve, relative to the cost of the greedy set.
const HOT: f64 = 0.03;
const COLD: f64 = 0.0005;
/// Proposals without a solve after which it ends: its neighbourhood is known.
const PATIENCE: usize = 10_000;

/// From the greedy set, exchanges a random beam for a random legal one; a dearer set is taken with probability
/// `exp(-increase / temperature)`. The temperature falls from solve to solve, by the part of the budget that is spent.
pub fn search<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>, seed: u64) -> Result<(), Stop> {
    let mut now = greedy::search(evaluator)?;
    let ring = evaluator.ring();
    let (scale, all) = (now.cost, evaluator.solves_left().max(1));
    let (mut proposal, mut idle) = (0, 0);
    while idle < PATIENCE {
        let mut rng = draw(seed, 2, proposal);
        proposal += 1;
        let mut others = now.beams.beams().to_vec();
        let left = others.remove(rng.random_range(0..others.len()));
        let legal: Vec<u16> = ring.legal(&others).into_iter().filter(|beam| *beam != left).collect();
        if legal.is_empty() {
            idle += 1;
            continue;
        }
        others.push(legal[rng.random_range(0..legal.len())]);
        let Ok(set) = ring.set(&others) else { continue };
        idle = if evaluator.knows(&set) { idle + 1 } else { 0 };
        let spent = 1.0 - evaluator.solves_left() as f64 / all as f64;
        let temperature = scale * HOT * libm::pow(COLD / HOT, spent);
        let next = evaluator.evaluate(&set, Some(&now))?;
        if rng.random::<f64>() < libm::exp((now.cost - next.cost) / temperature) {
            now = next;
        }
    }
    Ok(())
}
