//! A mass in spherical coordinates `(r, phi, theta)`, `phi` being the polar angle: Lagrange's equations (SCIENCE C1, in
//! place of (3.55) and (B.9)). Singular where `sin(phi) = 0`.

use nalgebra::{Matrix3, Vector3};

/// Where a mass is and how fast: `q = (r, phi, theta)` in m and rad, and its rates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    pub q: Vector3<f64>,
    pub rate: Vector3<f64>,
}

/// `M(q)` for a mass in kg.
pub fn mass_matrix(mass: f64, motion: &Motion) -> Matrix3<f64> {
    let (r, sine) = (motion.q.x, libm::sin(motion.q.y));
    Matrix3::from_diagonal(&(Vector3::new(1.0, r * r, r * r * sine * sine) * mass))
}

/// `C(q, q')`, chosen so that `M' - 2 C` is skew.
pub fn velocity_matrix(mass: f64, motion: &Motion) -> Matrix3<f64> {
    let r = motion.q.x;
    let (sine, cosine) = (libm::sin(motion.q.y), libm::cos(motion.q.y));
    let (r_rate, phi_rate, theta_rate) = (motion.rate.x, motion.rate.y, motion.rate.z);
    let (square, across) = (sine * sine, r * r * sine * cosine);
    let about_axis = r * square * theta_rate;
    mass * Matrix3::new(
        0.0,
        -r * phi_rate,
        -about_axis,
        r * phi_rate,
        r * r_rate,
        -across * theta_rate,
        about_axis,
        across * theta_rate,
        r * square * r_rate + across * phi_rate,
    )
}

/// The generalised force (N, N m, N m) that gives a mass these accelerations.
pub fn force(mass: f64, motion: &Motion, acceleration: &Vector3<f64>) -> Vector3<f64> {
    mass_matrix(mass, motion) * acceleration + velocity_matrix(mass, motion) * motion.rate
}

/// The accelerations under a generalised force; not finite where the coordinates are singular.
pub fn acceleration(mass: f64, motion: &Motion, force: &Vector3<f64>) -> Vector3<f64> {
    let left = force - velocity_matrix(mass, motion) * motion.rate;
    left.component_div(&mass_matrix(mass, motion).diagonal())
}

/// Kinetic energy, J.
pub fn energy(mass: f64, motion: &Motion) -> f64 {
    0.5 * motion.rate.dot(&(mass_matrix(mass, motion) * motion.rate))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_velocity_terms_do_no_work(
            q in prop::array::uniform3(0.3..2.8f64),
            rate in prop::array::uniform3(-2.0..2.0f64),
        ) {
            let motion = Motion { q: q.into(), rate: rate.into() };
            let h = 1e-6;
            let at = |sign: f64| mass_matrix(1.3, &Motion { q: motion.q + motion.rate * (sign * h), ..motion });
            let mass_rate = (at(1.0) - at(-1.0)) / (2.0 * h);
            let skew = mass_rate - velocity_matrix(1.3, &motion) * 2.0;
            prop_assert!((skew + skew.transpose()).amax() < 1e-6, "{}", skew);
        }

        #[test]
        fn force_and_acceleration_undo_each_other(
            q in prop::array::uniform3(0.3..2.8f64),
            rate in prop::array::uniform3(-2.0..2.0f64),
            requested in prop::array::uniform3(-2.0..2.0f64),
        ) {
            let (motion, requested) = (Motion { q: q.into(), rate: rate.into() }, Vector3::from(requested));
            let found = acceleration(0.7, &motion, &force(0.7, &motion, &requested));
            prop_assert!((found - requested).amax() < 1e-9, "{}", found);
        }
    }
}
