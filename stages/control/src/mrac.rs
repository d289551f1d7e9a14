//! Model-reference adaptive control (4.23)-(4.38) corrected, SCIENCE E2-E11.
//!
//! ```text
//! u = B^-1 (a y_des - a m) - k a B^-1 e + K_y^T m + K_r^T y_des + Theta^T Phi,   e = m - y_m
//! ```
//!
//! with m and y_des the pose and the target, counted from where control began, in parts of each channel's scale. The
//! first terms are what a plant of the nominal B needs; the adaptive ones learn what it needs beside that.

use nalgebra::{DMatrix, DVector};

use crate::adaptive::{Column, Gains, Law, ROOM};
use crate::effect::Effect;
use crate::features::Features;
use crate::lyapunov::{LyapunovError, lyapunov};
use crate::projection::Ball;
use crate::reference::ReferenceModel;
use crate::valves::clip;

/// What the law is made from.
#[derive(Clone, Debug, PartialEq)]
pub struct MracDesign {
    /// a, the pole of the reference model, 1/s.
    pub pole: f64,
    /// k, the factor by which an error from the model decays faster than the model itself.
    pub feedback: f64,
    /// Q = this times I, in P A_m + A_m^T P = -Q.
    pub weight: f64,
    /// Learning rates of K_y, K_r and Theta.
    pub learning: [f64; 3],
    /// sigma, 1/s.
    pub leak: f64,
    /// Where the gains of one bladder over one regressor are kept.
    pub ball: Ball,
    /// Errors, one for each channel in units of its scale, below which the gains do not change.
    pub dead_zone: Vec<f64>,
}

/// Why there is no law.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MracError {
    /// The reference model, or Q.
    #[error("the reference model gives no adaptation: {0}")]
    Lyapunov(#[from] LyapunovError),
    /// The dead zone has another number of channels.
    #[error("the dead zone has {found} numbers for {channels} channels")]
    DeadZone {
        /// Numbers.
        found: usize,
        /// Channels.
        channels: usize,
    },
    /// More features, or channels, than gains are kept for.
    #[error("{0} numbers are too many for a regressor: it has room for {ROOM}")]
    TooMany(usize),
}

/// Whether a step learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Learning {
    /// It did.
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
    p: DMatrix<f64>,
    model: ReferenceModel,
    features: Features,
    k_y: Gains,
    k_r: Gains,
    theta: Gains,
    rested: bool,
    m: Column,
    wanted: Column,
    phi: Column,
    error: DVector<f64>,
    weighed: DVector<f64>,
    rates: Vec<f64>,
    drives: Vec<f64>,
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
        let p = lyapunov(
            &DMatrix::from_diagonal_element(n, n, -design.pole),
            &DMatrix::from_diagonal_element(n, n, design.weight),
        )?;
        let law = |learning| Law { learning, leak: design.leak, ball: Some(design.ball) };
        let [k_y, k_r, theta] = design.learning.map(|learning| Gains::new(law(learning), inputs));
        Ok(Self {
            model: ReferenceModel::new(design.pole, n),
            p,
            features,
            k_y,
            k_r,
            theta,
            rested: true,
            m: Column::zeros(),
            wanted: Column::zeros(),
            phi: Column::zeros(),
            error: DVector::zeros(n),
            weighed: DVector::zeros(n),
            rates: vec![0.0; n],
            drives: vec![0.0; inputs],
            design,
            effect,
        })
    }

    /// Starts the reference model at the state of the plant in the next step. The learned gains stay.
    pub fn restart(&mut self) {
        self.rested = true;
        self.features.restart();
    }

    /// Uses the pose `m` and the target `wanted`, both counted from the start of control, in units of each channel's
    /// scale, `dt` seconds after the last step. It writes net duties into `net`, within -1 to 1. It does not allocate.
    pub fn step(&mut self, m: &[f64], wanted: &[f64], dt: f64, net: &mut [f64]) -> Learning {
        let n = self.effect.channels();
        self.m.as_mut_slice()[..n].copy_from_slice(m);
        self.wanted.as_mut_slice()[..n].copy_from_slice(wanted);
        if std::mem::take(&mut self.rested) {
            self.model.start_at(m);
        } else {
            self.model.advance(wanted, dt);
        }
        self.features.look(m, dt, self.phi.as_mut_slice());
        let (a, k) = (self.design.pole, self.design.feedback);
        for i in 0..n {
            self.error[i] = m[i] - self.model.at()[i];
            self.rates[i] = a * (wanted[i] - m[i]) - k * a * self.error[i];
        }
        self.effect.duties(&self.rates, net);
        for (j, v) in net.iter_mut().enumerate() {
            *v += self.k_y.demand(j, &self.m)
                + self.k_r.demand(j, &self.wanted)
                + self.theta.demand(j, &self.phi);
        }
        let beyond = clip(net);
        self.features.acted(net);
        let quiet = self.error.iter().zip(&self.design.dead_zone).all(|(e, zone)| e.abs() <= *zone);
        if beyond > 0.0 {
            return Learning::Saturated;
        }
        if quiet {
            return Learning::DeadZone;
        }
        // With Gamma = B^-1 B^-T for all gains, e^T P B Gamma is (B^-1 P e)^T.
        self.weighed.gemv(1.0, &self.p, &self.error, 0.0);
        self.effect.duties(self.weighed.as_slice(), &mut self.drives);
        self.k_y.adapt(&self.m, &self.drives, dt);
        self.k_r.adapt(&self.wanted, &self.drives, dt);
        self.theta.adapt(&self.phi, &self.drives, dt);
        Learning::On
    }

    /// m - y_m of the last step, in parts of each channel's scale.
    #[must_use]
    pub fn error(&self) -> &[f64] {
        self.error.as_slice()
    }

    /// K_y, K_r and Theta.
    #[must_use]
    pub fn gains(&self) -> [&Gains; 3] {
        [&self.k_y, &self.k_r, &self.theta]
    }

    /// The feature map.
    #[must_use]
    pub fn features(&self) -> &Features {
        &self.features
    }
}
