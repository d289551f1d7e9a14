//! Areas and forces between the shape at rest and the deformed one (SCIENCE B7, in place of (3.10)-(3.14)).

use nalgebra::{Matrix3, Vector3};

/// Nanson's formula (3.8): the area `da n` that `dA N` becomes, `J F^-T N dA`. `None` where `F` has no inverse.
pub fn deformed_area(gradient: &Matrix3<f64>, area: &Vector3<f64>) -> Option<Vector3<f64>> {
    let inverse = gradient.try_inverse()?;
    Some(inverse.transpose() * area * gradient.determinant())
}

/// The nominal stress `S = J F^-1 sigma`, of which `S^T N dA` is the force on the area that was `N dA`.
/// `None` where `F` has no inverse.
pub fn nominal_stress(gradient: &Matrix3<f64>, stress: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    Some(gradient.try_inverse()? * stress * gradient.determinant())
}

/// Force on a part of an inflated shell's outer surface under a contact pressure (Pa): `-p_c n da`, `da = lambda_o^2 dA`.
/// `area` is the part at rest times its outward normal, m^2.
pub fn contact_force(outer_stretch: f64, pressure: f64, area: &Vector3<f64>) -> Vector3<f64> {
    area * (-pressure * outer_stretch * outer_stretch)
}

/// Torque of a force about the head's reference point, N m; `arm` goes from there to the contact, m.
pub fn torque(arm: &Vector3<f64>, force: &Vector3<f64>) -> Vector3<f64> {
    arm.cross(force)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pressure_all_around_a_shell_has_no_force() {
        // Areas of a cube that encloses the shell: their normals cancel.
        let sum: Vector3<f64> = (0..6)
            .map(|side| {
                let mut area = Vector3::zeros();
                area[side / 2] = if side % 2 == 0 { 1e-4 } else { -1e-4 };
                contact_force(1.1, 3000.0, &area)
            })
            .sum();
        assert!(sum.norm() < 1e-18);
    }

    #[test]
    fn a_flat_gradient_has_no_areas() {
        let flat = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
        assert_eq!(deformed_area(&flat, &Vector3::x()), None);
        assert_eq!(nominal_stress(&flat, &Matrix3::identity()), None);
    }

    #[test]
    fn a_torque_turns_from_the_arm_to_the_force_and_is_that_of_the_grasp_map() {
        // A force along y at an arm along x turns about z, from x to y.
        assert_eq!(
            torque(&Vector3::new(0.1, 0.0, 0.0), &Vector3::new(0.0, 5.0, 0.0)),
            Vector3::new(0.0, 0.0, 0.5)
        );
        let (arm, force) = (Vector3::new(0.03, -0.07, 0.05), Vector3::new(4.0, 1.0, -2.0));
        let wrench = stillpoint_mechanics::contact::grasp::point(&arm) * force;
        assert!((wrench.fixed_rows::<3>(3) - torque(&arm, &force)).amax() < 1e-15);
    }
}
