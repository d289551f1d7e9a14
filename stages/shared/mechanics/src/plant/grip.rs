//! Soft fingers that stick and slide (SCIENCE B3): the tangential forces of contacts that roll.
//!
//! While a contact sticks, the head and the wall of the bladder move as one: the wall is sheared by the motion of the
//! head's surface along the contact and twisted by its turning about the normal, and pulls back with the shear and
//! torsion of a tube of the wall. Where the forces leave the friction cone, shear and twist fall back to its edge: the
//! contact slides or spins.
//!
//! The directions along the contacts stand still during a step of a plant and turn with the normals between steps. A
//! step without sliding so conserves energy as exactly as its integrator does.

use core::f64::consts::PI;

use nalgebra::{SMatrix, SVector, Vector3};

use super::plate::Pressed;
use super::rolling::Rolling;
use crate::contact::forward::across;
use crate::contact::friction::{FingerForce, Friction, Margin};
use crate::shell::Shell;

/// A wall at its contact.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Finger {
    /// How far it is sheared, m, in the axes of the couch and across the normal.
    sheared: Vector3<f64>,
    /// How far it is twisted about the normal, rad.
    twisted: f64,
    /// Whether it slid and whether it spun in the last step.
    moved: [bool; 2],
}

#[derive(Debug, Clone, PartialEq)]
pub struct Grip<const B: usize> {
    /// `mu`.
    friction: f64,
    /// Of shear, N/m, and of twist, N m/rad.
    stiffness: [f64; 2],
    fingers: [Finger; B],
}

/// The tangential forces of a step: `force - stiffness (q - from)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held<const D: usize> {
    from: SVector<f64, D>,
    force: SVector<f64, D>,
    stiffness: SMatrix<f64, D, D>,
}

impl<const D: usize> Held<D> {
    /// Generalised force, N and N m.
    pub fn force(&self, position: &SVector<f64, D>) -> SVector<f64, D> {
        self.force - self.stiffness * (position - self.from)
    }
}

/// The three rows of a contact that stick: along both directions of [`across`], and about the normal.
fn rows<const D: usize>(map: &SMatrix<f64, D, 4>) -> SMatrix<f64, 3, D> {
    SMatrix::from_fn(|row, i| map[(i, [0, 1, 3][row])])
}

/// Friction of a patch that presses evenly: `gamma = 2/3 mu a` for a circle of radius `a`.
fn friction(mu: f64, pressed: &Pressed) -> Friction {
    Friction { sliding: mu, spinning: 2.0 / 3.0 * mu * libm::sqrt(pressed.area / PI) }
}

impl<const B: usize> Grip<B> {
    /// Contacts of bladders of `shell` between plates `gap` m apart, not sheared.
    pub fn new(friction: f64, shell: &Shell, gap: f64) -> Self {
        let finger = Finger { sheared: Vector3::zeros(), twisted: 0.0, moved: [friction <= 0.0; 2] };
        Self {
            friction,
            stiffness: [shell.shear_stiffness(gap), shell.twist_stiffness(gap)],
            fingers: [finger; B],
        }
    }

    /// The forces of a step that begins at these coordinates.
    pub fn held<const D: usize>(&self, rolling: &Rolling<D, B>, from: &SVector<f64, D>) -> Held<D> {
        let mut held = Held { from: *from, force: SVector::zeros(), stiffness: SMatrix::zeros() };
        if self.friction <= 0.0 {
            return held;
        }
        let met = rolling.met(from);
        let [shear, twist] = self.stiffness;
        for (j, finger) in self.fingers.iter().enumerate() {
            let rows = rows(&rolling.map(&met, j));
            let strain = finger.strain(&met.meetings[j].normal);
            let pull = Vector3::new(shear * strain.x, shear * strain.y, twist * strain.z);
            let mut stiff = rows;
            for (row, stiffness) in [shear, shear, twist].into_iter().enumerate() {
                stiff.row_mut(row).scale_mut(stiffness);
            }
            held.force -= rows.transpose() * pull;
            held.stiffness += rows.transpose() * stiff;
        }
        held
    }

    /// The head has moved from one place to another and its bladders press so: shears the walls, and lets those slide
    /// that leave the friction cone. Returns the energy that sliding took, J.
    pub fn advance<const D: usize>(
        &mut self,
        rolling: &Rolling<D, B>,
        from: &SVector<f64, D>,
        to: &SVector<f64, D>,
        pressed: &[Pressed; B],
    ) -> f64 {
        if self.friction <= 0.0 {
            return 0.0;
        }
        let (begin, end) = (rolling.met(from), rolling.met(to));
        let mu = self.friction;
        let [shear, twist] = self.stiffness;
        let mut tried = 0.0;
        for (j, (finger, pressed)) in self.fingers.iter_mut().zip(pressed).enumerate() {
            let normal = begin.meetings[j].normal;
            let strain = finger.strain(&normal) + rows(&rolling.map(&begin, j)) * (to - from);
            let [first, second] = across(&normal);
            (finger.sheared, finger.twisted) = (first * strain.x + second * strain.y, strain.z);
            tried += finger.energy(self.stiffness);
            let push = pressed.force();
            let cone = friction(mu, pressed);
            let (length, most) = (finger.sheared.norm(), cone.sliding * push / shear);
            let limit = cone.spinning * push / twist;
            finger.moved = [length > most, finger.twisted.abs() > limit];
            if length > most {
                finger.sheared *= most / length;
            }
            finger.twisted = finger.twisted.clamp(-limit, limit);
            finger.turn_to(&end.meetings[j].normal);
        }
        tried - self.energy()
    }

    /// Energy of the sheared and twisted walls, J.
    pub fn energy(&self) -> f64 {
        self.fingers.iter().map(|finger| finger.energy(self.stiffness)).sum()
    }

    /// Length of the tangential force of contact `j` on the head, N.
    pub fn tangential(&self, j: usize) -> f64 {
        self.fingers[j].sheared.norm() * self.stiffness[0]
    }

    /// Distance of contact `j` from its friction cone while its bladder presses so.
    pub fn margin(&self, j: usize, pressed: &Pressed) -> Margin {
        // z is the normal; which way along the contact does not matter.
        let force = Vector3::new(self.tangential(j), 0.0, pressed.force());
        let torque = self.stiffness[1] * self.fingers[j].twisted;
        friction(self.friction, pressed).margin(&FingerForce { force, torque })
    }

    /// How far a wall is sheared, m in the axes of the couch, and twisted about the normal, rad.
    pub fn strain(&self, j: usize) -> (Vector3<f64>, f64) {
        (self.fingers[j].sheared, self.fingers[j].twisted)
    }

    /// Whether a contact slid, and whether it spun, in the last step.
    pub fn moved(&self, j: usize) -> [bool; 2] {
        self.fingers[j].moved
    }
}

impl Finger {
    /// Shear along both directions of [`across`], and twist.
    fn strain(&self, normal: &Vector3<f64>) -> Vector3<f64> {
        let [first, second] = across(normal);
        Vector3::new(first.dot(&self.sheared), second.dot(&self.sheared), self.twisted)
    }

    fn energy(&self, [shear, twist]: [f64; 2]) -> f64 {
        0.5 * (shear * self.sheared.norm_squared() + twist * self.twisted * self.twisted)
    }

    /// Turns the shear across a normal that has moved a little, and keeps its length.
    fn turn_to(&mut self, normal: &Vector3<f64>) {
        let length = self.sheared.norm();
        let across = self.sheared - normal * normal.dot(&self.sheared);
        let left = across.norm();
        self.sheared = if left > 0.0 { across * (length / left) } else { Vector3::zeros() };
    }
}

impl Shell {
    /// Stiffness with which the wall between two plates `gap` m apart resists their turning about their normal, N m/rad:
    /// a thin tube of its size, `2 pi G t R^3 / d`.
    pub fn twist_stiffness(&self, gap: f64) -> f64 {
        let (wall, radius) = (self.outer - self.inner, 0.5 * (self.outer + self.inner));
        2.0 * PI * (self.c1 + self.c2) * wall * radius * radius * radius / gap
    }
}
