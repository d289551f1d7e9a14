//! Where the head rests with its valves shut, and how that moves with the air in the bladders.

use nalgebra::{SMatrix, SVector};

use super::body::Plant;
use crate::linear;

/// Why there is no equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum EquilibriumError {
    /// Newton's method came to no end.
    #[error(
        "no pose in equilibrium found: a generalised force of {left} (N, N m) is left; \
         is there air enough in the bladders to bear the head?"
    )]
    NotFound {
        /// Largest component of the remaining force.
        left: f64,
    },
}

impl<const D: usize, const B: usize, const N: usize> Plant<D, B, N> {
    /// The pose at rest with `air` kg in each bladder and all valves shut, sought from a guess.
    ///
    /// # Errors
    /// [`EquilibriumError::NotFound`] where bladders do not bear the head, or the guess is far off.
    pub fn equilibrium(
        &self,
        air: &SVector<f64, B>,
        guess: SVector<f64, D>,
    ) -> Result<SVector<f64, D>, EquilibriumError> {
        let mut q = guess;
        let (mut force, mut stiffness) = self.static_force(&q, air);
        let scale = self.weight.amax().max(1.0);
        for _ in 0..100 {
            if force.amax() <= 1e-12 * scale {
                return Ok(q);
            }
            let Some(step) = linear::solve(stiffness, force) else { break };
            // The force falls along the step as long as it is short enough: energy is convex where bladders push.
            let mut part = 1.0;
            let next = loop {
                let next = q - step * part;
                let (left, slope) = self.static_force(&next, air);
                if left.norm() < force.norm() {
                    break Some((next, left, slope));
                }
                part *= 0.5;
                if part < 1e-10 {
                    break None;
                }
            };
            let Some((next, left, slope)) = next else { break };
            (q, force, stiffness) = (next, left, slope);
        }
        // Rounding may leave a little.
        if force.amax() <= 1e-9 * scale {
            Ok(q)
        } else {
            Err(EquilibriumError::NotFound { left: force.amax() })
        }
    }

    /// How the pose at rest moves with the air in each bladder, m/kg and rad/kg: central differences over 0.1 % of
    /// the air (SCIENCE E11).
    ///
    /// # Errors
    /// Those of [`equilibrium`](Self::equilibrium).
    pub fn pose_by_air(
        &self,
        air: &SVector<f64, B>,
        guess: SVector<f64, D>,
    ) -> Result<SMatrix<f64, D, B>, EquilibriumError> {
        let rest = self.equilibrium(air, guess)?;
        let mut slopes = SMatrix::<f64, D, B>::zeros();
        for j in 0..B {
            let change = 1e-3 * air[j];
            let at = |sign: f64| {
                let mut other = *air;
                other[j] += sign * change;
                self.equilibrium(&other, rest)
            };
            slopes.set_column(j, &((at(1.0)? - at(-1.0)?) / (2.0 * change)));
        }
        Ok(slopes)
    }

    /// How fast each bladder's inlet at full duty moves the pose, m/s and rad/s: slowly, against 10 kPa (SCIENCE E6, E11).
    /// It is what a controller is told of its bladders.
    ///
    /// # Errors
    /// Those of [`equilibrium`](Self::equilibrium).
    pub fn effect(
        &self,
        air: &SVector<f64, B>,
        guess: SVector<f64, D>,
    ) -> Result<SMatrix<f64, D, B>, EquilibriumError> {
        Ok(self.pose_by_air(air, guess)? * self.inlet_flow(10e3))
    }

    /// Generalised force on a head that does not move, and how it changes with the pose while the air stays.
    pub fn static_force(
        &self,
        position: &SVector<f64, D>,
        air: &SVector<f64, B>,
    ) -> (SVector<f64, D>, SMatrix<f64, D, D>) {
        let gaps = self.gaps(position);
        let mut push = SVector::<f64, B>::zeros();
        let mut change = SVector::<f64, B>::zeros();
        for j in 0..B {
            let pressed = self.shell.pressed_with(air[j], &self.air, gaps[j]);
            push[j] = pressed.force();
            change[j] = self.shell.pressed_stiffness(&pressed, &self.air, gaps[j]);
            if let Some(stop) = self.stop.filter(|stop| gaps[j] < stop.gap) {
                push[j] += stop.stiffness * (stop.gap - gaps[j]);
                change[j] -= stop.stiffness;
            }
        }
        let slopes = self.gap_slopes(position);
        let across = slopes.transpose();
        let force = across * push - self.weight - self.stiffness * position;
        let mut by_gap = slopes;
        for j in 0..B {
            by_gap.row_mut(j).scale_mut(change[j]);
        }
        let mut stiffness = across * by_gap - self.stiffness;
        if let Some(rolling) = &self.rolling {
            let met = rolling.met(position);
            for j in 0..B {
                stiffness += rolling.gap_bends(&met, j) * push[j];
            }
        }
        (force, stiffness)
    }
}
