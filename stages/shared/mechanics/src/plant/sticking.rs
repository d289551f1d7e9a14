//! Friction of the bladders on the head: each contact sticks by the shear of the bladder's wall, and slides where the
//! shear reaches the friction cone (3.4), SCIENCE B3.
//!
//! The head drags the outer side of a bladder along. A wall of thickness `t` and radius `R` between plates a gap `d`
//! apart is sheared like a tube, with the stiffness `pi G t R / d`. A bladder that rolls instead of sliding has a small
//! coefficient, that of its rolling resistance.

use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use crate::contact::forward::across;
use crate::shell::Shell;

/// Motion along two tangential directions of each contact, by the coordinates of the head: `B` times 2 by `D`.
pub type Tangents<const D: usize, const B: usize> = [SMatrix<f64, 2, D>; B];

/// How far the wall of each bladder is sheared.
#[derive(Debug, Clone, PartialEq)]
pub struct Sticking<const D: usize, const B: usize> {
    tangents: Tangents<D, B>,
    /// `mu`.
    friction: f64,
    /// N/m.
    stiffness: f64,
    /// m.
    sheared: [Vector2<f64>; B],
    /// Which slid in the last step.
    slid: [bool; B],
}

impl<const D: usize, const B: usize> Sticking<D, B> {
    /// Contacts that are not sheared, of bladders of `shell` between plates `gap` m apart.
    pub fn new(tangents: Tangents<D, B>, friction: f64, shell: &Shell, gap: f64) -> Self {
        Self {
            tangents,
            friction,
            stiffness: shell.shear_stiffness(gap),
            sheared: [Vector2::zeros(); B],
            slid: [false; B],
        }
    }

    /// The head moves by `moved` while the bladders push with these forces, N.
    pub fn advance(&mut self, moved: &SVector<f64, D>, push: impl Iterator<Item = f64>) {
        let contacts = self.sheared.iter_mut().zip(&mut self.slid);
        for (((sheared, slid), tangent), push) in contacts.zip(&self.tangents).zip(push) {
            let tried = *sheared + tangent * moved;
            let (length, most) = (tried.norm(), self.friction * push.max(0.0) / self.stiffness);
            *slid = length > most;
            *sheared = if length > most { tried * (most / length) } else { tried };
        }
    }

    /// Length of the tangential force of contact `j` on the head, N, and whether the contact slid in the last step.
    pub fn tangential(&self, j: usize) -> (f64, bool) {
        (self.sheared[j].norm() * self.stiffness, self.slid[j])
    }

    /// Force on the head, N and N m.
    pub fn force(&self) -> SVector<f64, D> {
        let parts = self.sheared.iter().zip(&self.tangents);
        parts.map(|(sheared, tangent)| tangent.transpose() * (sheared * -self.stiffness)).sum()
    }
}

impl Shell {
    /// Stiffness with which the wall between two plates `gap` m apart resists their motion along each other, N/m.
    pub fn shear_stiffness(&self, gap: f64) -> f64 {
        let (wall, radius) = (self.outer - self.inner, 0.5 * (self.outer + self.inner));
        core::f64::consts::PI * (self.c1 + self.c2) * wall * radius / gap
    }
}

/// Two directions along a contact, and how its point moves along them with x, y, z, pitch, roll and yaw of the head.
pub fn along(arm: &Vector3<f64>, normal: &Vector3<f64>) -> SMatrix<f64, 2, 6> {
    let mut rows = SMatrix::<f64, 2, 6>::zeros();
    for (i, direction) in across(normal).iter().enumerate() {
        let turn = arm.cross(direction);
        for axis in 0..3 {
            rows[(i, axis)] = direction[axis];
            rows[(i, 3 + axis)] = turn[axis];
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact() -> Sticking<6, 1> {
        let tangents = [along(&Vector3::new(0.0, 0.0, -0.09), &Vector3::z())];
        Sticking::new(tangents, 0.5, &Shell::rig(), 0.085)
    }

    #[test]
    fn a_contact_sticks_like_a_spring_and_then_slides_with_the_friction() {
        let mut contact = contact();
        let stiffness = Shell::rig().shear_stiffness(0.085);
        assert!((1.2e3..1.5e3).contains(&stiffness), "{stiffness}");
        let step = SVector::<f64, 6>::from([1e-3, 0.0, 0.0, 0.0, 0.0, 0.0]);
        contact.advance(&step, [10.0].into_iter());
        let force = contact.force();
        assert!(!contact.tangential(0).1);
        assert!((force[0] + 1e-3 * stiffness).abs() < 1e-12, "{force}");
        // The force lies under the head: it turns it about y.
        assert!((force[4] - -0.09 * force[0]).abs() < 1e-12, "{force}");
        for _ in 0..20 {
            contact.advance(&step, [10.0].into_iter());
        }
        assert!((contact.force()[0] + 5.0).abs() < 1e-12);
        let (tangential, slid) = contact.tangential(0);
        assert!((tangential - 5.0).abs() < 1e-12 && slid);
        // On the way back the friction turns about: hysteresis.
        for _ in 0..20 {
            contact.advance(&-step, [10.0].into_iter());
        }
        assert!((contact.force()[0] - 5.0).abs() < 1e-12);
        // A bladder that does not push holds nothing.
        contact.advance(&step, [0.0].into_iter());
        assert_eq!(contact.force().amax(), 0.0);
    }

    #[test]
    fn motion_along_the_normal_and_about_it_shears_nothing() {
        let mut contact = contact();
        contact.advance(&SVector::<f64, 6>::from([0.0, 0.0, 1e-3, 0.0, 0.0, 0.1]), [10.0].into_iter());
        assert_eq!(contact.force().amax(), 0.0);
    }
}
