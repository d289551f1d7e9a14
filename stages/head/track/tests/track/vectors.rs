//! (4.21)-(4.22) against the vectors of SCIENCE E1.

use nalgebra::Vector3;
use proptest::prelude::*;
use serde_json::Value;
use stillpoint_track::quaternion::{PairsError, pose_of_pairs};

const VECTORS: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/e_pose_quaternion.json"));

fn points(value: &Value) -> Vec<Vector3<f64>> {
    let point = |p: &Value| Vector3::from_fn(|i, _| p[i].as_f64().unwrap());
    value.as_array().unwrap().iter().map(point).collect()
}

#[test]
fn quaternion_translation_and_gap_are_those_of_the_vectors() {
    let vectors: Value = serde_json::from_str(VECTORS).unwrap();
    let cases = vectors["cases"].as_array().unwrap();
    assert!(!cases.is_empty());
    for case in cases {
        let (rel, abs) = (case["tol"]["rel"].as_f64().unwrap(), case["tol"]["abs"].as_f64().unwrap());
        let close = |what: &str, found: f64, expected: &Value| {
            let expected = expected.as_f64().unwrap();
            let near = (found - expected).abs() <= abs + rel * expected.abs();
            assert!(near, "{} {what}: {found} is not {expected}", case["id"]);
        };
        let (input, out) = (&case["in"], &case["out"]);
        let found = pose_of_pairs(&points(&input["P_measured"]), &points(&input["X_model"])).unwrap();
        let q = found.model_from_measured.rotation.quaternion();
        for (i, component) in [q.w, q.i, q.j, q.k].into_iter().enumerate() {
            close("q", component, &out["q_wxyz"][i]);
        }
        let r = found.model_from_measured.rotation.to_rotation_matrix();
        for i in 0..3 {
            close("t", found.model_from_measured.translation.vector[i], &out["t"][i]);
            for j in 0..3 {
                close("R", r[(i, j)], &out["R"][i][j]);
            }
        }
        close("gap", found.gap, &out["eig_gap"]);
    }
}

#[test]
fn pairs_that_determine_no_pose_are_refused_with_the_reason() {
    let p = |x: f64, y: f64| Vector3::new(x, y, 0.0);
    let triangle = [p(0.0, 0.0), p(1.0, 0.0), p(0.0, 1.0)];
    let refused = |a: &[Vector3<f64>], b: &[Vector3<f64>]| pose_of_pairs(a, b).unwrap_err();
    assert_eq!(refused(&triangle, &triangle[..2]), PairsError::Unpaired { measured: 3, model: 2 });
    assert_eq!(refused(&triangle[..2], &triangle[..2]), PairsError::TooFew { found: 2 });
    let hole = [p(0.0, 0.0), p(f64::NAN, 0.0), p(0.0, 1.0)];
    assert_eq!(refused(&hole, &triangle), PairsError::NotFinite { pair: 1 });
    let line = [p(0.0, 0.0), p(1.0, 1.0), p(2.0, 2.0)];
    assert!(matches!(refused(&line, &line), PairsError::Undetermined { .. }));
}

proptest! {
    #[test]
    fn a_rigid_motion_of_three_points_is_recovered(
        corners in prop::array::uniform3(prop::array::uniform3(-0.2..0.2f64)),
        turn in prop::array::uniform3(-3.0..3.0f64), shift in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let points = corners.map(Vector3::from);
        prop_assume!((points[1] - points[0]).cross(&(points[2] - points[0])).norm() > 1e-3);
        let motion = nalgebra::Isometry3::new(Vector3::from(shift), Vector3::from(turn));
        let moved = points.map(|p| motion * nalgebra::Point3::from(p)).map(|p| p.coords);
        let found = pose_of_pairs(&points, &moved).unwrap();
        prop_assert!((found.model_from_measured.translation.vector - motion.translation.vector).norm() < 1e-9);
        prop_assert!(found.model_from_measured.rotation.angle_to(&motion.rotation) < 1e-7);
        prop_assert!(found.rms < 1e-9);
    }
}
