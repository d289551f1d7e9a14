//! The poses that a rig can hold. A set-point is accepted only if pushing bladders can hold it within their limits.
//! (With unsuitable lever arms the dissertation's own step cannot be held: SCIENCE C6.)

use nalgebra::{SMatrix, SVector};

use super::body::Plant;
use super::plate::Pressed;
use crate::linear;

/// What bladders may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Greatest gauge pressure, Pa.
    pub pressure: f64,
    /// Least push of a bladder that is to stay in touch, N.
    pub push: f64,
    /// Least gap, m.
    pub gap: f64,
    pub stretch: f64,
}

impl Limits {
    /// Those of the rigs: 40 kPa, 0.5 N, a gap above the foam, and rubber that is stretched by less than 80 %.
    pub const RIG: Self = Self { pressure: 40e3, push: 0.5, gap: 0.065, stretch: 1.8 };
}

/// How a rig holds a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold<const B: usize> {
    pub bladders: [Pressed; B],
    /// Its push, N.
    pub force: SVector<f64, B>,
    /// Its air, kg.
    pub air: SVector<f64, B>,
}

/// Why a rig cannot hold a pose.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unreachable {
    /// A pose that is no pose.
    #[error("the pose has a coordinate that is not finite")]
    NotFinite,
    /// A bladder would be pressed flat.
    #[error("bladder {bladder} would be pressed to {gap} m, below its least gap of {least} m")]
    Flat {
        /// Number of the bladder, from 0.
        bladder: usize,
        /// Its gap, m.
        gap: f64,
        /// The least, m.
        least: f64,
    },
    /// A bladder would not reach its plates, or only above the greatest pressure or stretch.
    #[error(
        "bladder {bladder} would have to bridge {gap} m, more than it does at {pressure} Pa and its greatest stretch"
    )]
    Apart {
        /// Number of the bladder, from 0.
        bladder: usize,
        /// Its gap, m.
        gap: f64,
        /// The greatest pressure, Pa.
        pressure: f64,
    },
    /// A bladder would have to push less than it must to stay in touch, or pull.
    #[error("bladder {bladder} would have to push with {force} N, less than {least} N: it cannot pull")]
    Pulls {
        /// Number of the bladder, from 0.
        bladder: usize,
        /// Its push, N.
        force: f64,
        /// The least, N.
        least: f64,
    },
    /// A bladder would have to push more than it does at the greatest pressure and stretch.
    #[error("bladder {bladder} would have to push with {force} N, more than the {greatest} N that it can")]
    TooHard {
        /// Number of the bladder, from 0.
        bladder: usize,
        /// Its push, N.
        force: f64,
        /// The greatest, N.
        greatest: f64,
    },
}

/// Rounds of projections for rigs with more bladders than coordinates.
const ROUNDS: u32 = 5000;

impl<const D: usize, const B: usize, const N: usize> Plant<D, B, N> {
    /// How the rig holds a pose, of the ways that there are the one nearest to `requested` pushes (N).
    ///
    /// # Errors
    /// [`Unreachable`] names the bladder that stands in the way.
    pub fn reach(
        &self,
        position: &SVector<f64, D>,
        limits: &Limits,
        requested: &SVector<f64, B>,
    ) -> Result<Hold<B>, Unreachable> {
        if !position.iter().all(|x| x.is_finite()) {
            return Err(Unreachable::NotFinite);
        }
        let gaps = self.gaps(position);
        let mut greatest = SVector::<f64, B>::zeros();
        for (bladder, gap) in gaps.iter().copied().enumerate() {
            if gap < limits.gap {
                return Err(Unreachable::Flat { bladder, gap, least: limits.gap });
            }
            let apart = Unreachable::Apart { bladder, gap, pressure: limits.pressure };
            let stretched = self.shell.pressed(limits.stretch, gap).force();
            greatest[bladder] = self.shell.greatest_push(limits.pressure, gap).ok_or(apart)?.min(stretched);
            if greatest[bladder] < limits.push {
                return Err(apart);
            }
        }
        let force = self.pushes(position, limits.push, &greatest, requested)?;
        let mut bladders = [self.shell.pressed(1.0, gaps[0]); B];
        let mut air = SVector::<f64, B>::zeros();
        for (bladder, pressed) in bladders.iter_mut().enumerate() {
            let (gap, pressure) = (gaps[bladder], limits.pressure);
            let found = self.shell.pressed_under(force[bladder], gap);
            *pressed = found.ok_or(Unreachable::Apart { bladder, gap, pressure })?;
            air[bladder] = self.air.mass(pressed.pressure, pressed.volume);
        }
        Ok(Hold { bladders, force, air })
    }

    /// Whether a rig can hold every pose on the straight way from one to another, at `parts` + 1 places.
    ///
    /// # Errors
    /// How far it comes, 0 to 1, and what stands in the way there.
    pub fn reach_along(
        &self,
        from: &SVector<f64, D>,
        to: &SVector<f64, D>,
        parts: u32,
        limits: &Limits,
        requested: &SVector<f64, B>,
    ) -> Result<(), (f64, Unreachable)> {
        for i in 0..=parts {
            let part = f64::from(i) / f64::from(parts.max(1));
            let position = from + (to - from) * part;
            self.reach(&position, limits, requested).map_err(|why| (part, why))?;
        }
        Ok(())
    }
    /// Pushes between `least` and `greatest` that hold a pose, those nearest to the wanted ones: Dykstra's alternating
    /// projections between the pushes that bear weight and neck and those that bladders can make.
    fn pushes(
        &self,
        position: &SVector<f64, D>,
        least: f64,
        greatest: &SVector<f64, B>,
        requested: &SVector<f64, B>,
    ) -> Result<SVector<f64, B>, Unreachable> {
        let needed = self.weight + self.stiffness * position;
        let slopes = self.gap_slopes(position);
        let across = slopes.transpose();
        let square: SMatrix<f64, D, D> = across * slopes;
        let mut force = *requested;
        let mut correction = SVector::<f64, B>::zeros();
        let mut made = force;
        for _ in 0..ROUNDS {
            let left = needed - across * force;
            made = force + slopes * linear::solve_semidefinite(square, left);
            let asked = made + correction;
            let borne = SVector::<f64, B>::from_fn(|j, _| asked[j].clamp(least, greatest[j]));
            correction = asked - borne;
            if (borne - made).amax() <= 1e-9 * needed.amax().max(1.0) {
                return Ok(borne);
            }
            force = borne;
        }
        Err(refused(&made, least, greatest))
    }
}

/// The bladder that is farthest beyond its limits.
fn refused<const B: usize>(made: &SVector<f64, B>, least: f64, greatest: &SVector<f64, B>) -> Unreachable {
    let excess = |j: &usize| (least - made[*j]).max(made[*j] - greatest[*j]);
    let bladder = (0..B).max_by(|a, b| excess(a).total_cmp(&excess(b))).unwrap_or(0);
    let force = made[bladder];
    if force < least {
        Unreachable::Pulls { bladder, force, least }
    } else {
        Unreachable::TooHard { bladder, force, greatest: greatest[bladder] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::body::BodyFrame;
    use crate::plant::layouts::{SixDof, ThreeDof};
    use crate::plant::valve::Valves;
    use crate::shell::Shell;
    use crate::shell::air::Air;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    const STEP: [f64; 3] =
        [0.0115, 1.35 * core::f64::consts::PI / 180.0, 10.0 * core::f64::consts::PI / 180.0];

    fn requested() -> Vector3<f64> {
        Vector3::repeat(20.0)
    }

    #[test]
    fn the_sources_step_can_be_held_on_the_whole_way() {
        let plant = ThreeDof::rig(5.0);
        let start = plant.equilibrium(&plant.start_air(), Vector3::zeros()).unwrap();
        let end = start + Vector3::from(STEP);
        assert_eq!(plant.reach_along(&start, &end, 20, &Limits::RIG, &requested()), Ok(()));
        let hold = plant.reach(&end, &Limits::RIG, &requested()).unwrap();
        let rest = plant.equilibrium(&hold.air, start).unwrap();
        assert!((rest - end).amax() < 1e-9, "{rest} {end}");
    }

    /// The first geometry that SCIENCE C6 tells of: a stiff neck on a long arm, sides that do not pitch.
    #[test]
    fn with_a_careless_geometry_it_cannot() {
        let careful = ThreeDof::rig(5.0);
        let (k, l) = (2000.0, 0.10);
        let neck = Matrix3::new(k, -k * l, 0.0, -k * l, k * l * l + 5.0, 0.0, 0.0, 0.0, 3.0);
        let frame = BodyFrame {
            inertia: careful.inertia,
            weight: careful.weight,
            stiffness: neck,
            damping: careful.damping,
            gap_at_zero: careful.gap_at_zero,
            jacobian: Matrix3::new(1.0, 0.05, 0.0, 0.30, 0.0, 0.07, 0.30, 0.0, -0.07),
        };
        let plant = ThreeDof::new(Shell::rig(), Air::ROOM, Valves::rig(), frame);
        let start = plant.equilibrium(&careful.start_air(), Vector3::zeros()).unwrap();
        let error = plant.reach(&(start + Vector3::from(STEP)), &Limits::RIG, &requested()).unwrap_err();
        assert!(matches!(error, Unreachable::Pulls { .. } | Unreachable::TooHard { .. }), "{error}");
    }

    #[test]
    fn a_map_has_what_can_be_held_in_its_middle_and_not_at_its_rim() {
        let plant = ThreeDof::rig(5.0);
        let start = plant.equilibrium(&plant.start_air(), Vector3::zeros()).unwrap();
        let is_held = |i: u32, j: u32| {
            let moved = Vector3::new(0.005 * f64::from(i) - 0.04, 0.05 * f64::from(j) - 0.6, 0.0);
            plant.reach(&(start + moved), &Limits::RIG, &requested()).is_ok()
        };
        let held = (0..25 * 25).filter(|place| is_held(place / 25, place % 25)).count();
        assert!((100..560).contains(&held), "{held}");
        assert!(is_held(8, 12) && !is_held(0, 0));
    }

    #[test]
    fn no_pose_is_no_pose() {
        let plant = ThreeDof::rig(5.0);
        for bad in [f64::NAN, f64::INFINITY] {
            let error = plant.reach(&Vector3::new(bad, 0.0, 0.0), &Limits::RIG, &requested()).unwrap_err();
            assert_eq!(error, Unreachable::NotFinite);
        }
    }

    proptest! {
        #[test]
        fn what_three_bladders_are_said_to_hold_they_hold(
            q in (-0.01..0.03f64, -0.1..0.15f64, -0.25..0.25f64),
        ) {
            let plant = ThreeDof::rig(5.0);
            let q = Vector3::new(q.0, q.1, q.2);
            if let Ok(hold) = plant.reach(&q, &Limits::RIG, &requested()) {
                let (left, _) = plant.static_force(&q, &hold.air);
                prop_assert!(left.amax() < 1e-6, "{}", left);
                for (pressed, force) in hold.bladders.iter().zip(hold.force.iter()) {
                    prop_assert!(pressed.pressure <= Limits::RIG.pressure * (1.0 + 1e-6), "{pressed:?}");
                    prop_assert!(*force >= Limits::RIG.push - 1e-9 && pressed.is_modelled(&plant.shell));
                }
            }
        }

        #[test]
        fn what_eight_bladders_are_said_to_hold_they_hold(
            place in prop::array::uniform3(-0.012..0.012f64),
            turn in prop::array::uniform3(-0.1..0.1f64),
        ) {
            let plant = SixDof::rig(5.0);
            let q = SVector::<f64, 6>::from_iterator(place.into_iter().chain(turn));
            if let Ok(hold) = plant.reach(&q, &Limits::RIG, &SVector::repeat(20.0)) {
                let (left, _) = plant.static_force(&q, &hold.air);
                prop_assert!(left.amax() < 1e-6, "{}", left);
                prop_assert!(hold.force.min() >= Limits::RIG.push - 1e-9);
            }
        }
    }
}
