//! Claims about what a camera without noise sees.

#![allow(clippy::unwrap_used, reason = "a set-up that fails is a test that fails")]

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use stillpoint_rig::camera::{Pinhole, couch_from_camera};
use stillpoint_rig::head::Head;
use stillpoint_rig::ray::{self, Ray};
use stillpoint_rig::render::{RenderError, Renderer};
use stillpoint_rig::scene::{Label, Scene};
use stillpoint_rig::trajectory::rest_on_pad;
use stillpoint_rig::view::RenderedView;

fn pinhole() -> Pinhole {
    Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 480).unwrap()
}

fn camera_pose() -> Isometry3<f64> {
    couch_from_camera(Vector3::new(0.0, -0.48, 0.59), [45f64.to_radians(), 0.0, 0.0])
}

fn renderer() -> Renderer {
    let scene = Scene::treatment_couch().unwrap();
    Renderer::new(pinhole(), &camera_pose(), &scene, Head::new(1.0).unwrap()).unwrap()
}

fn moved(by: Vector3<f64>) -> Isometry3<f64> {
    let mut pose = rest_on_pad();
    pose.translation.vector += by;
    pose
}

/// Mean column, mean row and number of the head's pixels.
fn silhouette(view: &RenderedView) -> (f64, f64, f64) {
    let (mut columns, mut rows, mut count) = (0.0, 0.0, 0.0);
    for (pixel, &label) in view.label().iter().enumerate() {
        if label == Label::Head as u8 {
            columns += (pixel % view.width()) as f64;
            rows += (pixel / view.width()) as f64;
            count += 1.0;
        }
    }
    (columns / count, rows / count, count)
}

#[test]
fn every_pixel_shows_what_its_own_ray_meets_first() {
    let pose = moved(Vector3::new(0.01, 0.02, 0.005));
    let (scene, head) = (Scene::treatment_couch().unwrap(), Head::new(1.0).unwrap());
    let mut renderer = renderer();
    let view = renderer.render(&pose).unwrap();
    for pixel in (0..view.label().len()).step_by(7) {
        let direction = pinhole().direction(pixel % 640, pixel / 640);
        let origin = Point3::from(camera_pose().translation.vector);
        let ray = Ray { origin, direction: camera_pose().transform_vector(&direction) };
        let in_head = Ray {
            origin: pose.inverse_transform_point(&ray.origin),
            direction: pose.inverse_transform_vector(&ray.direction),
        };
        let mut expected = scene.first_hit(&ray);
        for part in head.parts() {
            if let Some(hit) = ray::ellipsoid(&in_head, part)
                && expected.is_none_or(|(nearest, _)| hit.t < nearest.t)
            {
                expected = Some((hit, Label::Head));
            }
        }
        let (hit, label) = expected.unwrap();
        // At a silhouette rounding may decide either way; a single precision depth is good to 6e-8 of itself.
        if hit.cosine > 1e-3 {
            assert!((f64::from(view.depth_m()[pixel]) - hit.t).abs() < 1e-7 * hit.t, "pixel {pixel}");
            assert_eq!(view.label()[pixel], label as u8, "pixel {pixel}");
            assert!((f64::from(view.cosine()[pixel]) - hit.cosine).abs() < 1e-4, "pixel {pixel}");
        }
    }
}

#[test]
fn the_head_couch_pads_and_clutter_are_all_in_sight() {
    let mut renderer = renderer();
    let view = renderer.render(&rest_on_pad()).unwrap();
    for label in [Label::Background, Label::Table, Label::Pad, Label::Clutter, Label::Head] {
        let count = view.label().iter().filter(|&&found| found == label as u8).count();
        assert!(count > 3000, "{label:?}: {count}");
    }
}

#[test]
fn the_silhouette_moves_with_the_head() {
    let mut renderer = renderer();
    let (column, row, count) = silhouette(renderer.render(&rest_on_pad()).unwrap());
    let (to_left, ..) = silhouette(renderer.render(&moved(Vector3::new(0.01, 0.0, 0.0))).unwrap());
    let (_, to_crown, _) = silhouette(renderer.render(&moved(Vector3::new(0.0, 0.01, 0.0))).unwrap());
    let (.., nearer) = silhouette(renderer.render(&moved(Vector3::new(0.0, -0.03, 0.03))).unwrap());
    // 10 mm at 0.6 m and 566 px are 9.4 px; along the couch, seen at 45 degrees, two thirds of it.
    assert!((8.0..11.0).contains(&(to_left - column)), "{}", to_left - column);
    assert!((5.0..8.0).contains(&(row - to_crown)), "{}", row - to_crown);
    assert!(nearer > 1.05 * count, "{nearer} {count}");
}

#[test]
fn a_turn_of_one_degree_about_any_axis_is_seen() {
    let mut renderer = renderer();
    let before = renderer.render(&rest_on_pad()).unwrap().clone();
    for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
        let turn = UnitQuaternion::from_axis_angle(&axis, 1f64.to_radians());
        let pose = Isometry3::from_parts(rest_on_pad().translation, turn);
        let view = renderer.render(&pose).unwrap();
        let head = |pixel: &usize| view.label()[*pixel] == 4 && before.label()[*pixel] == 4;
        let changed = (0..before.label().len())
            .filter(head)
            .filter(|&pixel| (view.depth_m()[pixel] - before.depth_m()[pixel]).abs() > 2e-4)
            .count();
        assert!(changed > 3000, "{axis:?}: {changed}");
    }
}

#[test]
fn a_view_does_not_depend_on_the_poses_before_it() {
    let mut used = renderer();
    used.render(&moved(Vector3::new(0.05, -0.03, 0.04))).unwrap();
    used.render(&moved(Vector3::new(9.0, 0.0, 0.0))).unwrap();
    let mut fresh = renderer();
    assert_eq!(used.render(&rest_on_pad()).unwrap(), fresh.render(&rest_on_pad()).unwrap());
}

#[test]
fn a_pose_that_is_not_finite_is_refused_by_name() {
    let error = renderer().render(&moved(Vector3::new(f64::NAN, 0.0, 0.0))).unwrap_err();
    assert!(matches!(error, RenderError::Pose { transform: "couch_from_head", value } if value.is_nan()));
}

#[test]
fn a_head_around_or_behind_the_camera_is_not_drawn() {
    let mut renderer = renderer();
    for at in [Vector3::new(0.0, -0.48, 0.59), Vector3::new(0.0, -2.0, 2.0)] {
        let view = renderer.render(&Isometry3::translation(at.x, at.y, at.z)).unwrap();
        let positive = view.depth_m().iter().all(|&z| z > 0.0);
        assert!(positive, "{at:?}");
    }
}
