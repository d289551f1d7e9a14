//! The offset between the clocks of two sensors, from their tracks of one motion.
//!
//! Stamps that are late by d show the position of d earlier: x2 - x1 = b - d v, with b the difference of the sensors at
//! rest. So d is the slope of the difference over the velocity; without motion it cannot be estimated.

use nalgebra::SVector;

/// A running regression with exponential weights.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockOffset<const N: usize> {
    /// Share of the past that each new pair leaves.
    keep: f64,
    weight: f64,
    velocity: SVector<f64, N>,
    difference: SVector<f64, N>,
    squares: SVector<f64, N>,
    products: SVector<f64, N>,
    noise: SVector<f64, N>,
}

/// An offset with its standard deviation, both in seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offset {
    /// How late the second sensor's stamps are against the first's.
    pub seconds: f64,
    /// Standard deviation, for differences that are independent from pair to pair; filtered tracks are less so.
    pub sd: f64,
}

impl<const N: usize> ClockOffset<N> {
    /// A regression over about the last `pairs` pairs.
    #[must_use]
    pub fn new(pairs: u32) -> Self {
        let zero = SVector::zeros();
        Self {
            keep: 1.0 - 1.0 / f64::from(pairs.max(2)),
            weight: 0.0,
            velocity: zero,
            difference: zero,
            squares: zero,
            products: zero,
            noise: zero,
        }
    }

    /// Takes the difference (second minus first) of two positions at one time, its variance per channel, and the velocity.
    pub fn add(
        &mut self,
        difference: &SVector<f64, N>,
        variance: &SVector<f64, N>,
        velocity: &SVector<f64, N>,
    ) {
        let k = self.keep;
        self.weight = self.weight * k + 1.0;
        self.velocity = self.velocity * k + velocity;
        self.difference = self.difference * k + difference;
        self.squares = self.squares * k + velocity.component_mul(velocity);
        self.products = self.products * k + velocity.component_mul(difference);
        self.noise = self.noise * k + variance;
    }

    /// The offset; `None` before any motion.
    #[must_use]
    pub fn estimate(&self) -> Option<Offset> {
        let n = self.weight;
        let (mut slope, mut information) = (0.0, 0.0);
        for i in 0..N {
            let spread = self.squares[i] - self.velocity[i] * self.velocity[i] / n;
            let together = self.products[i] - self.velocity[i] * self.difference[i] / n;
            let variance = self.noise[i] / n;
            slope += together / variance;
            information += spread / variance;
        }
        let sd = 1.0 / information.sqrt();
        (sd.is_finite() && slope.is_finite()).then(|| Offset { seconds: -slope / information, sd })
    }
}
