//! A random search in the unit cube. The first round tries the start and random points. Each later round tries points
//! around the best point, at distances that decrease from round to round.

use chacha20::ChaCha8Rng;
use rand::{Rng, SeedableRng};

/// Number of points of a round.
pub const ROUND: usize = 8;
/// Standard deviation of the distance from the best point in each coordinate, in the second round and in the last.
const WIDTHS: [f64; 2] = [0.25, 0.04];

/// Gives the best of `rounds` times [`ROUND`] points in the unit cube, and its cost. The first point is `start`. A
/// point whose cost is NaN is never the best.
pub fn search<E>(
    start: &[f64],
    rounds: usize,
    seed: u64,
    mut costs: impl FnMut(&[Vec<f64>]) -> Result<Vec<f64>, E>,
) -> Result<(Vec<f64>, f64), E> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut best = (start.to_vec(), f64::INFINITY);
    for round in 0..rounds {
        let through = round.saturating_sub(1) as f64 / rounds.saturating_sub(2).max(1) as f64;
        let width = WIDTHS[0] * (WIDTHS[1] / WIDTHS[0]).powf(through);
        let places: Vec<Vec<f64>> = (0..ROUND)
            .map(|number| match (round, number) {
                (0, 0) => start.to_vec(),
                (0, _) => start.iter().map(|_| uniform(&mut random)).collect(),
                _ => best.0.iter().map(|at| (at + width * bell(&mut random)).clamp(0.0, 1.0)).collect(),
            })
            .collect();
        for (place, cost) in places.iter().zip(costs(&places)?) {
            if cost < best.1 {
                best = (place.clone(), cost);
            }
        }
    }
    Ok(best)
}

fn uniform(random: &mut impl Rng) -> f64 {
    (f64::from(random.next_u32()) + 0.5) / (f64::from(u32::MAX) + 1.0)
}

/// An approximately normal deviate of variance 1: the sum of twelve uniform deviates, minus 6.
fn bell(random: &mut impl Rng) -> f64 {
    (0..12).map(|_| uniform(random)).sum::<f64>() - 6.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_finds_the_bottom_of_a_bowl_with_a_wall_and_is_the_same_each_time() {
        let bowl = |at: &Vec<f64>| {
            if at[0] > 0.95 {
                return f64::NAN;
            }
            (at[0] - 0.7).powi(2) + 4.0 * (at[1] - 0.2).powi(2)
        };
        let run =
            |seed| search(&[0.1, 0.9], 12, seed, |p| Ok::<_, ()>(p.iter().map(bowl).collect())).unwrap();
        for seed in 0..20 {
            let (at, cost) = run(seed);
            assert!(cost < 4e-3 && cost == bowl(&at), "{seed}: {at:?} {cost}");
            assert_eq!(run(seed), (at, cost));
        }
        assert_ne!(run(1), run(2));
    }
}
