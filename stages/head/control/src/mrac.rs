//! Model-reference adaptive control (4.23)-(4.38) corrected, SCIENCE E2-E11 and Y1.
//!
//! ```text
//! u = B^-1 (y_m' - f e^) + K_y^T m + K_r^T y_des + Theta^T Phi
//! K' = -l x (B^-1 e)^T - sigma K          x = m, y_des or Phi, each with its own l
//! ```
//!
//! with m and y_des the pose and the target, counted from where control began, in parts of each channel's scale, e the
//! error from the reference model at the pose's own time and e^ the predicted one. The first terms are what a plant of
//! the nominal B needs; the adaptive ones learn what it needs beside that.
//!
//! The dials are rates: an error dies out with f, in 1/s, and what a regressor of 1 has to make up for is learned with
//! l, in 1/s^2, however fast the reference model is (`docs/science/equations.md`, "The adaptive law in rates").

use crate::adaptive::{Column, Gains, Law, ROOM};
use crate::effect::Effect;
use crate::features::Features;
use crate::projection::Ball;
use crate::tracking::Errors;
use crate::valves::clip;

/// What the law is made from.
#[derive(Clone, Debug, PartialEq)]
pub struct MracDesign {
    /// f, the rate at which an error from the reference model decays, 1/s.
    pub feedback: f64,
    /// l of K_y, K_r and Theta, 1/s^2.
    pub learning: [f64; 3],
    /// sigma, 1/s.
    pub leak: f64,
    /// Where the gains of one bladder over one regressor are kept.
    pub ball: Ball,
    /// Errors, one for each channel in units of its scale, below which the gains do not change.
    pub dead_zone: Vec<f64>,
}

/// How far the head can be from the reference model, in scales.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorBound {
    /// The error never stays above this, where nothing leaks and gains are free (4.38).
    pub radius: f64,
    /// Root of the mean of the squared error over a long time, with the leak.
    pub root_mean_square: f64,
}

impl MracDesign {
    /// The bound of the error (4.38) for a plant `m' = B u + d`, where `d = -M x + eps` with constant M over one of the
    /// regressors, the rest `eps` at most `unexplained` and the norm of M `explained`, both in scales per second. `place`
    /// says which regressor: 0, 1 or 2 for pose, target and features. It holds for poses that are not late, outside the
    /// dead zone and inside the ball.
    ///
    /// With `V = |e|^2 + |M~|^2 / l`: `V' <= -2 f |e|^2 + 2 |e| eps + (sigma / l) (|M|^2 - |M~|^2)`.
    #[must_use]
    pub fn error_bound(&self, unexplained: f64, explained: f64, place: usize) -> ErrorBound {
        let radius = unexplained / self.feedback;
        let learning = self.learning[place];
        // What is not learned at all is part of the rest.
        let radius = if learning > 0.0 { radius } else { radius + explained / self.feedback };
        let leaked =
            if learning > 0.0 { self.leak * explained * explained / (learning * self.feedback) } else { 0.0 };
        ErrorBound { radius, root_mean_square: libm::sqrt(radius * radius + leaked) }
    }
}

/// Why there is no law.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MracError {
    /// The dead zone has another number of channels.
    #[error("the dead zone has {found} numbers for {channels} channels")]
    DeadZone {
        /// Number of values found.
        found: usize,
        channels: usize,
    },
    /// More features, or channels, than gains are kept for.
    #[error("{0} numbers are too many for a regressor: it has room for {ROOM}")]
    TooMany(usize),
}

/// Whether a step learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Learning {
    On,
    /// Every error is inside the dead zone.
    DeadZone,
    /// A valve is asked for more than there is.
    Saturated,
}

/// The law with its gains.
#[derive(Clone, Debug)]
pub struct Mrac {
    design: MracDesign,
    effect: Effect,
    features: Features,
    k_y: Gains,
    k_r: Gains,
    theta: Gains,
    m: Column,
    requested: Column,
    phi: Column,
    rates: Vec<f64>,
    compensation: Vec<f64>,
    drives: Vec<f64>,
    adapted: Vec<f64>,
}

impl Mrac {
    /// A law with gains of zero.
    ///
    /// # Errors
    /// [`MracError`].
    pub fn design(design: MracDesign, effect: Effect, features: Features) -> Result<Self, MracError> {
        let (n, inputs) = (effect.channels(), effect.bladders());
        if design.dead_zone.len() != n {
            return Err(MracError::DeadZone { found: design.dead_zone.len(), channels: n });
        }
        if let Some(many) = [n, features.count(n)].into_iter().find(|many| *many > ROOM) {
            return Err(MracError::TooMany(many));
        }
        let law = |learning| Law { learning, leak: design.leak, ball: Some(design.ball) };
        let [k_y, k_r, theta] = design.learning.map(|learning| Gains::new(law(learning), inputs));
        Ok(Self {
            features,
            k_y,
            k_r,
            theta,
            m: Column::zeros(),
            requested: Column::zeros(),
            phi: Column::zeros(),
            rates: vec![0.0; n],
            compensation: vec![0.0; n],
            drives: vec![0.0; inputs],
            adapted: vec![0.0; inputs],
            design,
            effect,
        })
    }

    /// Goes on with another decay of errors, 1/s, other learning rates, 1/s^2, and another leak, 1/s. The learned gains stay.
    pub fn set_rates(&mut self, feedback: f64, learning: [f64; 3], leak: f64) {
        (self.design.feedback, self.design.learning, self.design.leak) = (feedback, learning, leak);
        for (gains, learning) in [&mut self.k_y, &mut self.k_r, &mut self.theta].into_iter().zip(learning) {
            gains.set_rates(learning, leak);
        }
    }

    /// Clears the window of the features. The learned gains stay.
    pub fn restart(&mut self) {
        self.features.restart();
    }

    /// Uses the pose `m` and the target `requested`, both counted from the start of control, in units of each channel's
    /// scale, and the errors from the reference model, `dt` seconds after the last step. It writes net duties into `net`,
    /// within -1 to 1. It does not allocate.
    pub fn step(
        &mut self,
        m: &[f64],
        requested: &[f64],
        errors: &Errors<'_>,
        dt: f64,
        net: &mut [f64],
    ) -> Learning {
        let n = self.effect.channels();
        self.m.as_mut_slice()[..n].copy_from_slice(m);
        self.requested.as_mut_slice()[..n].copy_from_slice(requested);
        self.features.look(m, dt, self.phi.as_mut_slice());
        for (i, rate) in self.rates.iter_mut().enumerate() {
            *rate = errors.speed[i] - self.design.feedback * errors.predicted[i];
        }
        self.effect.duties(&self.rates, net);
        for (j, (v, adapted)) in net.iter_mut().zip(&mut self.adapted).enumerate() {
            *adapted = self.k_y.demand(j, &self.m)
                + self.k_r.demand(j, &self.requested)
                + self.theta.demand(j, &self.phi);
            *v += *adapted;
        }
        let beyond = clip(net);
        self.features.acted(net);
        let quiet = errors.seen.iter().zip(&self.design.dead_zone).all(|(e, zone)| e.abs() <= *zone);
        if beyond > 0.0 {
            return Learning::Saturated;
        }
        if quiet {
            return Learning::DeadZone;
        }
        self.effect.duties(errors.seen, &mut self.drives);
        self.k_y.adapt(&self.m, &self.drives, dt);
        self.k_r.adapt(&self.requested, &self.drives, dt);
        self.theta.adapt(&self.phi, &self.drives, dt);
        Learning::On
    }

    /// The rates of the channels by the net duties of the last step, and the part of them that was learned.
    pub fn moved(&mut self, net: &[f64]) -> [&[f64]; 2] {
        self.effect.moved(net, &mut self.rates);
        self.effect.moved(&self.adapted, &mut self.compensation);
        [&self.rates, &self.compensation]
    }

    /// K_y, K_r and Theta.
    #[must_use]
    pub fn gains(&self) -> [&Gains; 3] {
        [&self.k_y, &self.k_r, &self.theta]
    }

    #[must_use]
    pub fn features(&self) -> &Features {
        &self.features
    }
}
