//! Cameras placed by the edges of a bare couch, in rendered depth images.

use nalgebra::{Isometry3, Point3, Vector3};
use stillpoint_rig::patient::view::{KINECT_V2, Kind, STRUCTURED, look};
use stillpoint_rig::scene::{Form, Label, Object, Scene};
use stillpoint_rig::shape::Cuboid;
use stillpoint_segment::extrinsic::edges::{Couch, EdgeError, EdgePlace, place_by_edges};

use crate::balls::{images, scene};

/// A camera over the head end.
const OVER: [f64; 3] = [0.05, -0.1, 0.75];

/// The couch of the rig is 530 mm wide and ends at y = 350 mm.
fn couch() -> Couch {
    Couch::new(0.53, 0.35).unwrap()
}

fn camera(from: [f64; 3], turn: f64) -> Isometry3<f64> {
    look(Vector3::from(from), Vector3::new(0.0, 0.12, 0.0), turn)
}

/// Distance in mm at the middle of a head, and angle in degrees.
fn off(placed: &EdgePlace, truth: &Isometry3<f64>) -> (f64, f64) {
    let head = Point3::new(0.0, 0.0, 0.15);
    let there = placed.couch_from_camera * (truth.inverse() * head);
    (1e3 * (there - head).norm(), placed.couch_from_camera.rotation.angle_to(&truth.rotation).to_degrees())
}

fn placed(kind: &Kind, at: &Isometry3<f64>, scene: &Scene, couch: &Couch) -> Result<EdgePlace, EdgeError> {
    place_by_edges(&images(kind, (kind.noise)(), at, scene, 9, 1.0), couch)
}

#[test]
fn a_turned_camera_is_placed_to_a_fifth_of_a_millimetre_and_a_twentieth_of_a_degree() {
    let bare = scene(&[]);
    for kind in [&STRUCTURED, &KINECT_V2] {
        let mut worst: (f64, f64) = (0.0, 0.0);
        for trial in 0..20 {
            let step = f64::from(trial);
            let from = [0.02 * (step % 5.0) - 0.04, -0.2 + 0.06 * (step % 4.0), 0.7 + 0.005 * step];
            let truth = camera(from, 0.07 + 0.004 * step);
            let placed =
                placed(kind, &truth, &bare, &couch()).unwrap_or_else(|fault| panic!("{from:?}: {fault}"));
            let (mm, deg) = off(&placed, &truth);
            worst = (worst.0.max(mm), worst.1.max(deg));
            assert!(
                mm < 1e3 * placed.error.sum() && placed.error.sum() < 2.5e-3,
                "{from:?}: {mm} {placed:?}"
            );
        }
        println!("{}: {:.3} mm, {:.4} degrees", kind.name, worst.0, worst.1);
        assert!(worst.0 < 0.2 && worst.1 < 0.05, "{}: {worst:?}", kind.name);
    }
}

#[test]
fn an_edge_along_a_row_of_pixels_is_within_the_residual() {
    let bare = scene(&[]);
    for kind in [&STRUCTURED, &KINECT_V2] {
        let mut worst: (f64, f64) = (0.0, 0.0);
        for trial in 0..20 {
            let truth = camera([0.0, 0.0, 0.76 + 0.002 * f64::from(trial)], 0.0);
            let placed =
                placed(kind, &truth, &bare, &couch()).unwrap_or_else(|fault| panic!("{trial}: {fault}"));
            let (mm, deg) = off(&placed, &truth);
            worst = (worst.0.max(mm), worst.1.max(deg));
            assert!(mm < 1e3 * placed.error.sum(), "{trial}: {mm} {placed:?}");
        }
        println!("{}: {:.3} mm, {:.4} degrees", kind.name, worst.0, worst.1);
        assert!(worst.0 > 0.2, "the bound could be held here, too: {worst:?}");
    }
}

/// A couch of boxes: places along x and y of their sides, m.
fn of_boxes(boxes: &[[f64; 4]]) -> Scene {
    let top = |[left, right, foot, head]: &[f64; 4]| {
        let middle = Isometry3::translation(0.5 * (left + right), 0.5 * (foot + head), -0.03);
        let half = Vector3::new(0.5 * (right - left), 0.5 * (head - foot), 0.03);
        Object { label: Label::Table, form: Form::Cuboid(Cuboid::new(middle, half).unwrap()) }
    };
    Scene::new(boxes.iter().map(top).collect(), -0.85)
}

#[test]
fn a_couch_whose_edges_are_hidden_bent_or_others_is_refused() {
    let fault = |at: &Isometry3<f64>, scene: &Scene, couch: &Couch| {
        placed(&STRUCTURED, at, scene, couch).unwrap_err()
    };
    let over = camera(OVER, 0.1);
    let bare = scene(&[]);
    placed(&STRUCTURED, &over, &bare, &couch()).unwrap();
    // From over the chest, the head end is out of view.
    let chest = look(Vector3::new(0.0, -0.5, 0.75), Vector3::new(0.0, -0.5, 0.0), 0.1);
    let no_end = fault(&chest, &bare, &couch());
    assert!(matches!(no_end, EdgeError::NoEnd { .. }), "{no_end}");
    // From near, one side is out of view.
    let near = look(Vector3::new(0.2, 0.1, 0.45), Vector3::new(0.2, 0.12, 0.0), 0.1);
    let no_side = fault(&near, &bare, &couch());
    assert!(matches!(no_side, EdgeError::NoSides { .. }), "{no_side}");
    // The stated width is 10 mm too large, and far too large.
    let wide = fault(&over, &bare, &Couch::new(0.54, 0.35).unwrap());
    assert!(matches!(wide, EdgeError::Width { found_mm, .. } if (found_mm - 530.0).abs() < 3.0), "{wide}");
    let other = fault(&over, &bare, &Couch::new(0.45, 0.35).unwrap());
    assert!(matches!(other, EdgeError::NoSides { .. }), "{other}");
    // One side has a step of 5 mm in the middle of what is seen.
    let step = of_boxes(&[[-0.265, 0.265, -1.65, 0.1], [-0.265, 0.26, 0.1, 0.35]]);
    let bent = fault(&over, &step, &couch());
    assert!(matches!(bent, EdgeError::Bent { .. } | EdgeError::Steps { .. }), "{bent}");
    // A board for the head that is narrower than the couch.
    let narrow = of_boxes(&[[-0.265, 0.265, -1.65, 0.0], [-0.13, 0.13, 0.0, 0.35]]);
    let narrow = fault(&over, &narrow, &couch());
    assert!(matches!(narrow, EdgeError::NoEnd { .. }), "{narrow}");
    let short = of_boxes(&[[-0.265, 0.265, -0.05, 0.35]]);
    let both = fault(&over, &short, &couch());
    assert!(matches!(both, EdgeError::TwoEnds), "{both}");
    let none = fault(&look(Vector3::new(0.5, 0.5, 0.5), Vector3::new(0.4, 0.4, 0.0), 0.0), &bare, &couch());
    assert!(matches!(none, EdgeError::NoPlane { .. } | EdgeError::NoSides { .. }), "{none}");
    for (width, head_end) in [(f64::NAN, 0.3), (0.53, 5.0), (0.0, 0.3)] {
        assert!(matches!(Couch::new(width, head_end), Err(EdgeError::Range { .. })));
    }
}
