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
///
/// Where the evaluator allows more than one leaf under way, the next slots are begun before it is known whether the ones
/// before have a gain. A leaf is the set without a beam, or the two replacements. What a gain makes useless is counted,
/// too; if it is better yet, the search goes on from there.
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
    let mut start = cheapest(solved);
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

/// Exchanges beams of one set as long as that is better, without a new beginning: until no list has a gain, or the budget is
/// spent.
///
/// # Errors
/// A problem could not be made, or the budget was spent.
pub fn improve<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>, start: &BeamSet) -> Result<(), Stop> {
    let start = evaluator.evaluate(start, None)?;
    descend(evaluator, start, &mut BTreeMap::new())
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
    // Leaves under way that were begun at a set before `now`: a gain made them useless, unless one is better yet.
    let mut earlier = 0;
    loop {
        match look(evaluator, &now, lists)? {
            Look::Better(better) => (now, earlier) = (better, evaluator.leaves_in_progress()),
            Look::Exhausted if evaluator.leaves_in_progress() == 0 => return Ok(()),
            Look::Exhausted | Look::Later => {
                let solved = evaluator.take_next()?.unwrap_or_default();
                let full = solved.into_iter().filter(|set| set.beams.beams().len() == evaluator.beams());
                let best = cheapest(full).filter(|best| earlier > 0 && best.cost < now.cost);
                earlier = earlier.saturating_sub(1);
                if let Some(best) = best {
                    (now, earlier) = (best, evaluator.leaves_in_progress());
                }
            }
        }
    }
}

/// What the exchanges of a set are found to be.
enum Look {
    /// An exchange with a gain.
    Better(Arc<Evaluated>),
    /// Results are awaited.
    Later,
    /// None at any depth of the price lists has a gain.
    Exhausted,
}

/// Begins exchanges as far as there is room for leaves under way, slot by slot down the price lists; or gives the first
/// one with a gain.
fn look<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    now: &Arc<Evaluated>,
    lists: &mut BTreeMap<BeamSet, Vec<u16>>,
) -> Result<Look, Stop> {
    let ring = evaluator.ring();
    let mut is_awaited = false;
    let slots = by_burden(now);
    for (depth, slot) in
        (0..LIST).step_by(TRIED).flat_map(|depth| slots.iter().map(move |slot| (depth, *slot)))
    {
        let mut others = now.beams.beams().to_vec();
        let left = others.remove(slot);
        // A single beam is priced beside nothing.
        let stay = match ring.set(&others) {
            Ok(stay) if !others.is_empty() => {
                if !evaluator.knows(&stay) {
                    if !begin(evaluator, &[stay], now)? {
                        return Ok(Look::Later);
                    }
                    is_awaited = true;
                    continue;
                }
                Some(evaluator.evaluate(&stay, None)?)
            }
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
        if tried.iter().any(|set| !evaluator.knows(set)) {
            if !begin(evaluator, &tried, stay.as_ref().unwrap_or(now))? {
                return Ok(Look::Later);
            }
            is_awaited = true;
            continue;
        }
        let solved = evaluator.evaluate_all(&tried, None)?;
        if let Some(best) = cheapest(solved).filter(|best| best.cost < now.cost) {
            return Ok(Look::Better(best));
        }
    }
    Ok(if is_awaited { Look::Later } else { Look::Exhausted })
}

/// Begins those of these sets that are not solved; false if results are awaited first.
fn begin<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    sets: &[BeamSet],
    near: &Arc<Evaluated>,
) -> Result<bool, Stop> {
    if sets.iter().all(|set| evaluator.knows(set) || evaluator.is_in_progress(set)) {
        return Ok(evaluator.has_room());
    }
    if !evaluator.has_room() {
        return Ok(false);
    }
    if !evaluator.begin(sets, Some(near))? {
        return if evaluator.leaves_in_progress() > 0 { Ok(false) } else { Err(Stop::Spent) };
    }
    Ok(evaluator.has_room())
}

/// The set of the least cost, the first among equals.
fn cheapest(solved: impl IntoIterator<Item = Arc<Evaluated>>) -> Option<Arc<Evaluated>> {
    solved.into_iter().reduce(|a, b| if b.cost < a.cost { b } else { a })
}

/// Slots of a plan, that of the least weight first.
pub fn by_burden(plan: &Evaluated) -> Vec<usize> {
    let burden =
        |slot: usize| plan.plan.weights[plan.starts[slot]..plan.starts[slot + 1]].iter().sum::<f64>();
    let mut slots: Vec<usize> = (0..plan.beams.beams().len()).collect();
    slots.sort_by(|a, b| burden(*a).total_cmp(&burden(*b)));
    slots
}
