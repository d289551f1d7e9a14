//! Exchange: a local search that tries the dearest beams first.

use super::evaluator::{Evaluated, Evaluator, Influence, Stop};
use super::greedy;
use super::ring::BeamSet;

/// Exchanges of a beam that are tried in one round.
const TRIED: usize = 3;

/// From the greedy set, exchanges one beam for another as long as that is better.
///
/// In each round every beam, the beam that carries least first, may be replaced by the beams with the highest price,
/// priced beside the present plan. Rounds without gain look further down the price list; the search ends at the end of
/// the list.
pub fn search<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>) -> Result<(), Stop> {
    let mut now = greedy::search(evaluator)?;
    let ring = evaluator.ring();
    let mut depth = 0;
    loop {
        // One price for each beam of the ring serves all slots.
        let all: Vec<u16> =
            (0..ring.count()).filter(|beam| now.beams.beams().binary_search(beam).is_err()).collect();
        let list = greedy::by_price(evaluator, Some(&now), &all)?;
        let mut better = None;
        let mut longest = 0;
        for slot in by_burden(&now) {
            let replacements = replacements(evaluator, &now, slot, &list);
            longest = longest.max(replacements.len());
            let tried = replacements.get(depth..replacements.len().min(depth + TRIED)).unwrap_or_default();
            for solved in evaluator.evaluate_all(tried, Some(&now))? {
                if solved.cost < better.as_ref().map_or(now.cost, |b: &std::sync::Arc<Evaluated>| b.cost) {
                    better = Some(solved);
                }
            }
            if better.is_some() {
                break;
            }
        }
        match better {
            Some(better) => (now, depth) = (better, 0),
            None if depth + TRIED < longest => depth += TRIED,
            None => return Ok(()),
        }
    }
}

/// The sets with one beam of a plan replaced, in the order of `list`.
fn replacements<I: Influence + ?Sized>(
    evaluator: &Evaluator<'_, I>,
    now: &Evaluated,
    slot: usize,
    list: &[u16],
) -> Vec<BeamSet> {
    let mut others = now.beams.beams().to_vec();
    others.remove(slot);
    list.iter().filter_map(|beam| evaluator.ring().set(&[&others[..], &[*beam]].concat()).ok()).collect()
}

/// Slots of a plan, that of the least weight first.
pub fn by_burden(plan: &Evaluated) -> Vec<usize> {
    let burden =
        |slot: usize| plan.plan.weights[plan.starts[slot]..plan.starts[slot + 1]].iter().sum::<f64>();
    let mut slots: Vec<usize> = (0..plan.beams.beams().len()).collect();
    slots.sort_by(|a, b| burden(*a).total_cmp(&burden(*b)));
    slots
}
