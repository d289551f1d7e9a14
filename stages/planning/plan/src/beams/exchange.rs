//! Exchange: a local search that prices replacements of a beam beside the beams that stay.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::evaluator::{Evaluated, Evaluator, Influence, Stop};
use super::greedy::by_price;
use super::method::rotations;
use super::random;
use super::ring::{BeamSet, RingError};

/// Replacements of a beam that are solved in one round.
const TRIED: usize = 2;
/// Length of a price list: replacements beyond it are not solved.
const LIST: usize = 4;
/// Part of the budget that the rotations of equal beams may take, one in so many.
const FOR_ROTATIONS: usize = 4;
/// Draws without a new set after which the search ends.
const PATIENCE: usize = 10_000;

/// From the best of `starts` (or of rotations of equal beams, where there are none), exchanges one beam for another as long
/// as that is better.
///
/// The beam of the least weight goes first. The set without it is solved, all legal beams are priced beside that, and the two
/// of the highest price are solved; then the next beam goes. Rounds without gain look further down the lists, to the fourth
/// beam. At the end of the lists the search begins again at a random set, until the budget is spent or hardly any set is new.
pub fn search<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    starts: &[BeamSet],
    seed: u64,
) -> Result<(), Stop> {
    let (ring, beams) = (evaluator.ring(), evaluator.beams());
    let first = match starts {
        [] => some_rotations(evaluator).unwrap_or_default(),
        starts => starts.to_vec(),
    };
    let solved = evaluator.evaluate_all(&first, None)?;
    let mut start = solved.into_iter().reduce(|a, b| if b.cost < a.cost { b } else { a });
    let mut lists = BTreeMap::new();
    let (mut drawn, mut idle) = (0, 0);
    while idle < PATIENCE {
        if let Some(start) = start.take() {
            descend(evaluator, start, &mut lists)?;
        }
        let Ok(set) = random::set(ring, beams, &mut random::draw(seed, 3, drawn)) else { return Ok(()) };
        drawn += 1;
        if evaluator.knows(&set) {
            idle += 1;
            continue;
        }
        idle = 0;
        start = Some(evaluator.evaluate(&set, None)?);
    }
    Ok(())
}

/// Rotations of equal beams, evenly spread, that take a quarter of the budget at most.
pub fn some_rotations<I: Influence + ?Sized>(
    evaluator: &Evaluator<'_, I>,
) -> Result<Vec<BeamSet>, RingError> {
    let all = rotations(evaluator.ring(), evaluator.beams())?;
    let most = (evaluator.solves_left() / FOR_ROTATIONS).max(1);
    Ok(all.iter().step_by(all.len().div_ceil(most).max(1)).cloned().collect())
}

/// Exchanges beams until no list has a gain.
fn descend<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    start: Arc<Evaluated>,
    lists: &mut BTreeMap<BeamSet, Vec<u16>>,
) -> Result<(), Stop> {
    let mut now = start;
    let mut depth = 0;
    while depth < LIST {
        match better(evaluator, &now, depth, lists)? {
            Some(better) => (now, depth) = (better, 0),
            None => depth += TRIED,
        }
    }
    Ok(())
}

/// The first exchange with a gain among those at this depth of the price lists.
fn better<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    now: &Evaluated,
    depth: usize,
    lists: &mut BTreeMap<BeamSet, Vec<u16>>,
) -> Result<Option<Arc<Evaluated>>, Stop> {
    let ring = evaluator.ring();
    for slot in by_burden(now) {
        let mut others = now.beams.beams().to_vec();
        let left = others.remove(slot);
        // A single beam is priced beside nothing.
        let stay = match ring.set(&others) {
            Ok(stay) if !others.is_empty() => Some(evaluator.evaluate(&stay, Some(now))?),
            _ => None,
        };
        let key = stay.as_ref().map_or_else(|| now.beams.clone(), |stay| stay.beams.clone());
        let list = match lists.get(&key) {
            Some(list) => list,
            None => {
                let list = by_price(evaluator, stay.as_deref(), &ring.legal(&others))?;
                lists.entry(key).or_insert(list)
            }
        };
        let dearest = list.iter().filter(|beam| **beam != left).skip(depth).take(TRIED);
        let tried: Vec<BeamSet> =
            dearest.filter_map(|beam| ring.set(&[&others[..], &[*beam]].concat()).ok()).collect();
        let solved = evaluator.evaluate_all(&tried, stay.as_deref().or(Some(now)))?;
        let best = solved.into_iter().reduce(|a, b| if b.cost < a.cost { b } else { a });
        if let Some(best) = best.filter(|best| best.cost < now.cost) {
            return Ok(Some(best));
        }
    }
    Ok(None)
}

/// Slots of a plan, that of the least weight first.
pub fn by_burden(plan: &Evaluated) -> Vec<usize> {
    let burden =
        |slot: usize| plan.plan.weights[plan.starts[slot]..plan.starts[slot + 1]].iter().sum::<f64>();
    let mut slots: Vec<usize> = (0..plan.beams.beams().len()).collect();
    slots.sort_by(|a, b| burden(*a).total_cmp(&burden(*b)));
    slots
}
