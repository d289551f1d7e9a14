//! Forces that hold a wrench while all contacts push (SCIENCE B8: a squeeze is admissible only if all contacts push).
//!
//! The rigs and the controllers do not use this module yet: the reference vectors and its own tests do.

use nalgebra::{DVector, Vector3, Vector6};

use super::friction::{FingerForce, Friction};
use super::grasp::{Touch, least_forces, soft_fingers};

/// How contacts are to squeeze.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grip {
    /// What each contact bears.
    pub friction: Friction,
    /// Least push of each contact, N.
    pub least: f64,
    /// The push that each contact would like, N.
    pub requested: f64,
}

/// Why a grip cannot hold a wrench.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SqueezeError {
    /// The contacts cannot make all wrenches.
    #[error("the contacts cannot make every wrench; place them so that no axis passes through all of them")]
    Rank,
    /// No forces inside the friction cones make the wrench.
    #[error("no pushing forces inside the friction cones make this wrench: {left} (N, N m) is left over")]
    NotHeld {
        /// Largest component of the remaining wrench.
        left: f64,
    },
}

/// A metre of arm that makes torques and forces alike.
const ARM: f64 = 0.1;
const ROUNDS: u32 = 20_000;

/// The contacts' forces nearest to the wanted squeeze that make `wrench` on the head inside their friction cones, four
/// numbers a contact in the head's axes (force, torque about the inward normal).
///
/// Dykstra's alternating projections between the forces that make the wrench and the cones.
///
/// # Errors
/// [`SqueezeError`] where the contacts cannot hold the wrench.
pub fn squeeze(touches: &[Touch], grip: &Grip, wrench: &Vector6<f64>) -> Result<DVector<f64>, SqueezeError> {
    let map = soft_fingers(touches);
    let mut forces = DVector::zeros(4 * touches.len());
    for (i, touch) in touches.iter().enumerate() {
        forces.fixed_rows_mut::<3>(4 * i).copy_from(&(touch.normal * grip.requested));
    }
    let scale = wrench.amax().max(grip.requested).max(1e-3);
    let mut correction = DVector::<f64>::zeros(forces.len());
    for _ in 0..ROUNDS {
        let left = wrench - Vector6::from_iterator((&map * &forces).iter().copied());
        let back = least_forces(&map, &left).ok_or(SqueezeError::Rank)?;
        let made = &forces + back;
        let asked = &made + &correction;
        let borne = into_cones(&asked, touches, grip);
        correction = asked - &borne;
        // Both sets hold what both projections leave alone.
        if (&borne - &made).amax() <= 1e-9 * scale {
            return Ok(made);
        }
        forces = borne;
    }
    let left = wrench - Vector6::from_iterator((&map * &forces).iter().copied());
    Err(SqueezeError::NotHeld { left: left.amax() })
}

fn into_cones(forces: &DVector<f64>, touches: &[Touch], grip: &Grip) -> DVector<f64> {
    let mut borne = forces.clone();
    for (i, touch) in touches.iter().enumerate() {
        let force: Vector3<f64> = forces.fixed_rows::<3>(4 * i).into_owned();
        let push = touch.normal.dot(&force);
        let tangential = force - touch.normal * push;
        let length = tangential.norm();
        // In axes of the contact: x along the tangential force, z along the normal.
        let finger = FingerForce { force: Vector3::new(length, 0.0, push), torque: forces[4 * i + 3] };
        let nearest = grip.friction.nearest(&finger, grip.least, ARM);
        let along = if length > 0.0 { tangential * (nearest.force.x / length) } else { tangential };
        borne.fixed_rows_mut::<3>(4 * i).copy_from(&(along + touch.normal * nearest.force.z));
        borne[4 * i + 3] = nearest.torque;
    }
    borne
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRIP: Grip =
        Grip { friction: Friction { sliding: 0.5, spinning: 0.01 }, least: 1.0, requested: 8.0 };

    /// Eight contacts: four sides of a head at two heights.
    fn ring() -> Vec<Touch> {
        let mut touches = Vec::new();
        for along in [-0.05, 0.05] {
            for (x, z) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
                let arm = Vector3::new(0.08 * x, along, 0.09 * z);
                touches.push(Touch { arm, normal: -Vector3::new(x, 0.0, z) });
            }
        }
        touches
    }

    #[test]
    fn a_head_is_held_against_its_weight_with_all_contacts_pushing() {
        let touches = ring();
        let weight = Vector6::new(0.0, 0.0, 49.0, 0.3, 0.0, 0.0);
        let forces = squeeze(&touches, &GRIP, &weight).unwrap();
        let made = soft_fingers(&touches) * &forces;
        assert!((Vector6::from_iterator(made.iter().copied()) - weight).amax() < 1e-7, "{made}");
        for (i, touch) in touches.iter().enumerate() {
            let force: Vector3<f64> = forces.fixed_rows::<3>(4 * i).into_owned();
            let push = touch.normal.dot(&force);
            let side = (force - touch.normal * push).norm();
            let finger = FingerForce { force: Vector3::new(side, 0.0, push), torque: forces[4 * i + 3] };
            let margin = GRIP.friction.margin(&finger);
            assert!(push >= 1.0 - 1e-6 && margin.sliding > -1e-6 && margin.spinning > -1e-6, "{margin:?}");
        }
    }

    #[test]
    fn nothing_holds_a_pull_where_no_contact_pushes() {
        // All contacts lie under the head and are slippery: none can pull it down.
        let touches: Vec<Touch> = [(-0.05, -0.05), (-0.05, 0.05), (0.05, -0.05), (0.05, 0.05)]
            .map(|(x, y)| Touch { arm: Vector3::new(x, y, -0.09), normal: Vector3::z() })
            .into();
        let down = Vector6::new(0.0, 0.0, -10.0, 0.0, 0.0, 0.0);
        let error = squeeze(&touches, &GRIP, &down).unwrap_err();
        assert!(matches!(error, SqueezeError::NotHeld { left } if left > 1.0), "{error}");
    }

    #[test]
    fn a_single_contact_cannot_make_every_wrench() {
        let one = [Touch { arm: Vector3::new(0.0, 0.0, -0.09), normal: Vector3::z() }];
        let error = squeeze(&one, &GRIP, &Vector6::zeros()).unwrap_err();
        assert_eq!(error, SqueezeError::Rank);
    }
}
