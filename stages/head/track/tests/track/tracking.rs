//! The tracker on bodies whose motion is known.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;
use stillpoint_track::HeadTracker;
use stillpoint_track::surface::SurfaceError;
use stillpoint_track::tracker::{Loss, PoseSource, TrackedPose};

use crate::shapes::{camera_from_body, cylinder, head, sphere};

fn captured(cloud: &[Vector3<f64>]) -> HeadTracker {
    let mut tracker = HeadTracker::default();
    tracker.capture(cloud, 0).unwrap();
    tracker
}

/// A motion about the body's origin: shift in mm, turn in degrees.
fn motion(shift: [f64; 3], turn: [f64; 3]) -> Isometry3<f64> {
    let body = camera_from_body();
    let by = Isometry3::new(Vector3::from(shift) * 1e-3, Vector3::from(turn.map(f64::to_radians)));
    body * by * body.inverse()
}

/// Error of a motion in mm at the body's origin, and in degrees.
fn error(found: &TrackedPose, expected: &Isometry3<f64>) -> (f64, f64) {
    let at = camera_from_body() * nalgebra::Point3::origin();
    let found = found.current_from_reference;
    let mm = (found * at - expected * at).norm() * 1e3;
    (mm, found.rotation.angle_to(&expected.rotation).to_degrees())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn any_motion_of_a_head_is_recovered(
        shift in prop::array::uniform3(-15.0..15.0f64), turn in prop::array::uniform3(-10.0..10.0f64),
    ) {
        let mut tracker = captured(&head(&camera_from_body()));
        let expected = motion(shift, turn);
        let found = tracker.track(&head(&(expected * camera_from_body())), 1).unwrap();
        let (mm, degrees) = error(&found, &expected);
        prop_assert!(mm < 0.1 && degrees < 0.06, "{mm} mm, {degrees} degrees");
        prop_assert_eq!(found.alignment.observability.constrained, 6);
    }

    #[test]
    fn the_order_of_the_points_hardly_matters(seed in any::<u64>()) {
        let reference = head(&camera_from_body());
        let moved = head(&(motion([2.0, -3.0, 4.0], [1.0, 3.0, -2.0]) * camera_from_body()));
        let shuffled = |cloud: &[Vector3<f64>], seed: u64| {
            let mut keyed: Vec<_> = cloud.iter().enumerate().map(|(i, p)| {
                ((i as u64 ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(31).wrapping_mul(0xbf58_476d_1ce4_e5b9), *p)
            }).collect();
            keyed.sort_by_key(|(key, _)| *key);
            keyed.into_iter().map(|(_, p)| p).collect::<Vec<_>>()
        };
        let straight = captured(&reference).track(&moved, 1).unwrap();
        let other = captured(&shuffled(&reference, seed)).track(&shuffled(&moved, !seed), 1).unwrap();
        let (mm, degrees) = error(&other, &straight.current_from_reference);
        prop_assert!(mm < 0.05 && degrees < 0.03, "{mm} mm, {degrees} degrees");
    }
}

#[test]
fn all_turns_of_a_sphere_are_refused_and_its_place_is_found() {
    let mut tracker = captured(&sphere(&camera_from_body(), 0.09));
    let expected = motion([4.0, -3.0, 5.0], [0.0; 3]);
    let found = tracker.track(&sphere(&(expected * camera_from_body()), 0.09), 1).unwrap();
    let observability = found.alignment.observability;
    assert_eq!(observability.constrained, 3, "{:?}", observability.sensitivity);
    for refused in 3..6 {
        let direction = observability.directions.column(refused);
        assert!(direction.rows(0, 3).norm() < 0.05, "{direction}");
        assert!((found.alignment.covariance * direction).norm() < 1e-20);
    }
    let (mm, degrees) = error(&found, &expected);
    assert!(mm < 0.1, "{mm} mm");
    // What nothing constrains keeps its last value, but for what the eigenvectors mix.
    assert!(degrees < 0.02, "{degrees} degrees");
    let centre = tracker.surface().unwrap().centre() - Vector3::new(0.0, 0.0, 0.7);
    assert!(centre.norm() < 1e-3, "{centre}");
}

#[test]
fn noise_does_not_make_a_spheres_turns_known() {
    for sd in [0.3e-3, 1.2e-3] {
        let noisy = |pose: &Isometry3<f64>, seed: u64| {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut cloud = sphere(pose, 0.09);
            for point in &mut cloud {
                let noise: f64 = (0..12).map(|_| unit(&mut random)).sum::<f64>() - 6.0;
                *point *= 1.0 + sd * noise / point.norm();
            }
            cloud
        };
        let mut tracker = captured(&noisy(&camera_from_body(), 1));
        let expected = motion([1.0, -2.0, 1.0], [0.0; 3]);
        let found = tracker.track(&noisy(&(expected * camera_from_body()), 2), 1).unwrap();
        let observability = found.alignment.observability;
        assert_eq!(observability.constrained, 3, "{sd} m: {:?}", observability.sensitivity);
    }
}

/// A number from 0 to 1.
fn unit(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

#[test]
fn a_cylinders_axis_is_refused_along_and_around() {
    let mut tracker = captured(&cylinder(&camera_from_body(), 0.08));
    let expected = motion([4.0, 0.0, 5.0], [3.0, 0.0, 2.0]);
    let found = tracker.track(&cylinder(&(expected * camera_from_body()), 0.08), 1).unwrap();
    let observability = found.alignment.observability;
    assert_eq!(observability.constrained, 4, "{:?}", observability.sensitivity);
    for refused in 4..6 {
        let direction = observability.directions.column(refused);
        let on_axis = direction[1].hypot(direction[4]);
        assert!(on_axis > 0.99, "{direction}");
    }
    let (_, degrees) = error(&found, &expected);
    assert!(degrees < 0.1, "{degrees} degrees");
}

#[test]
fn another_body_is_a_loss_and_the_head_is_found_again() {
    let mut tracker = captured(&head(&camera_from_body()));
    let aside = Isometry3::translation(0.05, -0.02, 0.1) * camera_from_body();
    let loss = tracker.track(&sphere(&aside, 0.04), 1).unwrap_err();
    assert!(matches!(loss, Loss::NoFit { .. }), "{loss}");
    let expected = motion([30.0, -20.0, 25.0], [-12.0, 20.0, 15.0]);
    let cloud = head(&(expected * camera_from_body()));
    let found = tracker.track(&cloud, 2).unwrap();
    let (mm, degrees) = error(&found, &expected);
    assert!(mm < 0.15 && degrees < 0.1, "{mm} mm, {degrees} degrees");
    assert_eq!(found.source, PoseSource::Found);
    assert_eq!(tracker.track(&cloud, 3).unwrap().source, PoseSource::Tracked);
}

#[test]
fn without_reference_or_points_there_is_no_pose() {
    let cloud = head(&camera_from_body());
    assert_eq!(HeadTracker::default().track(&cloud, 1).unwrap_err(), Loss::NoReference);
    let mut tracker = captured(&cloud);
    let few = tracker.track(&cloud[..499], 1).unwrap_err();
    assert_eq!(few, Loss::TooFewPoints { found: 499, needed: 500 });
    assert_eq!(tracker.track(&cloud, 2).unwrap().source, PoseSource::Found);
}

#[test]
fn what_is_no_head_makes_no_reference_and_the_old_one_stays() {
    let cloud = head(&camera_from_body());
    let mut tracker = captured(&cloud);
    let wall: Vec<_> = (0..4000).map(|i| Vector3::new(f64::from(i) * 1e-3, 0.0, 1.0)).collect();
    assert!(matches!(tracker.capture(&wall, 1).unwrap_err(), SurfaceError::TooLarge { .. }));
    assert!(matches!(tracker.capture(&cloud[..100], 1).unwrap_err(), SurfaceError::TooLittle { .. }));
    assert!(matches!(tracker.capture(&[], 1).unwrap_err(), SurfaceError::TooLittle { .. }));
    assert!(tracker.track(&cloud, 2).is_ok());
}

#[test]
fn points_on_one_another_make_no_reference() {
    let same = vec![Vector3::new(0.0, 0.0, 0.7); 5000];
    assert!(matches!(HeadTracker::default().capture(&same, 0).unwrap_err(), SurfaceError::TooLittle { .. }));
}
