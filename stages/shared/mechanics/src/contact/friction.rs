//! What a soft finger can bear (3.3)-(3.4), SCIENCE B3: `f_z >= 0`, `|f_t| <= mu f_z`, `|tau_n| <= gamma f_z`.

use nalgebra::Vector3;

/// Friction of a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Friction {
    /// `mu`, of sliding.
    pub sliding: f64,
    /// `gamma`, of spinning, m.
    pub spinning: f64,
}

/// Force and torque of a contact on the head, in axes whose z is the head's inward normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FingerForce {
    /// N.
    pub force: Vector3<f64>,
    /// About the normal, N m.
    pub torque: f64,
}

/// Distance of a contact force from the friction cone; zero inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margin {
    /// `f_z`, N.
    pub push: f64,
    /// `mu f_z - |f_t|`, N.
    pub sliding: f64,
    /// `gamma f_z - |tau_n|`, N m.
    pub spinning: f64,
}

impl Margin {
    pub fn is_inside(&self) -> bool {
        self.push >= 0.0 && self.sliding >= 0.0 && self.spinning >= 0.0
    }
}

impl Friction {
    /// How far a contact is from slipping.
    pub fn margin(&self, finger: &FingerForce) -> Margin {
        let push = finger.force.z;
        Margin {
            push,
            sliding: self.sliding * push - libm::hypot(finger.force.x, finger.force.y),
            spinning: self.spinning * push - finger.torque.abs(),
        }
    }

    /// The force nearest to a finger's that the contact bears while it pushes with at least `least` N. Torques are
    /// measured against forces by `torque_scale`, m.
    pub fn nearest(&self, finger: &FingerForce, least: f64, torque_scale: f64) -> FingerForce {
        let tangential = libm::hypot(finger.force.x, finger.force.y);
        let spin = finger.torque.abs() / torque_scale;
        let (mu, gamma) = (self.sliding, self.spinning / torque_scale);
        // Half the squared distance falls to its minimum over the push; its slope is a straight line between the
        // pushes from which both frictions suffice.
        let pushes = [(false, false), (true, false), (false, true), (true, true)].map(|(slides, spins)| {
            let (mut sum, mut weight) = (finger.force.z, 1.0);
            if slides {
                (sum, weight) = (sum + mu * tangential, weight + mu * mu);
            }
            if spins {
                (sum, weight) = (sum + gamma * spin, weight + gamma * gamma);
            }
            sum / weight
        });
        let slope = |z: f64| {
            z - finger.force.z - mu * (tangential - mu * z).max(0.0) - gamma * (spin - gamma * z).max(0.0)
        };
        let best = pushes.into_iter().min_by(|a, b| slope(*a).abs().total_cmp(&slope(*b).abs()));
        let push = best.unwrap_or(0.0).max(least.max(0.0));
        let retained = if tangential > mu * push { mu * push / tangential } else { 1.0 };
        FingerForce {
            force: Vector3::new(finger.force.x * retained, finger.force.y * retained, push),
            torque: finger.torque.clamp(-self.spinning * push, self.spinning * push),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn finger() -> impl Strategy<Value = FingerForce> {
        (prop::array::uniform3(-5.0..5.0f64), -0.2..0.2f64)
            .prop_map(|(force, torque)| FingerForce { force: force.into(), torque })
    }

    fn distance(a: &FingerForce, b: &FingerForce) -> f64 {
        ((a.force - b.force).norm_squared() + ((a.torque - b.torque) / 0.05).powi(2)).sqrt()
    }

    proptest! {
        #[test]
        fn the_nearest_force_is_borne_and_no_other_is_nearer(
            requested in finger(),
            other in finger(),
            least in 0.0..1.0f64,
            sliding in 0.1..1.0f64,
            spinning in 0.001..0.05f64,
        ) {
            let friction = Friction { sliding, spinning };
            let found = friction.nearest(&requested, least, 0.05);
            let margin = friction.margin(&found);
            prop_assert!(found.force.z >= least && margin.sliding > -1e-12 && margin.spinning > -1e-12);
            // Any force that is borne, by its parts of what is allowed.
            let push = other.force.z.abs().max(least);
            let side = other.force.xy().normalize() * (sliding * push * (other.force.x / 5.0).abs());
            let torque = spinning * push * other.torque / 0.2;
            let other = FingerForce { force: Vector3::new(side.x, side.y, push), torque };
            prop_assert!(friction.margin(&other).is_inside());
            prop_assert!(distance(&found, &requested) <= distance(&other, &requested) + 1e-12);
        }

        #[test]
        fn no_other_push_with_all_that_it_bears_is_nearer(
            requested in finger(),
            least in 0.0..1.0f64,
            sliding in 0.1..1.0f64,
            spinning in 0.001..0.05f64,
        ) {
            let friction = Friction { sliding, spinning };
            // Of all forces with this push, the nearest one.
            let with = |push: f64| {
                let tangential = libm::hypot(requested.force.x, requested.force.y);
                let retained = (sliding * push / tangential).min(1.0);
                FingerForce {
                    force: Vector3::new(requested.force.x * retained, requested.force.y * retained, push),
                    torque: requested.torque.clamp(-spinning * push, spinning * push),
                }
            };
            let found = friction.nearest(&requested, least, 0.05);
            prop_assert!(distance(&found, &with(found.force.z)) < 1e-9);
            // The squared distance is convex in the push: neither a little more nor a little less is nearer.
            for push in [0.999, 1.001].map(|part| (found.force.z * part).max(least)) {
                prop_assert!(distance(&found, &requested) <= distance(&with(push), &requested) + 1e-9);
            }
        }

        #[test]
        fn what_is_borne_is_its_own_nearest(requested in finger()) {
            let friction = Friction { sliding: 0.6, spinning: 0.02 };
            let found = friction.nearest(&requested, 0.0, 0.05);
            prop_assert!(distance(&friction.nearest(&found, 0.0, 0.05), &found) < 1e-12);
        }
    }
}
