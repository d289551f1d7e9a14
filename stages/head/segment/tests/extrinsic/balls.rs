//! Cameras placed by balls, in rendered images with the errors of real cameras.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{NoiseModel, NoiseParams};
use stillpoint_rig::patient::view::{KINECT_V2, Kind, STRUCTURED};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::{Form, Label, Object, Scene};
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_rig::shape::Ellipsoid;
use stillpoint_segment::extrinsic::{
    Ball, DepthScale, ExtrinsicError, Limits, Placed, Still, StillImages, Targets, at_and_rotation,
    depth_scale, place,
};

/// Centres in mm over the couch and a diameter in mm.
const BALLS: [[f64; 4]; 3] =
    [[-110.0, -60.0, 30.0, 60.0], [120.0, -20.0, 30.0, 60.0], [-60.0, 150.0, 30.0, 60.0]];

fn balls(of: &[[f64; 4]]) -> Vec<Ball> {
    of.iter().map(|[x, y, z, d]| Ball { at: Vector3::new(*x, *y, *z) * 1e-3, diameter: d * 1e-3 }).collect()
}

fn targets() -> Targets {
    Targets::new(balls(&BALLS)).unwrap()
}

pub fn scene(of: &[[f64; 4]]) -> Scene {
    let mut scene = Scene::bare_couch().unwrap();
    scene.add(of.iter().map(|[x, y, z, d]| {
        let at = Translation3::new(x * 1e-3, y * 1e-3, z * 1e-3);
        let shape = Ellipsoid::new(at.into(), Vector3::repeat(0.5e-3 * d)).unwrap();
        Object { label: Label::Clutter, form: Form::Ellipsoid(shape) }
    }));
    scene
}

/// A camera that looks from a place (m) at the couch, turned about its axis.
fn camera(from: [f64; 3], turn: f64) -> Isometry3<f64> {
    let from = Vector3::from(from);
    let z = (Vector3::new(0.0, 0.02, 0.03) - from).normalize();
    let x = Vector3::new(libm::cos(turn), libm::sin(turn), 0.0);
    let y = z.cross(&x).normalize();
    let axes = nalgebra::Matrix3::from_columns(&[y.cross(&z), y, z]);
    Isometry3::from_parts(
        from.into(),
        UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(axes)),
    )
}

/// The images of a scene, in the camera's own unit times `unit`.
pub fn images(
    kind: &Kind,
    noise: NoiseParams,
    at: &Isometry3<f64>,
    scene: &Scene,
    count: u64,
    unit: f64,
) -> Still {
    let [width, height] = kind.size;
    let pinhole = kind.pinhole().unwrap();
    // The head is out of view.
    let away = Isometry3::translation(0.0, 0.0, -50.0);
    let mut renderer = Renderer::new(pinhole, at, scene, Head::new(1.0).unwrap()).unwrap();
    let view = renderer.render(&away).unwrap();
    let mut sensor = DepthSensor::new(&pinhole, NoiseModel::new(noise).unwrap());
    let mut depth = vec![0; pinhole.pixels()];
    let mut images = StillImages::default();
    for seed in 0..count {
        sensor.sense(view, &mut ChaCha8Rng::seed_from_u64(seed), &mut depth).unwrap();
        let (cx, cy) = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
        let ray = |u: usize, v: usize| [(u as f64 - cx) / kind.focal, (v as f64 - cy) / kind.focal];
        let depths = depth.iter().map(|count| f64::from(*count) * 1e-4 * unit);
        images.add_depths([width, height], depths, ray).unwrap();
    }
    images.still().unwrap()
}

/// Distance in mm at the couch's origin, and angle in degrees.
fn off(placed: &Placed, truth: &Isometry3<f64>) -> (f64, f64) {
    let camera_from_couch = truth.inverse();
    let origin = camera_from_couch * Point3::origin();
    let there = placed.couch_from_camera * origin;
    (1e3 * there.coords.norm(), placed.couch_from_camera.rotation.angle_to(&truth.rotation).to_degrees())
}

#[test]
fn a_camera_is_placed_to_a_fifth_of_a_millimetre_and_a_twentieth_of_a_degree() {
    let scene = scene(&BALLS);
    for (kind, from, turn) in [
        (&STRUCTURED, [0.0, -0.48, 0.62], 0.0),
        (&STRUCTURED, [0.3, 0.1, 0.65], 1.2),
        (&KINECT_V2, [0.0, -0.35, 0.6], 0.0),
    ] {
        let truth = camera(from, turn);
        let still = images(kind, (kind.noise)(), &truth, &scene, 20, 1.0);
        let placed =
            place(&still, &targets(), Limits::default()).unwrap_or_else(|fault| panic!("{from:?}: {fault}"));
        let (mm, deg) = off(&placed, &truth);
        assert!(mm < 0.2 && deg < 0.05, "{from:?}: {mm} mm, {deg} degrees");
        assert!(placed.residual() < 0.3e-3 && placed.scale.abs() < 2e-3, "{from:?}: {placed:?}");
        let surface = placed.surface.unwrap();
        assert!(surface.height.abs() < 0.5e-3 && surface.tilt.to_degrees() < 0.1, "{surface:?}");
        assert!(placed.error.sum() < 0.6e-3 && placed.error.stated == 0.0, "{from:?}: {:?}", placed.error);
        // As `frames:` writes it, it is the same transform.
        let ([x, y, z], [rx, ry, rz]) = at_and_rotation(&placed.couch_from_camera);
        let back =
            Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(rx, ry, rz));
        assert!(back.rotation.angle_to(&placed.couch_from_camera.rotation) < 1e-12);
    }
}

/// A structured light camera and what it refuses.
fn fault(of: &[[f64; 4]], targets: &Targets, unit: f64) -> ExtrinsicError {
    let truth = camera([0.0, -0.48, 0.62], 0.0);
    let still = images(&STRUCTURED, (STRUCTURED.noise)(), &truth, &scene(of), 5, unit);
    place(&still, targets, Limits::default()).unwrap_err()
}

#[test]
fn what_does_not_determine_a_place_is_refused() {
    let missing = fault(&BALLS[..2], &targets(), 1.0);
    assert!(matches!(missing, ExtrinsicError::Missing { found: 2, expected: 3, .. }), "{missing}");
    // Couch without balls.
    let none = fault(&[], &targets(), 1.0);
    assert!(matches!(none, ExtrinsicError::Missing { found: 0, .. }), "{none}");
    // x and y are exchanged in all places: a mirror image.
    let mirrored = BALLS.map(|[x, y, z, d]| [y, x, z, d]);
    let mirrored = fault(&BALLS, &Targets::new(balls(&mirrored)).unwrap(), 1.0);
    assert!(matches!(mirrored, ExtrinsicError::Mirrored { .. }), "{mirrored}");
    // One ball stands 25 mm from its place.
    let mut moved = BALLS;
    moved[1][0] += 25.0;
    let moved = fault(&moved, &targets(), 1.0);
    assert!(matches!(moved, ExtrinsicError::Distances { .. }), "{moved}");
    // And here so that the distances keep their mean.
    let mut moved = BALLS;
    moved[2][0] += 5.7;
    moved[2][1] += 1.7;
    let moved = fault(&moved, &targets(), 1.0);
    assert!(matches!(moved, ExtrinsicError::Residual { .. }), "{moved}");
    // All heights are given 10 mm too high.
    let high = BALLS.map(|[x, y, z, d]| [x, y, z + 10.0, d]);
    let high = fault(&BALLS, &Targets::new(balls(&high)).unwrap(), 1.0);
    assert!(matches!(high, ExtrinsicError::Surface { .. }), "{high}");
    // One height is given 1.2 mm too high, which leaves no residual at three balls.
    let mut tilted = BALLS;
    tilted[2][2] += 1.2;
    let tilted = fault(&BALLS, &Targets::new(balls(&tilted)).unwrap(), 1.0);
    assert!(matches!(tilted, ExtrinsicError::Surface { .. }), "{tilted}");
    // Depths are 0.6 % too large.
    let scaled = fault(&BALLS, &targets(), 1.006);
    assert!(matches!(scaled, ExtrinsicError::Scale { off, .. } if (off - 0.6).abs() < 0.1), "{scaled}");
    // Depths are 15 % too large.
    let scaled = fault(&BALLS, &targets(), 1.15);
    assert!(matches!(scaled, ExtrinsicError::Missing { .. } | ExtrinsicError::Distances { .. }), "{scaled}");
}

#[test]
fn the_residual_has_what_three_balls_do_not_show() {
    let truth = camera([0.0, -0.48, 0.62], 0.0);
    let still = |unit: f64| images(&STRUCTURED, NoiseParams::exact(), &truth, &scene(&BALLS), 1, unit);
    let placed = |unit: f64, targets: &Targets, limits: Limits| {
        place(&still(unit), targets, limits).unwrap_or_else(|fault| panic!("{unit}: {fault}"))
    };
    // A point of a head as such a camera measures it.
    let off_at_head = |placed: &Placed, unit: f64| {
        let head = Point3::new(0.0, 0.0, 0.15);
        (placed.couch_from_camera * ((truth.inverse() * head) * unit) - head).norm()
    };
    let exact = placed(1.0, &targets(), Limits::default());
    assert!(exact.error.sum() < 0.1e-3, "{:?}", exact.error);
    // A height that is stated 0.5 mm too high: balls do not show it, the couch does.
    let mut high = BALLS;
    high[2][2] += 0.5;
    let high = Targets::new(balls(&high)).unwrap();
    let tilted = placed(1.0, &high, Limits::default());
    let off = off_at_head(&tilted, 1.0);
    assert!(tilted.error.balls < 0.05e-3 && off > 0.3e-3, "{off} {:?}", tilted.error);
    assert!(tilted.error.sum() > 0.9 * off && tilted.error.sum() < 3.0 * off, "{off} {:?}", tilted.error);
    // Without the couch, what stated places allow is in it.
    let without = placed(1.0, &high, Limits { surface: None, ..Limits::default() });
    assert!(without.error.stated > off && without.error.stated < 1e-3, "{off} {:?}", without.error);
    // Depths that are 0.25 % too large.
    let scaled = placed(1.0025, &targets(), Limits::default());
    let off = off_at_head(&scaled, 1.0025);
    assert!(
        scaled.error.scale > 0.3e-3 && scaled.error.sum() > off && off > 0.2e-3,
        "{off} {:?}",
        scaled.error
    );
}

#[test]
fn twelve_balls_are_matched_and_a_missing_one_is_named() {
    let jitter = [
        [0, 9],
        [-12, 3],
        [7, -8],
        [14, 5],
        [-6, 12],
        [3, -14],
        [11, 1],
        [-9, -5],
        [5, 13],
        [-14, -2],
        [8, 6],
        [1, -11],
    ];
    let places: Vec<[f64; 4]> = (0..12)
        .zip(jitter)
        .map(|(i, [x, y])| {
            let (column, row) = (f64::from(i % 4), f64::from(i / 4));
            [95.0 * column - 140.0 + f64::from(x), 95.0 * row - 90.0 + f64::from(y), 20.0, 40.0]
        })
        .collect();
    let truth = camera([0.0, -0.48, 0.62], 0.0);
    let still = |of: &[[f64; 4]]| images(&STRUCTURED, NoiseParams::exact(), &truth, &scene(of), 1, 1.0);
    let targets = Targets::new(balls(&places)).unwrap();
    let placed =
        place(&still(&places), &targets, Limits::default()).unwrap_or_else(|fault| panic!("{fault}"));
    assert!(off(&placed, &truth).0 < 0.1 && placed.balls.len() == 12);
    let fault = place(&still(&places[..11]), &targets, Limits::default()).unwrap_err();
    assert!(matches!(fault, ExtrinsicError::Missing { found: 11, expected: 12, .. }), "{fault}");
    // One of them is 40 mm from its place.
    let mut moved = places.clone();
    moved[11][0] += 40.0;
    let fault = place(&still(&moved), &targets, Limits::default()).unwrap_err();
    assert!(matches!(fault, ExtrinsicError::Distances { .. }), "{fault}");
}

#[test]
fn balls_that_can_be_exchanged_or_are_in_line_are_refused() {
    let of = |places: &[[f64; 4]]| Targets::new(balls(places)).unwrap_err();
    assert!(matches!(of(&BALLS[..2]), ExtrinsicError::FewTargets { found: 2 }));
    // Two sides of one length.
    let alike = [[-100.0, 0.0, 30.0, 60.0], [100.0, 0.0, 30.0, 60.0], [0.0, 150.0, 30.0, 60.0]];
    assert_eq!(of(&alike), ExtrinsicError::Alike { most_mm: 12.0 });
    // With another diameter at one end, it is determined.
    let mut other = alike;
    other[0][3] = 40.0;
    Targets::new(balls(&other)).unwrap();
    let line = [[-100.0, 0.0, 30.0, 60.0], [0.0, 10.0, 30.0, 60.0], [150.0, 0.0, 30.0, 60.0]];
    assert!(matches!(of(&line), ExtrinsicError::InLine { .. }));
    let mut huge = BALLS;
    huge[2][3] = 600.0;
    assert!(matches!(of(&huge), ExtrinsicError::Target { ball: 3, what: "diameter", .. }));
    let mut nan = BALLS;
    nan[0][1] = f64::NAN;
    assert!(matches!(of(&nan), ExtrinsicError::Target { ball: 1, what: "y", .. }));
}

#[test]
fn a_plate_at_two_distances_gives_the_unit_of_the_depth() {
    let couch = Scene::bare_couch().unwrap();
    let at = |height: f64, unit: f64| {
        let truth = camera([0.0, 0.019, height], 0.0);
        images(&STRUCTURED, (STRUCTURED.noise)(), &truth, &couch, 5, unit)
    };
    let compared = |unit: f64| -> DepthScale { depth_scale(&at(0.5, unit), &at(0.7, unit), 0.2).unwrap() };
    let right = compared(1.0);
    assert!(right.scale.abs() < 1e-3 && right.rms[0] < 0.3e-3 && right.bowl[1].abs() < 0.1e-3, "{right:?}");
    let wrong = compared(1.02);
    assert!((wrong.scale - 0.02).abs() < 1e-3, "{wrong:?}");
    // The axis of the camera may be a little off the normal of the plate: its way along the axis counts.
    let along = |distance: f64, tilt: f64| {
        let tilt = f64::to_radians(tilt);
        let from = [distance * libm::sin(tilt), 0.02, 0.03 + distance * libm::cos(tilt)];
        images(&STRUCTURED, NoiseParams::exact(), &camera(from, 0.0), &couch, 1, 1.0)
    };
    let tilted = depth_scale(&along(0.45, 2.8), &along(0.65, 2.8), 0.2).unwrap();
    assert!(tilted.scale.abs() < 5e-4 && (tilted.tilts[1].to_degrees() - 2.8).abs() < 0.05, "{tilted:?}");
    let fault = depth_scale(&along(0.45, 6.0), &along(0.65, 6.0), 0.2).unwrap_err();
    assert!(matches!(fault, ExtrinsicError::Tilted { which: "first", .. }), "{fault}");
    let fault = depth_scale(&at(0.7, 1.0), &at(0.5, 1.0), 0.2).unwrap_err();
    assert!(matches!(fault, ExtrinsicError::Exchanged { by_mm } if (by_mm - 200.0).abs() < 1.0), "{fault}");
    // Past the edge of the couch there is no plate.
    let truth = camera([0.0, 0.019, 2.4], 0.0);
    let far = images(&STRUCTURED, NoiseParams::exact(), &truth, &couch, 1, 1.0);
    assert!(matches!(
        depth_scale(&at(0.5, 1.0), &far, 1.9),
        Err(ExtrinsicError::NoPlate { which: "second", .. })
    ));
}

#[test]
fn images_of_two_sizes_and_lists_of_points_are_refused() {
    let mut images = StillImages::default();
    assert_eq!(images.still().unwrap_err(), ExtrinsicError::NoImage);
    images.add_cloud([4, 3], vec![[0.0, 0.0, 1.0]; 12]).unwrap();
    assert!(matches!(
        images.add_cloud([3, 4], vec![[0.0; 3]; 12]),
        Err(ExtrinsicError::Size { image: 2, .. })
    ));
    let pixels = images.add_depths([4, 3], vec![1.0; 11], |_, _| [0.0; 2]);
    assert_eq!(pixels, Err(ExtrinsicError::Pixels { image: 2, found: 11, size: [4, 3] }));
    assert!(matches!(images.add_cloud([12, 1], vec![[0.0; 3]; 12]), Err(ExtrinsicError::Unorganised { .. })));
}

#[test]
fn strange_images_have_no_balls() {
    for (depth, ray) in
        [(f64::NAN, 0.001), (1e300, 0.001), (1.0, f64::NAN), (1.0, 1e30), (0.0, 0.0), (1.0, 0.0)]
    {
        let mut images = StillImages::default();
        images.add_depths([64, 48], vec![depth; 64 * 48], |u, v| [ray * u as f64, ray * v as f64]).unwrap();
        let found = place(&images.still().unwrap(), &targets(), Limits::default());
        assert!(matches!(found, Err(ExtrinsicError::Missing { found: 0, .. })), "{depth} {ray}: {found:?}");
    }
}
