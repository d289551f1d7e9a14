//! The head of the rigs: with one degree of freedom (SCIENCE C5), with three (C6) and with all six.
//!
//! Masses and moments of inertia come from adult heads (Beier et al., 1979). Stiffness, damping and lever arms are
//! round numbers of this project (SCIENCE C6).

use nalgebra::{Matrix1, Matrix3, Matrix6, SMatrix, SVector, Vector1, Vector3, Vector6, vector};

use super::body::{BodyFrame, Plant, Stop};
use super::rolling::Rolling;
use super::sticking::{Tangents, along};
use super::valve::Valves;
use crate::shell::Shell;
use crate::shell::air::Air;

/// Height alone, on one bladder: `q` is its gap.
pub type OneDof = Plant<1, 1, 5>;

/// Height, pitch and roll on three bladders: base, left and right. Left is what a camera at the feet sees at the left.
pub type ThreeDof = Plant<3, 3, 15>;

/// x, y, z, pitch, roll and yaw on eight bladders around the head: four near the crown and four near the neck, of each
/// four two from below and two from above.
pub type SixDof = Plant<6, 8, 36>;

/// Standard gravity as the reference trajectories have it, m/s^2.
pub const GRAVITY: f64 = 9.81;

/// Gap of each bladder before its rig starts, m.
pub const START_GAP: f64 = 0.085;

/// Mass of the head of the reference trajectories, kg.
pub const HEAD_MASS: f64 = 5.0;

/// What a flat bladder lies on in the rigs: foam over the couch.
pub const FOAM: Stop = Stop { gap: 0.062, stiffness: 2e4, damping: 300.0 };

impl OneDof {
    /// A head of `mass` kg on one of the rig's bladders.
    pub fn rig(mass: f64) -> Self {
        let frame = BodyFrame {
            inertia: Vector1::new(mass),
            weight: Vector1::new(mass * GRAVITY),
            stiffness: Matrix1::zeros(),
            damping: Matrix1::new(80.0),
            gap_at_zero: Vector1::zeros(),
            jacobian: Matrix1::new(1.0),
        };
        Self::new(Shell::rig(), Air::ROOM, Valves::rig(), frame)
    }

    /// The air, kg, on which the head rests at a gap of 85 mm.
    pub fn start_air(&self) -> Vector1<f64> {
        let pressed = self.shell.pressed_under(self.weight[0], START_GAP);
        Vector1::new(pressed.map_or(0.0, |p| self.air.mass(p.pressure, p.volume)))
    }
}

impl ThreeDof {
    /// A head of `mass` kg, held by the neck, on three of the rig's bladders. Moments of inertia go with the mass.
    pub fn rig(mass: f64) -> Self {
        let share = mass / HEAD_MASS;
        let frame = BodyFrame {
            inertia: Vector3::new(mass, MOMENTS[0] * share, MOMENTS[1] * share),
            weight: Vector3::new(mass * GRAVITY, 0.0, 0.0),
            stiffness: neck(500.0, 5.0, 3.0),
            damping: neck(60.0, 0.8, 0.6),
            gap_at_zero: Vector3::repeat(START_GAP),
            jacobian: SMatrix::<f64, 3, 3>::from_rows(&[
                vector![1.0, 0.05, 0.0].transpose(),
                vector![0.30, -0.03, 0.07].transpose(),
                vector![0.30, -0.03, -0.07].transpose(),
            ]),
        };
        Self::new(Shell::rig(), Air::ROOM, Valves::rig(), frame)
    }

    /// The air, kg, that stretches the bladders by 1.10, 1.05 and 1.05 between plates 85 mm apart (SCIENCE E11).
    pub fn start_air(&self) -> Vector3<f64> {
        Vector3::new(1.10, 1.05, 1.05).map(|stretch| {
            let pressed = self.shell.pressed(stretch, START_GAP);
            self.air.mass(pressed.pressure, pressed.volume)
        })
    }
}

/// Places of the eight bladders as signs: x, y and z from the head's centre.
const AROUND: [[f64; 3]; 8] = [
    [-1.0, 1.0, -1.0],
    [1.0, 1.0, -1.0],
    [-1.0, -1.0, -1.0],
    [1.0, -1.0, -1.0],
    [-1.0, 1.0, 1.0],
    [1.0, 1.0, 1.0],
    [-1.0, -1.0, 1.0],
    [1.0, -1.0, 1.0],
];

/// Distance of the eight bladders from the head's long axis, and from its centre along that axis, m.
const RADIUS: f64 = 0.09;
const ALONG: f64 = 0.07;
/// How much the bladders' directions lean along the head's axis, and around it.
const LEAN: f64 = 0.2;
const TWIST: f64 = 0.3;
/// Push of each bladder that makes no wrench, N.
const SQUEEZE: f64 = 20.0;

/// Where bladder `j` touches the head and which way it pushes, in the head's axes.
///
/// Straight towards the head's axis the eight could neither turn the head about it nor move it along it. They lean, with
/// signs such that equal pushes cancel and each of the six motions has a pattern of pushes of its own.
pub fn around(j: usize) -> (Vector3<f64>, Vector3<f64>) {
    let [x, y, z] = AROUND[j % AROUND.len()];
    let radial = Vector3::new(x, 0.0, z) * core::f64::consts::FRAC_1_SQRT_2;
    let tangent = Vector3::y().cross(&radial);
    let push = -radial - Vector3::y() * (y * LEAN) + tangent * (x * z * TWIST);
    (radial * RADIUS + Vector3::y() * (y * ALONG), push.normalize())
}

/// Where the base and the side bladders of the rig with three touch the head, m, and which way they push. The
/// directions and two of the coordinates follow from its Jacobian (SCIENCE C6); that the sides touch 90 mm from the
/// long axis is ours.
fn three() -> [(Vector3<f64>, Vector3<f64>); 3] {
    const LIFT: f64 = 0.30;
    let across = libm::sqrt(1.0 - LIFT * LIFT);
    let (y, z) = (-0.03 / LIFT, (0.07 - RADIUS * LIFT) / across);
    [
        (Vector3::new(0.0, 0.05, -RADIUS), Vector3::z()),
        (Vector3::new(-RADIUS, y, z), Vector3::new(across, 0.0, LIFT)),
        (Vector3::new(RADIUS, y, z), Vector3::new(-across, 0.0, LIFT)),
    ]
}

/// Where the contacts of a rig with `B` bladders are at `q = 0`, m from the head's origin, and which way the bladders push;
/// `None` for the rig with one.
pub fn touching<const B: usize>() -> Option<[(Vector3<f64>, Vector3<f64>); B]> {
    match B {
        1 => None,
        3 => Some(core::array::from_fn(|j| three()[j % 3])),
        _ => Some(core::array::from_fn(around)),
    }
}

/// Radius of the head at its contacts, m.
const ROUND: f64 = RADIUS;
/// Moments of inertia of a head of [`HEAD_MASS`] about x, y and z, kg m^2.
const MOMENTS: [f64; 3] = [0.024, 0.016, 0.021];

/// Contacts that move over head and bladders, under a head of `mass` kg. Where `q = 0` they lie where those of
/// [`tangents`] stay. `None` for the rig with one bladder, whose contact lies on the line of its motion.
pub fn rolling<const D: usize, const B: usize>(
    channels: &[usize; D],
    mass: f64,
    shell: &Shell,
) -> Option<Rolling<D, B>> {
    let moments = Vector3::from(MOMENTS) * (mass / HEAD_MASS);
    Some(Rolling::new(*channels, &touching::<B>()?, ROUND, START_GAP, moments, shell))
}

/// How the contacts of a plant move along the bladders, by its coordinates `channels`: nothing for the rig with one.
pub fn tangents<const D: usize, const B: usize>(channels: &[usize; D]) -> Tangents<D, B> {
    touching::<B>().map_or([SMatrix::zeros(); B], |places| {
        places.map(|(arm, normal)| {
            let all = along(&arm, &normal);
            SMatrix::from_fn(|row, column| all[(row, channels[column])])
        })
    })
}

impl SixDof {
    /// A head of `mass` kg, held by the neck, between eight of the rig's bladders.
    pub fn rig(mass: f64) -> Self {
        let share = mass / HEAD_MASS;
        let mut jacobian = SMatrix::<f64, 8, 6>::zeros();
        for j in 0..AROUND.len() {
            let (arm, push) = around(j);
            let turn = arm.cross(&push);
            jacobian
                .row_mut(j)
                .copy_from(&Vector6::new(push.x, push.y, push.z, turn.x, turn.y, turn.z).transpose());
        }
        let neck = |along, across, angle: [f64; 3]| {
            Matrix6::from_diagonal(&Vector6::new(across, along, across, angle[0], angle[1], angle[2]))
        };
        let frame = BodyFrame {
            inertia: Vector6::new(
                mass,
                mass,
                mass,
                MOMENTS[0] * share,
                MOMENTS[1] * share,
                MOMENTS[2] * share,
            ),
            weight: Vector6::new(0.0, 0.0, mass * GRAVITY, 0.0, 0.0, 0.0),
            stiffness: neck(2000.0, 500.0, [5.0, 3.0, 5.0]),
            damping: neck(120.0, 60.0, [0.8, 0.6, 0.8]),
            gap_at_zero: SVector::repeat(START_GAP),
            jacobian,
        };
        Self::new(Shell::rig(), Air::ROOM, Valves::rig(), frame)
    }

    /// The air, kg, with which the bladders squeeze the head at `q = 0` and those below bear its weight.
    pub fn start_air(&self) -> SVector<f64, 8> {
        let lift = self.weight[2] / (8.0 * self.jacobian[(0, 2)].abs());
        SVector::from_fn(|j, _| {
            let force = if self.jacobian[(j, 2)] > 0.0 { SQUEEZE + lift } else { SQUEEZE - lift };
            let pressed = self.shell.pressed_under(force.max(0.0), START_GAP);
            pressed.map_or(0.0, |p| self.air.mass(p.pressure, p.volume))
        })
    }
}

/// A neck that pulls at the head 50 mm from its centre with `height`, and against pitch and roll.
fn neck(height: f64, pitch: f64, roll: f64) -> Matrix3<f64> {
    const ARM: f64 = 0.05;
    let arm = height * ARM;
    Matrix3::new(height, -arm, 0.0, -arm, arm * ARM + pitch, 0.0, 0.0, 0.0, roll)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::State;

    #[test]
    fn eight_bladders_make_every_wrench_and_squeeze_without_one() {
        let plant = SixDof::rig(5.0);
        let across = plant.jacobian.transpose() * plant.jacobian;
        let eigen = across.symmetric_eigenvalues();
        // Torques are smaller than forces by the arm squared.
        assert!(eigen.min() > 1e-3, "{eigen}");
        let squeeze = plant.jacobian.transpose() * SVector::<f64, 8>::repeat(1.0);
        assert!(squeeze.amax() < 1e-12, "{squeeze}");
    }

    #[test]
    fn a_gap_of_the_eight_opens_as_the_touched_point_moves_away_from_its_plate() {
        use nalgebra::Rotation3;
        let plant = SixDof::rig(5.0);
        for j in 0..8 {
            let (arm, push) = around(j);
            // All bladders push towards the head, from outside.
            assert!(push.dot(&arm) < 0.0, "{j}");
            for (axis, turn) in [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().enumerate() {
                let h = 1e-6;
                let moved = Rotation3::new(turn * h) * arm - Rotation3::new(turn * -h) * arm;
                let opens = push.dot(&moved) / (2.0 * h);
                assert!((plant.jacobian[(j, 3 + axis)] - opens).abs() < 1e-9, "{j} about {axis}");
                assert!((plant.jacobian[(j, axis)] - push[axis]).abs() < 1e-15, "{j} along {axis}");
            }
        }
    }

    #[test]
    fn the_places_of_the_three_contacts_make_the_jacobian_of_their_rig() {
        let plant = ThreeDof::rig(5.0);
        for (j, (arm, push)) in three().into_iter().enumerate() {
            let turn = arm.cross(&push);
            for (column, part) in [push.z, turn.x, turn.y].into_iter().enumerate() {
                assert!((plant.jacobian[(j, column)] - part).abs() < 1e-12, "{j} {column}: {part}");
            }
            assert!((push.norm() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn the_head_between_the_eight_has_the_stated_inertia_stiffness_and_damping() {
        // Without bladders: what is left are the head and the neck. Twice the mass has twice the inertia.
        for share in [1.0, 0.5, 1.2] {
            let mut plant = SixDof::rig(5.0 * share);
            plant.jacobian = SMatrix::zeros();
            let position = Vector6::new(0.01, -0.02, 0.03, 0.1, -0.2, 0.3);
            let rate = Vector6::new(0.2, 0.1, -0.3, 0.5, 0.4, -0.6);
            let mut state = State::<6, 8>::at_rest(position, plant.start_air());
            state.rate = rate;
            let slope = plant.slope(&state.pack::<36>(), &plant.idle());
            let (stiffness, damping) =
                ([500.0, 2000.0, 500.0, 5.0, 3.0, 5.0], [60.0, 120.0, 60.0, 0.8, 0.6, 0.8]);
            let inertia = [5.0, 5.0, 5.0, 0.024, 0.016, 0.021];
            for i in 0..6 {
                let weight = if i == 2 { 5.0 * share * 9.81 } else { 0.0 };
                let force = -stiffness[i] * position[i] - damping[i] * rate[i] - weight;
                let expected = force / (inertia[i] * share);
                assert!(
                    (slope[6 + i] - expected).abs() < 1e-9 * expected.abs(),
                    "{i}: {} {expected}",
                    slope[6 + i]
                );
            }
        }
    }

    #[test]
    fn the_head_rests_between_the_eight_where_they_were_filled() {
        for mass in [3.0, 5.0, 6.0] {
            let plant = SixDof::rig(mass);
            let air = plant.start_air();
            let rest = plant.equilibrium(&air, SVector::zeros()).unwrap();
            assert!(rest.amax() < 1e-9, "{rest}");
            let forces = plant.bladders(&rest, &air).map(|p| p.force());
            assert!(forces.iter().all(|f| *f > 2.0), "{forces:?}");
        }
    }
}
