//! Random numbers from a seed, uniform and normal: the same bits on every machine.
//!
//! ```
//! use stillpoint_mechanics::random::Random;
//! let mut random = Random::new(7);
//! let (a, b) = (random.normal(), Random::new(7).normal());
//! assert_eq!(a, b);
//! ```
//!
//! The normal numbers are Box and Muller's (1958) with `libm`, and not those of a crate: sessions, models and tests that
//! exist were made with these.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

/// A stream of random numbers.
pub struct Random(ChaCha8Rng);

impl Random {
    /// The stream of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// The stream of a seed and a number: streams of different numbers do not depend on each other.
    #[must_use]
    pub fn stream(seed: u64, number: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(number);
        Self(random)
    }

    /// Above 0, below 1.
    pub fn uniform(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Mean 0, variance 1.
    pub fn normal(&mut self) -> f64 {
        let (radius, angle) = (self.uniform(), self.uniform());
        normal_of(radius, angle)
    }

    /// Puts things into a random order.
    pub fn shuffle<T>(&mut self, things: &mut [T]) {
        for i in (1..things.len()).rev() {
            things.swap(i, (self.uniform() * (i + 1) as f64) as usize);
        }
    }
}

/// The normal number of two uniform ones above 0 and below 1, the first of which is for its size.
#[must_use]
pub fn normal_of(radius: f64, angle: f64) -> f64 {
    libm::sqrt(-2.0 * libm::log(radius)) * libm::cos(core::f64::consts::TAU * angle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_numbers_of_a_seed_are_those_of_sessions_that_exist() {
        let mut random = Random::new(7);
        let found: Vec<u64> = (0..3).map(|_| random.normal().to_bits()).collect();
        assert_eq!(found, BITS);
    }

    /// They stand: whoever changes them changes every simulated run.
    const BITS: [u64; 3] =
        [4_606_704_878_224_319_833, 13_816_822_831_949_529_750, 13_827_310_559_223_770_001];

    #[test]
    fn mean_and_variance_are_those_of_a_normal_number() {
        let mut random = Random::new(1);
        let n = 100_000;
        let all: Vec<f64> = (0..n).map(|_| random.normal()).collect();
        let mean = all.iter().sum::<f64>() / f64::from(n);
        let square = all.iter().map(|x| x * x).sum::<f64>() / f64::from(n);
        assert!(mean.abs() < 0.01 && (square - 1.0).abs() < 0.015, "{mean} {square}");
    }
}
