//! The head of the rigs: with one degree of freedom (SCIENCE C5) and with three (C6).
//!
//! Masses and moments of inertia are those of adult heads (Beier et al., 1979); stiffness, damping and lever arms are
//! round numbers of ours (SCIENCE C6).

use nalgebra::{Matrix1, Matrix3, SMatrix, Vector1, Vector3, vector};

use super::body::{Frame, Plant, Stop};
use super::valve::Valves;
use crate::shell::Shell;
use crate::shell::air::Air;

/// Height alone, on one bladder: `q` is its gap.
pub type OneDof = Plant<1, 1, 5>;

/// Height, pitch and roll on three bladders: base, left and right. Left is what a camera at the feet sees at the left.
pub type ThreeDof = Plant<3, 3, 15>;

/// Standard gravity as the reference trajectories have it, m/s^2.
pub const GRAVITY: f64 = 9.81;

/// Mass of the head of the reference trajectories, kg.
pub const HEAD_MASS: f64 = 5.0;

/// What a flat bladder lies on in the rigs: foam over the couch.
pub const FOAM: Stop = Stop { gap: 0.062, stiffness: 2e4, damping: 300.0 };

impl OneDof {
    /// A head of `mass` kg on one of the rig's bladders.
    pub fn rig(mass: f64) -> Self {
        let frame = Frame {
            inertia: Vector1::new(mass),
            weight: Vector1::new(mass * GRAVITY),
            stiffness: Matrix1::zeros(),
            damping: Matrix1::new(80.0),
            gap_at_zero: Vector1::zeros(),
            jacobian: Matrix1::new(1.0),
        };
        Self::new(Shell::rig(), Air::ROOM, Valves::rig(), frame)
    }
}

impl ThreeDof {
    /// A head of `mass` kg, held by the neck, on three of the rig's bladders. Moments of inertia go with the mass.
    pub fn rig(mass: f64) -> Self {
        let share = mass / HEAD_MASS;
        let frame = Frame {
            inertia: Vector3::new(mass, 0.024 * share, 0.016 * share),
            weight: Vector3::new(mass * GRAVITY, 0.0, 0.0),
            stiffness: neck(500.0, 5.0, 3.0),
            damping: neck(60.0, 0.8, 0.6),
            gap_at_zero: Vector3::repeat(0.085),
            jacobian: SMatrix::<f64, 3, 3>::from_rows(&[
                vector![1.0, 0.05, 0.0].transpose(),
                vector![0.30, -0.03, 0.07].transpose(),
                vector![0.30, -0.03, -0.07].transpose(),
            ]),
        };
        Self::new(Shell::rig(), Air::ROOM, Valves::rig(), frame)
    }
}

/// A neck that pulls at the head 50 mm from its centre with `height`, and against pitch and roll.
fn neck(height: f64, pitch: f64, roll: f64) -> Matrix3<f64> {
    const ARM: f64 = 0.05;
    let arm = height * ARM;
    Matrix3::new(height, -arm, 0.0, -arm, arm * ARM + pitch, 0.0, 0.0, 0.0, roll)
}
