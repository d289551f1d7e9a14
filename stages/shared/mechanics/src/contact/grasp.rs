//! Contacts to wrenches and back: Jacobians, grasp maps and their null spaces (SCIENCE B8, (3.33)-(3.46)).

use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

use super::se3::hat;

/// A point of contact with the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// From the head's reference point to the contact, m.
    pub arm: Vector3<f64>,
    /// The head's inward normal there, of length 1.
    pub normal: Vector3<f64>,
}

/// Wrench of a soft finger's force and its torque about the normal, `[[I, 0], [hat r, I]] B` (3.34).
pub fn soft_finger(touch: &Touch) -> SMatrix<f64, 6, 4> {
    let mut map = SMatrix::<f64, 6, 4>::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
    map.fixed_view_mut::<3, 3>(3, 0).copy_from(&hat(&touch.arm));
    map.fixed_view_mut::<3, 1>(3, 3).copy_from(&touch.normal);
    map
}

/// Wrench of a point contact with friction, `[I; hat r]` (3.45).
pub fn point(arm: &Vector3<f64>) -> SMatrix<f64, 6, 3> {
    soft_finger(&Touch { arm: *arm, normal: Vector3::z() }).fixed_columns::<3>(0).into_owned()
}

/// The map of soft fingers side by side: the wrench `(f, tau)` of all their forces, four numbers a finger; its transpose
/// gives the contacts' velocities of a head's twist (3.35), (3.37). With eight fingers 6 x 32, of nullity 26.
pub fn soft_fingers(touches: &[Touch]) -> DMatrix<f64> {
    let mut map = DMatrix::zeros(6, 4 * touches.len());
    for (i, touch) in touches.iter().enumerate() {
        map.fixed_view_mut::<6, 4>(0, 4 * i).copy_from(&soft_finger(touch));
    }
    map
}

/// Where four bladders touch a head in the plane, by radius (m) and angle from the y axis (rad) of each (3.41).
pub fn planar_arms(radius: &[f64; 4], angle: &[f64; 4]) -> [Vector2<f64>; 4] {
    const SIGNS: [(f64, f64); 4] = [(-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (1.0, -1.0)];
    core::array::from_fn(|i| {
        let (x, y) = SIGNS[i];
        Vector2::new(x * radius[i] * libm::sin(angle[i]), y * radius[i] * libm::cos(angle[i]))
    })
}

/// The planar map: `(f_x, f_y, tau_z)` of four contacts' forces (3.40)-(3.43), of rank 3.
pub fn planar(arms: &[Vector2<f64>; 4]) -> SMatrix<f64, 3, 8> {
    let mut map = SMatrix::<f64, 3, 8>::zeros();
    for (i, arm) in arms.iter().enumerate() {
        map.fixed_view_mut::<3, 2>(0, 2 * i)
            .copy_from(&SMatrix::<f64, 3, 2>::new(1.0, 0.0, 0.0, 1.0, -arm.y, arm.x));
    }
    map
}

/// An orthonormal basis of what a map sends to zero, column by column. The map's rows may depend on each other.
///
/// Gram and Schmidt's way, twice: over the rows, then over the unit vectors. Any other basis differs from it by a
/// rotation; compare projectors `N N^T`.
pub fn null_space(map: &DMatrix<f64>) -> DMatrix<f64> {
    let (rows, columns) = map.shape();
    let mut basis: Vec<nalgebra::DVector<f64>> = Vec::with_capacity(columns);
    let scale = map.amax().max(f64::MIN_POSITIVE);
    let mut admit = |candidate: nalgebra::DVector<f64>, least: f64| {
        let mut rest = candidate;
        for _ in 0..2 {
            for known in &basis {
                let part = known.dot(&rest);
                rest.axpy(-part, known, 1.0);
            }
        }
        let length = rest.norm();
        if length > least {
            basis.push(rest / length);
        }
        basis.len()
    };
    let mut rank = 0;
    for row in 0..rows {
        rank = admit(map.row(row).transpose(), 1e-10 * scale);
    }
    for axis in 0..columns {
        // One of the unit vectors that are left has at least this much of its length outside the basis.
        let mut unit = nalgebra::DVector::zeros(columns);
        unit[axis] = 1.0;
        admit(unit, 1e-8);
    }
    let null: Vec<_> = basis.drain(rank.min(columns)..).collect();
    if null.is_empty() { DMatrix::zeros(columns, 0) } else { DMatrix::from_columns(&null) }
}

/// The forces of least length that make a wrench: `G^T (G G^T)^-1 w`; `None` where the contacts cannot make all wrenches.
pub fn least_forces(map: &DMatrix<f64>, wrench: &Vector6<f64>) -> Option<nalgebra::DVector<f64>> {
    let square = map * map.transpose();
    let square = Matrix6::from_iterator(square.iter().copied());
    Some(map.transpose() * crate::linear::solve(square, *wrench)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Velocity of the point and angular velocity of a head with a twist `(v, w)`: `[[I, -hat r], [0, I]]` (3.33).
    fn contact_jacobian(arm: &Vector3<f64>) -> Matrix6<f64> {
        let mut jacobian = Matrix6::identity();
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-hat(arm));
        jacobian
    }

    proptest! {
        #[test]
        fn forces_of_the_null_space_make_no_wrench_and_the_basis_is_orthonormal(
            arms in prop::array::uniform4(prop::array::uniform3(-0.2..0.2f64)),
        ) {
            let touches = arms.map(|arm| Touch { arm: arm.into(), normal: Vector3::z() });
            let map = soft_fingers(&touches);
            let null = null_space(&map);
            prop_assert_eq!(null.shape(), (16, 10));
            prop_assert!((&map * &null).amax() < 1e-12);
            prop_assert!((null.transpose() * &null - DMatrix::identity(10, 10)).amax() < 1e-12);
        }

        #[test]
        fn work_is_the_same_at_the_contacts_and_at_the_head(
            arm in prop::array::uniform3(-0.2..0.2f64),
            twist in prop::array::uniform6(-1.0..1.0f64),
            force in prop::array::uniform4(-1.0..1.0f64),
        ) {
            let touch = Touch { arm: arm.into(), normal: Vector3::new(0.6, 0.0, 0.8) };
            let (twist, force) = (Vector6::from(twist), nalgebra::Vector4::from(force));
            let map = soft_finger(&touch);
            let velocity = contact_jacobian(&touch.arm) * twist;
            let (v, w) = (velocity.fixed_rows::<3>(0), velocity.fixed_rows::<3>(3));
            let at_contact = v.dot(&force.fixed_rows::<3>(0)) + force[3] * touch.normal.dot(&w);
            prop_assert!((twist.dot(&(map * force)) - at_contact).abs() < 1e-12);
        }
    }

    #[test]
    fn rows_that_say_the_same_count_once() {
        let map =
            DMatrix::from_row_slice(3, 4, &[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0]);
        assert_eq!(null_space(&map).shape(), (4, 2));
    }

    #[test]
    fn least_forces_make_the_wrench_and_nothing_beside_it() {
        let arms = [[0.08, 0.0, 0.01], [-0.07, 0.02, 0.0], [0.0, 0.06, 0.05], [0.01, -0.03, -0.08]];
        let touches = arms.map(|arm| Touch { arm: arm.into(), normal: Vector3::new(0.0, 0.6, 0.8) });
        let map = soft_fingers(&touches);
        let wrench = Vector6::new(3.0, -2.0, 40.0, 0.5, 0.2, -0.3);
        let forces = least_forces(&map, &wrench).unwrap();
        let made = &map * &forces;
        assert!((0..6).all(|i| (made[i] - wrench[i]).abs() < 1e-10), "{made}");
        assert!((null_space(&map).transpose() * &forces).amax() < 1e-10);
    }
}
