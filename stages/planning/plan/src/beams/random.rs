//! Random sets of beams.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use rand::RngExt as _;

use super::evaluator::{Evaluator, Influence, Stop};
use super::ring::{BeamSet, Ring, RingError};

/// Solved at a time: as many as threads may share.
const BATCH: usize = 8;
/// Draws without a new set after which the search ends.
const PATIENCE: usize = 10_000;

/// Random numbers of one draw of a search: the same for the same seed, method and draw.
pub fn draw(seed: u64, method: u64, draw: u64) -> ChaCha8Rng {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&method.to_le_bytes());
    key[16..24].copy_from_slice(&draw.to_le_bytes());
    ChaCha8Rng::from_seed(key)
}

/// A set of `beams` drawn uniformly from all that the ring allows.
///
/// The first beam anywhere, then the room that the gaps leave is cut at places drawn without repeats: every set comes
/// up equally often, once for each of its beams as the first.
pub fn set(ring: Ring, beams: usize, rng: &mut ChaCha8Rng) -> Result<BeamSet, RingError> {
    ring.check_room(beams)?;
    let (count, gap) = (usize::from(ring.count()), usize::from(ring.gap()));
    let first = rng.random_range(0..count);
    let places = (count + beams).saturating_sub(beams * gap + 1);
    let mut cuts: Vec<usize> = Vec::new();
    while cuts.len() + 1 < beams {
        let cut = rng.random_range(0..places);
        if !cuts.contains(&cut) {
            cuts.push(cut);
        }
    }
    cuts.sort_unstable();
    let mut chosen = vec![first];
    // Cut number i lies behind i gaps, one of which starts at the first beam.
    chosen.extend(cuts.iter().enumerate().map(|(i, cut)| first + (i + 1) * gap + cut - i));
    ring.set(&chosen.iter().map(|beam| (beam % count) as u16).collect::<Vec<_>>())
}

/// Solves sets drawn uniformly, none twice, until the budget is spent or hardly any is new.
pub fn search<I: Influence + ?Sized>(evaluator: &mut Evaluator<'_, I>, seed: u64) -> Result<(), Stop> {
    let (ring, beams) = (evaluator.ring(), evaluator.beams());
    let (mut drawn, mut idle) = (0, 0);
    let mut batch = Vec::new();
    while idle < PATIENCE {
        let Ok(set) = set(ring, beams, &mut draw(seed, 1, drawn)) else { return Ok(()) };
        drawn += 1;
        if evaluator.knows(&set) || batch.contains(&set) {
            idle += 1;
            continue;
        }
        idle = 0;
        batch.push(set);
        if batch.len() >= BATCH.min(evaluator.solves_left().max(1)) {
            evaluator.evaluate_all(&batch, None)?;
            batch.clear();
        }
    }
    if !batch.is_empty() {
        evaluator.evaluate_all(&batch, None)?;
    }
    Ok(())
}
