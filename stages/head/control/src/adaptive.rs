//! The adaptive laws (4.36), kept inside bounds (SCIENCE E3, E4).
//!
//! ```text
//! K' = -G x e^T P B sgn(Lambda) - sigma K        one column for each input, projected onto a ball
//! ```
//!
//! with x the regressor: the pose for K_y, the set-point for K_r, the features for Theta.

use nalgebra::SVector;
use stillpoint_mechanics::dormand_prince;

use crate::projection::{Ball, projected};

/// Most numbers of a regressor.
pub const ROOM: usize = 8;

/// A regressor, or the gains of one input on a regressor; entries beyond its length are zero.
pub type Column = SVector<f64, ROOM>;

/// Learning rates, decay and bounds of the gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    pub learning: f64,
    /// sigma: rate at which gains decay without a reason to stay, 1/s. Without it noise lets them drift.
    pub leak: f64,
    /// Where gains are kept; `None` for anywhere.
    pub ball: Option<Ball>,
}

impl Law {
    /// The rate of the gains of one input, whose entry of e^T P B sgn(Lambda) is `drive`.
    #[must_use]
    pub fn rate(&self, gains: &Column, regressor: &Column, drive: f64) -> Column {
        let rate = -(regressor * (self.learning * drive) + gains * self.leak);
        self.ball.map_or(rate, |ball| projected(gains, &rate, &ball))
    }
}

/// Gains over one regressor, a column for each input.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    law: Law,
    columns: Vec<Column>,
}

impl Gains {
    /// Gains of zero for this many inputs.
    #[must_use]
    pub fn new(law: Law, inputs: usize) -> Self {
        Self { law, columns: vec![Column::zeros(); inputs] }
    }

    /// Goes on with another learning rate and another leak.
    pub fn set_rates(&mut self, learning: f64, leak: f64) {
        (self.law.learning, self.law.leak) = (learning, leak);
    }

    /// What they add to input `j`.
    #[must_use]
    pub fn demand(&self, j: usize, regressor: &Column) -> f64 {
        self.columns[j].dot(regressor)
    }

    /// Learns for `dt` seconds in which regressor and drives stand, by one step of Dormand and Prince.
    pub fn adapt(&mut self, regressor: &Column, drives: &[f64], dt: f64) {
        for (column, drive) in self.columns.iter_mut().zip(drives) {
            let rate = |_: f64, gains: &Column| self.law.rate(gains, regressor, *drive);
            *column = dormand_prince::step(rate, 0.0, column, dt).state;
        }
    }

    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Root of the sum of the squares of all gains.
    #[must_use]
    pub fn norm(&self) -> f64 {
        libm::sqrt(self.columns.iter().map(Column::norm_squared).sum())
    }
}
