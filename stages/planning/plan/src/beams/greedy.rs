//! Greedy by price.

use std::sync::Arc;

use super::evaluator::{Evaluated, Evaluator, Influence, Stop};
use super::ring::Ring;

/// Adds beams until the plan has its number: each time the legal one of the highest price, the first among equals.
///
/// A beam is legal if the beams that follow still find room.
pub fn search<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>) -> Result<Arc<Evaluated>, Stop> {
    let (ring, requested) = (evaluator.ring(), evaluator.beams());
    let mut now: Option<Arc<Evaluated>> = None;
    loop {
        let chosen = now.as_ref().map_or(&[][..], |now| now.beams.beams()).to_vec();
        let room = |beam: &u16| leaves_room(ring, &[&chosen[..], &[*beam]].concat(), requested);
        let candidates: Vec<u16> = ring.legal(&chosen).into_iter().filter(room).collect();
        let Some(beam) = dearest(evaluator, now.as_deref(), &candidates)? else {
            return now.ok_or(Stop::Spent);
        };
        let Ok(set) = ring.set(&[&chosen[..], &[beam]].concat()) else { return now.ok_or(Stop::Spent) };
        let next = evaluator.evaluate(&set, now.as_deref())?;
        if set.beams().len() == requested {
            return Ok(next);
        }
        now = Some(next);
    }
}

/// The candidate of the highest price; the first among equals.
pub fn dearest<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    base: Option<&Evaluated>,
    candidates: &[u16],
) -> Result<Option<u16>, Stop> {
    Ok(by_price(evaluator, base, candidates)?.first().copied())
}

/// The candidates that have a price, the highest first.
pub fn by_price<I: Influence + ?Sized>(
    evaluator: &mut Evaluator<'_, I>,
    base: Option<&Evaluated>,
    candidates: &[u16],
) -> Result<Vec<u16>, Stop> {
    let prices = evaluator.price(base, candidates)?;
    let mut order: Vec<usize> = (0..candidates.len()).filter(|at| prices[*at] > f64::NEG_INFINITY).collect();
    order.sort_by(|a, b| prices[*b].total_cmp(&prices[*a]));
    Ok(order.into_iter().map(|i| candidates[i]).collect())
}

/// Whether the arcs between these beams have room for `requested` beams in all.
pub fn leaves_room(ring: Ring, beams: &[u16], requested: usize) -> bool {
    let mut sorted = beams.to_vec();
    sorted.sort_unstable();
    let (count, gap) = (ring.count(), ring.gap());
    let arc = |i: usize| match sorted.get(i + 1) {
        Some(next) => next - sorted[i],
        None => sorted[0] + count - sorted[i],
    };
    let more: usize = (0..sorted.len()).map(|i| usize::from(arc(i) / gap).saturating_sub(1)).sum();
    sorted.len() + more >= requested
}
