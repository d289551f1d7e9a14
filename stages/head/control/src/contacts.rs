//! The contacts between bladders and head: the force of each, and how far it is from sliding (SCIENCE B3, B8, C4).
//!
//! The normal force follows from the pressure of the bladder and the distance of its plates. What these forces leave of
//! weight and neck is borne by friction: of all tangential forces that make this wrench, the least ones (3.37) are
//! compared with the friction cones (3.4).

use nalgebra::{DMatrix, SMatrix, SVector, Vector3, Vector6};
use stillpoint_mechanics::contact::grasp::{Touch, least_forces, point};
use stillpoint_mechanics::plant::Plant;
use stillpoint_mechanics::shell::Shell;

/// Bladders that there is room for.
pub const BLADDERS: usize = 8;
/// Stretches between which the one of a pressure is looked for.
const STRETCHES: [f64; 2] = [0.5, 6.0];
/// Halvings of that interval: to 2e-11 of a stretch.
const HALVINGS: u32 = 38;

/// Tangential forces along the contacts of a wrench on the head: two for each contact.
#[derive(Clone, Debug)]
pub struct Friction {
    /// Two directions for each contact that are tangential to it.
    along: [[Vector3<f64>; 2]; BLADDERS],
    /// The least forces along these directions for a wrench.
    least: SMatrix<f64, { 2 * BLADDERS }, 6>,
}

impl Friction {
    /// Of eight contacts; `None` where their tangential forces do not make every wrench.
    #[must_use]
    pub fn new(touches: &[Touch; BLADDERS]) -> Option<Self> {
        let along = touches.map(|touch| {
            let far = if touch.normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
            let first = touch.normal.cross(&far).normalize();
            [first, touch.normal.cross(&first)]
        });
        let mut map = DMatrix::zeros(6, 2 * BLADDERS);
        for (j, (touch, along)) in touches.iter().zip(&along).enumerate() {
            let finger = point(&touch.arm);
            for (k, direction) in along.iter().enumerate() {
                map.column_mut(2 * j + k).copy_from(&(finger * direction));
            }
        }
        let mut least = SMatrix::<f64, { 2 * BLADDERS }, 6>::zeros();
        for axis in 0..6 {
            let mut wrench = Vector6::zeros();
            wrench[axis] = 1.0;
            least.column_mut(axis).copy_from(&least_forces(&map, &wrench)?.rows(0, 2 * BLADDERS));
        }
        Some(Self { along, least })
    }

    /// Length of the tangential force at each contact, N, for a wrench (N, N m) on the head.
    #[must_use]
    pub fn tangential(&self, wrench: &Vector6<f64>) -> [f64; BLADDERS] {
        let forces = self.least * wrench;
        std::array::from_fn(|j| {
            let [first, second] = self.along[j];
            (first * forces[2 * j] + second * forces[2 * j + 1]).norm()
        })
    }
}

/// What is known of the contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held {
    /// Force along the normal, N.
    pub force: [f64; BLADDERS],
    /// Force along the contact that friction has to bear, N; NaN where the places of the contacts are not known.
    pub tangential: [f64; BLADDERS],
    /// Distance of the plates, m.
    pub gap: [f64; BLADDERS],
}

/// The contacts of a plant at these coordinates with these pressures (Pa over that of the room).
#[must_use]
pub fn held<const D: usize, const B: usize, const N: usize>(
    plant: &Plant<D, B, N>,
    friction: Option<&Friction>,
    position: &SVector<f64, D>,
    pressure: &[f64; BLADDERS],
) -> Held {
    let gaps = plant.gaps(position);
    let mut held = Held { force: [0.0; BLADDERS], tangential: [0.0; BLADDERS], gap: [0.0; BLADDERS] };
    let mut push = SVector::<f64, B>::zeros();
    for j in 0..B.min(BLADDERS) {
        push[j] = force(&plant.shell, pressure[j], gaps[j]);
        (held.force[j], held.gap[j], held.tangential[j]) = (push[j], gaps[j], f64::NAN);
    }
    if let (Some(friction), 6) = (friction, D) {
        let borne = plant.weight + plant.stiffness * position - plant.jacobian.transpose() * push;
        let wrench = Vector6::from_fn(|i, _| borne.get(i).copied().unwrap_or(0.0));
        held.tangential = friction.tangential(&wrench);
    }
    held
}

/// Force of a bladder of this pressure, Pa, between plates this far apart, m; a bladder cannot pull. The pressure grows
/// with the stretch.
#[must_use]
pub fn force(shell: &Shell, pressure: f64, gap: f64) -> f64 {
    if !(pressure.is_finite() && gap.is_finite()) {
        return f64::NAN;
    }
    if pressure <= 0.0 {
        return 0.0;
    }
    let [mut low, mut high] = STRETCHES;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if shell.pressed(middle, gap).pressure < pressure { low = middle } else { high = middle }
    }
    shell.pressed(0.5 * (low + high), gap).force()
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_mechanics::plant::SixDof;
    use stillpoint_mechanics::plant::layouts::around;

    fn touches() -> [Touch; BLADDERS] {
        std::array::from_fn(|j| {
            let (arm, normal) = around(j);
            Touch { arm, normal }
        })
    }

    #[test]
    fn the_force_of_a_pressure_is_that_of_the_bladder_with_it() {
        let plant = SixDof::rig(5.0);
        for (mass, gap) in [(1.0, 0.085), (1.2, 0.08), (0.97, 0.09)] {
            let pressed = plant.shell.pressed_with(mass * plant.start_air()[0], &plant.air, gap);
            let found = force(&plant.shell, pressed.pressure, gap);
            assert!((found - pressed.force()).abs() < 1e-6, "{found} {}", pressed.force());
        }
        assert!(force(&plant.shell, f64::NAN, 0.085).is_nan());
        // Flat: it touches nothing.
        assert_eq!(force(&plant.shell, 0.0, 0.2), 0.0);
    }

    #[test]
    fn at_rest_friction_bears_nothing_and_a_wrench_is_borne_by_the_least_tangential_forces() {
        let plant = SixDof::rig(5.0);
        let (air, rest) = (plant.start_air(), SVector::zeros());
        let pressure = plant.bladders(&rest, &air).map(|p| p.pressure);
        let friction = Friction::new(&touches()).unwrap();
        let held = held(&plant, Some(&friction), &rest, &pressure);
        assert!(held.tangential.iter().all(|t| *t < 1e-5), "{held:?}");
        assert!(held.force.iter().all(|f| *f > 10.0) && held.gap == [0.085; 8]);
        // One bladder below without air: its part of the weight, and what it made of the others' squeeze, is borne along.
        let mut less = pressure;
        less[0] = 0.0;
        let slack = super::held(&plant, Some(&friction), &rest, &less);
        assert_eq!(slack.force[0], 0.0);
        assert!(slack.tangential.iter().sum::<f64>() > 5.0, "{slack:?}");
        // The forces make the wrench.
        let wrench = Vector6::new(1.0, -2.0, 3.0, 0.1, 0.2, -0.3);
        let forces = friction.least * wrench;
        let mut made = Vector6::zeros();
        for (j, touch) in touches().iter().enumerate() {
            for k in 0..2 {
                let at = friction.along[j][k] * forces[2 * j + k];
                assert!(friction.along[j][k].dot(&touch.normal).abs() < 1e-12);
                let turn = touch.arm.cross(&at);
                made += Vector6::new(at.x, at.y, at.z, turn.x, turn.y, turn.z);
            }
        }
        assert!((made - wrench).amax() < 1e-9, "{made}");
    }
}
