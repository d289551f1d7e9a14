//! The forward map from the rates of the bladders to those of the head, through the contacts (3.30)-(3.39).
//!
//! `J xi' = G^T zeta'` (3.38): what a bladder does at its contact is what the head does there. The coordinates of a
//! bladder are its shear in two directions, its height and its twist, so with contact axes in them `J` is a rotation
//! and has an inverse: `xi' = J^-1 G^T zeta' = H zeta'`, and backwards, of the rates that fit best,
//! `zeta' = (H^T H)^-1 H^T xi'` (3.39).

use nalgebra::{Matrix3, Matrix4, SMatrix, SVector, Vector3, Vector4};

use super::grasp::{Touch, soft_finger};
use crate::linear;

/// Two directions across a unit vector: with it a right-handed frame.
pub fn across(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let far = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let first = normal.cross(&far).normalize();
    [first, normal.cross(&first)]
}

/// The grasp map of a soft finger in the axes of its contact: wrench of the forces along both directions of
/// [`across`], of that along the normal, and of the torque about the normal (SCIENCE B8).
pub fn contact_map(touch: &Touch) -> SMatrix<f64, 6, 4> {
    let [first, second] = across(&touch.normal);
    let axes = Matrix3::from_columns(&[first, second, touch.normal]);
    let mut turn = Matrix4::identity();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&axes);
    soft_finger(touch) * turn
}

/// Rates of the bladders' coordinates that a head of these rates makes, `xi' = H zeta'`: shear in two directions and
/// height, m/s, and twist, rad/s. `maps` are the transposes of the bladders' parts of `H`.
pub fn bladder_rates<const D: usize, const B: usize>(
    maps: &[SMatrix<f64, D, 4>; B],
    rate: &SVector<f64, D>,
) -> [Vector4<f64>; B] {
    maps.map(|map| map.transpose() * rate)
}

/// Rates of the head that fit those of the bladders best, torques and forces of the fit in SI units; `None` where the
/// contacts leave a direction open.
pub fn head_rate<const D: usize, const B: usize>(
    maps: &[SMatrix<f64, D, 4>; B],
    bladders: &[Vector4<f64>; B],
) -> Option<SVector<f64, D>> {
    let square: SMatrix<f64, D, D> = maps.iter().map(|map| map * map.transpose()).sum();
    let sum: SVector<f64, D> = maps.iter().zip(bladders).map(|(map, rate)| map * rate).sum();
    linear::solve(square, sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_forward_map_undoes_what_the_head_does_to_its_bladders(
            arms in prop::array::uniform3(prop::array::uniform3(-0.2..0.2f64)),
            normals in prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64)),
            twist in prop::array::uniform6(-1.0..1.0f64),
        ) {
            let normals = normals.map(Vector3::from);
            prop_assume!(normals.iter().all(|n| n.norm() > 0.1));
            let touches: [Touch; 3] =
                core::array::from_fn(|j| Touch { arm: arms[j].into(), normal: normals[j].normalize() });
            let apart = (touches[0].arm - touches[1].arm).cross(&(touches[2].arm - touches[1].arm));
            prop_assume!(apart.norm() > 1e-3);
            let maps = touches.map(|touch| contact_map(&touch));
            let rate = SVector::<f64, 6>::from(twist);
            let found = head_rate(&maps, &bladder_rates(&maps, &rate)).unwrap();
            prop_assert!((found - rate).amax() < 1e-8, "{} {}", found, rate);
            // Height is motion along the normal, twist turning about it.
            let (v, w) = (Vector3::new(twist[0], twist[1], twist[2]), Vector3::new(twist[3], twist[4], twist[5]));
            for (touch, bladder) in touches.iter().zip(bladder_rates(&maps, &rate)) {
                let speed = v + w.cross(&touch.arm);
                prop_assert!((bladder[2] - touch.normal.dot(&speed)).abs() < 1e-12);
                prop_assert!((bladder[3] - touch.normal.dot(&w)).abs() < 1e-12);
                prop_assert!((bladder.xyz().norm() - speed.norm()).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_single_contact_leaves_the_head_free_to_roll() {
        let touch = Touch { arm: Vector3::new(0.0, 0.0, -0.09), normal: Vector3::z() };
        let maps = [contact_map(&touch)];
        assert_eq!(head_rate(&maps, &[Vector4::new(0.0, 0.0, 1.0, 0.0)]), None);
    }
}
