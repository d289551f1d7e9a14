//! The process noise Q of a constant-velocity model, (4.6) and SCIENCE D1.

use nalgebra::SVector;

/// Random accelerations, independent per channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProcessNoise<const N: usize> {
    /// Standard deviation sigma_a of the acceleration, per second squared.
    pub acceleration_sd: SVector<f64, N>,
    /// How long an acceleration lasts.
    pub hold: Hold,
}

/// How long a random acceleration lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hold {
    /// From one stamp to the next, as (4.6) has it. How fast the variance grows then depends on the rate of stamps: at
    /// half the rate it grows twice as fast.
    Step,
    /// A fixed time in seconds, independent of the stamps and short compared with the motion: white noise of density
    /// sigma_a^2 hold. One step of 2 dt then equals two steps of dt, so filters of different rates have the same model.
    Seconds(f64),
}

/// The diagonals of Q's blocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blocks<const N: usize> {
    pub pp: SVector<f64, N>,
    /// Of the position with the velocity.
    pub pv: SVector<f64, N>,
    pub vv: SVector<f64, N>,
}

impl<const N: usize> ProcessNoise<N> {
    /// The same acceleration in each channel, held from stamp to stamp.
    #[must_use]
    pub fn per_step(acceleration_sd: f64) -> Self {
        Self { acceleration_sd: SVector::repeat(acceleration_sd), hold: Hold::Step }
    }

    /// Q over `dt` seconds. Held for the step: sigma_a^2 W W^T with W = (dt^2 / 2, dt), (4.6). Held for a time:
    /// sigma_a^2 hold [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]].
    #[must_use]
    pub fn over(&self, dt: f64) -> Blocks<N> {
        let variance = self.acceleration_sd.component_mul(&self.acceleration_sd);
        let (pp, pv, vv) = match self.hold {
            Hold::Step => (0.25 * dt * dt * dt * dt, 0.5 * dt * dt * dt, dt * dt),
            Hold::Seconds(hold) => (hold * dt * dt * dt / 3.0, hold * 0.5 * dt * dt, hold * dt),
        };
        Blocks { pp: variance * pp, pv: variance * pv, vv: variance * vv }
    }
}
