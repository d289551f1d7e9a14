//! `stillpoint calibrate`: a camera by rendered images of three balls, a printed board or the
//! couch's edges.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;
use stillpoint_rig::camera::Pinhole;
use stillpoint_rig::head::Head;
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::{Form, Label, Object, Scene};
use stillpoint_rig::shape::Ellipsoid;
use stillpoint_testing::board::{Camera, Checkerboard, Exposure, light, png, taken};

use crate::{stillpoint, text};

const BALLS: [[f64; 3]; 3] = [[-110.0, -60.0, 30.0], [120.0, -20.0, 30.0], [-60.0, 150.0, 30.0]];
const FOCAL: f64 = 300.0;
const SIZE: [usize; 2] = [320, 240];

/// A depth image in tenths of a millimetre as a PNG.
fn image(path: &Path, couch_from_camera: &Isometry3<f64>, balls: &[[f64; 3]]) {
    let [width, height] = SIZE;
    let (cx, cy) = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
    let pinhole = Pinhole::new(FOCAL, FOCAL, cx, cy, width, height).unwrap();
    let mut scene = Scene::bare_couch().unwrap();
    scene.add(balls.iter().map(|[x, y, z]| {
        let at = Translation3::new(1e-3 * x, 1e-3 * y, 1e-3 * z);
        let shape = Ellipsoid::new(at.into(), Vector3::repeat(0.03)).unwrap();
        Object { label: Label::Clutter, form: Form::Ellipsoid(shape) }
    }));
    let mut renderer = Renderer::new(pinhole, couch_from_camera, &scene, Head::new(1.0).unwrap()).unwrap();
    let view = renderer.render(&Isometry3::translation(0.0, 0.0, -50.0)).unwrap();
    let bytes: Vec<u8> =
        view.depth_m().iter().flat_map(|depth| ((1e4 * depth).round() as u16).to_be_bytes()).collect();
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
}

/// A camera that looks down at the couch.
fn camera(from: [f64; 3]) -> Isometry3<f64> {
    let from = Vector3::from(from);
    let z = (Vector3::new(0.0, 0.03, 0.0) - from).normalize();
    let y = z.cross(&Vector3::x()).normalize();
    let axes = Matrix3::from_columns(&[y.cross(&z), y, z]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(from.into(), turn)
}

/// Records images of a camera at a place, with a pipeline that has this entry of `frames:`.
fn recorded(folder: &Path, name: &str, at: &Isometry3<f64>, balls: &[[f64; 3]], frames: &str) -> String {
    recorded_by(folder, name, at, balls, frames, &["--clock", "simulated"])
}

/// The same by another clock.
fn recorded_by(
    folder: &Path,
    name: &str,
    at: &Isometry3<f64>,
    balls: &[[f64; 3]],
    frames: &str,
    clock: &[&str],
) -> String {
    std::fs::create_dir_all(folder.join(name)).unwrap();
    for number in 0..3 {
        image(&folder.join(name).join(format!("{number}.png")), at, balls);
    }
    let pipeline = format!(
        "stillpoint: 1\nname: {name}\n{frames}\noperators:\n  cloud:\n    use: ingest.depth\n    every: 100 ms\n    frame: camera\n    \
         params:\n      files: '{name}/*.png'\n      camera: {{ fx: {FOCAL} px, fy: {FOCAL} px, cx: 159.5 px, cy: 119.5 px, \
         depth_unit: 0.1 mm }}\n"
    );
    let file = format!("{name}.yaml");
    std::fs::write(folder.join(&file), pipeline).unwrap();
    let all = ["--set", "record.topics=all"];
    let run = stillpoint(folder, &[&["run", &file, "--for", "1s"], clock, &all[..]].concat());
    assert_eq!(run.status.code(), Some(0), "{}{}", text(&run.stdout), text(&run.stderr));
    format!("sessions/{name}-0001")
}

#[test]
fn a_camera_is_placed_its_entry_is_taken_and_drift_and_a_missing_ball_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let truth = camera([0.05, -0.4, 0.6]);
    let anywhere = "frames:\n  camera: { parent: couch, at: [0 mm, 0 mm, 0 mm] }";
    let session = recorded(folder, "first", &truth, &BALLS, anywhere);
    let balls: Vec<String> = BALLS.iter().map(|[x, y, z]| format!("--ball={x},{y},{z},60")).collect();
    let calibrate = |session: &str, more: &[&str]| {
        let mut arguments = vec!["calibrate", "camera", session, "--topic", "cloud.cloud"];
        arguments.extend(balls.iter().map(String::as_str));
        arguments.extend(more);
        stillpoint(folder, &arguments)
    };
    let placed = calibrate(&session, &["--date", "2024-02-28"]);
    let printed = text(&placed.stdout);
    assert_eq!(placed.status.code(), Some(0), "{printed}{}", text(&placed.stderr));
    assert!(
        printed.contains("couch around the balls") && printed.contains("measured: 2024-02-28"),
        "{printed}"
    );
    let entry = &printed[printed.find("frames:").unwrap()..];

    assert!(printed.contains("tilt at a head"), "{printed}");
    let without = calibrate(&session, &["--check", "--without-surface", "--json"]);
    let answer: Value = serde_json::from_slice(&without.stdout).unwrap();
    assert!(answer["residual_mm"].as_f64().unwrap() > 0.5, "{answer}");

    // The entry is one that a pipeline takes, and the check against it passes.
    let session = recorded(folder, "second", &truth, &BALLS, entry);
    let same = calibrate(&session, &["--check", "--json"]);
    let answer: Value = serde_json::from_slice(&same.stdout).unwrap();
    assert_eq!(same.status.code(), Some(0), "{answer}");
    assert!(answer["drift_mm"].as_f64().unwrap() < 0.1, "{answer}");
    let at: Vec<f64> = answer["at_m"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let off = (Vector3::from_column_slice(&at) - truth.translation.vector).norm();
    assert!(off < 0.3e-3, "{answer}");

    let other = stillpoint(
        folder,
        &["calibrate", "depth", &session, &session, "--topic", "other.cloud", "--moved", "100mm"],
    );
    assert!(
        text(&other.stderr).contains("(depth images and clouds: cloud.cloud)"),
        "{}",
        text(&other.stderr)
    );

    // The camera sinks by 1 mm.
    let session = recorded(folder, "third", &camera([0.05, -0.4, 0.599]), &BALLS, entry);
    let drifted = calibrate(&session, &["--check"]);
    assert_eq!(drifted.status.code(), Some(1), "{}", text(&drifted.stdout));
    assert!(text(&drifted.stdout).contains("FAIL"));

    let session = recorded(folder, "fourth", &truth, &BALLS[..2], entry);
    let missing = calibrate(&session, &["--date", "2024-02-28"]);
    let mut message = String::new();
    write!(message, "{}", text(&missing.stderr)).unwrap();
    assert_eq!(missing.status.code(), Some(1), "{message}");
    assert!(message.contains("2 of 3 balls are found"), "{message}");
    for wrong in [["--date", "2026-02-30"], ["--residual", "1"]] {
        assert_eq!(calibrate(&session, &wrong).status.code(), Some(2));
    }
}

#[test]
fn a_day_after_the_recording_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let frames = "frames:\n  camera: { parent: couch, at: [0 mm, 0 mm, 0 mm] }";
    let session = recorded_by(folder, "live", &camera([0.05, -0.4, 0.6]), &[], frames, &[]);
    let balls: Vec<String> = BALLS.iter().map(|[x, y, z]| format!("--ball={x},{y},{z},60")).collect();
    let calibrate = |date: &str| {
        let mut arguments = vec!["calibrate", "camera", &session, "--topic", "cloud.cloud", "--date", date];
        arguments.extend(balls.iter().map(String::as_str));
        stillpoint(folder, &arguments)
    };
    let later = calibrate("9998-12-31");
    assert_eq!(later.status.code(), Some(2));
    assert!(text(&later.stderr).contains("recorded before that day"), "{}", text(&later.stderr));
    // Of a day before it, only the balls are missing.
    let before = calibrate("2024-02-28");
    assert_eq!(before.status.code(), Some(1));
    assert!(text(&before.stderr).contains("0 of 3 balls are found"), "{}", text(&before.stderr));
}

#[test]
fn a_plate_that_moves_by_less_than_it_is_said_fails() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let down = |height: f64| camera([0.0, 0.029, height]);
    let frames = "frames:\n  camera: { parent: couch, at: [0 mm, 0 mm, 0 mm] }";
    recorded(folder, "near", &down(0.5), &[], frames);
    recorded(folder, "far", &down(0.6), &[], frames);
    let check = |moved: &str| {
        let arguments =
            ["calibrate", "depth", "sessions/near-0001", "sessions/far-0001", "--topic", "cloud.cloud"];
        stillpoint(folder, &[&arguments[..], &["--moved", moved]].concat())
    };
    let right = check("100mm");
    assert_eq!(right.status.code(), Some(0), "{}{}", text(&right.stdout), text(&right.stderr));
    assert!(text(&right.stdout).contains("tilted by"), "{}", text(&right.stdout));
    let wrong = check("102mm");
    assert_eq!(wrong.status.code(), Some(1));
    assert!(
        text(&wrong.stdout).contains("FAIL") && text(&wrong.stdout).contains("-1.9"),
        "{}",
        text(&wrong.stdout)
    );
}

/// Grey images of a board of 11 x 8 corners of 25 mm, 2 mm over the couch, with 8 or 16 bits.
fn board_images(folder: &Path, name: &str, at: &Isometry3<f64>, is_deep: bool) -> Vec<String> {
    let exposure = match is_deep {
        true => Exposure { counts: 2000.0, electrons: 2.0, reading: 8.0, most: 4095, ..Exposure::default() },
        false => Exposure::default(),
    };
    let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
    let couch_from_board = Isometry3::from_parts(Translation3::new(0.01, 0.03, 0.002), about);
    let board = Checkerboard { corners: [11, 8], square: 0.025, couch_from_board };
    let light = light(&Camera::new(SIZE, FOCAL), at, &board, &exposure);
    let write = |number: u64| {
        let file = format!("{name}-{number}.png");
        std::fs::write(folder.join(&file), png(&taken(&light, &exposure, number), SIZE, exposure.most))
            .unwrap();
        file
    };
    (0..3).map(write).collect()
}

#[test]
fn a_camera_is_placed_by_a_board_and_compared_with_a_session() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let truth = camera([0.05, -0.4, 0.6]);
    let board = ["--board", "11x8", "--square", "25mm", "--at", "10,30,2,90", "--frame", "camera"];
    let intrinsics = ["--intrinsics", "300,300,159.5,119.5"];
    let calibrate = |images: &[String], more: &[&str]| {
        let images: Vec<&str> = images.iter().map(String::as_str).collect();
        stillpoint(folder, &[&["calibrate", "camera"], &images[..], &board, &intrinsics, more].concat())
    };
    for is_deep in [false, true] {
        let images = board_images(folder, "board", &truth, is_deep);
        let placed = calibrate(&images, &["--date", "2024-02-28", "--json"]);
        let answer: Value = serde_json::from_slice(&placed.stdout).unwrap();
        let at: Vec<f64> = answer["at_m"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        let off = (Vector3::from_column_slice(&at) - truth.translation.vector).norm();
        assert!(off < 1e-3 && answer["corners"] == 88 && answer["images"] == 3, "{off} {answer}");
    }
    let images = board_images(folder, "board", &truth, false);
    let placed = calibrate(&images, &["--date", "2024-02-28"]);
    let printed = text(&placed.stdout);
    assert_eq!(placed.status.code(), Some(0), "{printed}{}", text(&placed.stderr));
    for part in
        ["88 corners", "50 mm to the patient's left, 400 mm to the feet, 600 mm up", "scale at a head"]
    {
        assert!(printed.contains(part), "{part}: {printed}");
    }
    let entry = &printed[printed.find("frames:").unwrap()..];
    assert!(entry.contains("board of 11 x 8 corners, 3 images") && entry.contains("measured: 2024-02-28"));

    // The entry is one that a pipeline takes; against its session, the board shows drift.
    let session = recorded(folder, "placed", &truth, &[], entry);
    let same = calibrate(&images, &["--check", "--against", &session]);
    assert_eq!(same.status.code(), Some(0), "{}{}", text(&same.stdout), text(&same.stderr));
    assert!(text(&same.stdout).contains("mm at the board"), "{}", text(&same.stdout));
    let sunk = board_images(folder, "sunk", &camera([0.05, -0.4, 0.598]), false);
    let drifted = calibrate(&sunk, &["--check", "--against", &session]);
    assert_eq!(drifted.status.code(), Some(1), "{}", text(&drifted.stdout));

    let lower = board_images(folder, "lower", &camera([0.05, -0.4, 0.585]), false);
    let mixed = [images[0].clone(), lower[1].clone()];
    let moved = calibrate(&mixed, &["--date", "2024-02-28"]);
    assert_eq!(moved.status.code(), Some(1));
    assert!(text(&moved.stderr).contains("something moved"), "{}", text(&moved.stderr));
    assert_eq!(calibrate(&images, &["--check"]).status.code(), Some(2));
    assert_eq!(calibrate(&images, &["--date", "2024-02-28", "--ball=0,0,30,60"]).status.code(), Some(2));
    let symmetric = ["--board", "9x7", "--square", "25mm", "--at", "0,0,0", "--frame", "camera"];
    let refused = stillpoint(
        folder,
        &[&["calibrate", "camera", &images[0]], &symmetric[..], &intrinsics, &["--date", "2024-02-28"]]
            .concat(),
    );
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("looks the same when it is turned"), "{}", text(&refused.stderr));
}

#[test]
fn a_camera_is_placed_by_the_edges_of_the_couch() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.12);
    let over = camera([0.02, 0.0, 0.75]);
    let truth = Isometry3::from_parts(Translation3::new(0.02, 0.05, 0.75), over.rotation * turned);
    let anywhere = "frames:\n  camera: { parent: couch, at: [0 mm, 0 mm, 0 mm] }";
    let session = recorded(folder, "bare", &truth, &[], anywhere);
    let calibrate = |session: &str, width: &str, more: &[&str]| {
        let target = ["--couch-width", width, "--head-end", "350mm"];
        stillpoint(
            folder,
            &[&["calibrate", "camera", session, "--topic", "cloud.cloud"], &target[..], more].concat(),
        )
    };
    let placed = calibrate(&session, "530mm", &["--date", "2024-02-28"]);
    let printed = text(&placed.stdout);
    assert_eq!(placed.status.code(), Some(0), "{printed}{}", text(&placed.stderr));
    let entry = &printed[printed.find("frames:").unwrap()..];
    assert!(entry.contains("three edges of the couch") && entry.contains("measured: 2024-02-28"), "{entry}");

    let session = recorded(folder, "placed", &truth, &[], entry);
    let same = calibrate(&session, "530mm", &["--check", "--json"]);
    let answer: Value = serde_json::from_slice(&same.stdout).unwrap();
    assert_eq!(same.status.code(), Some(0), "{answer}");
    let at: Vec<f64> = answer["at_m"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let off = (Vector3::from_column_slice(&at) - truth.translation.vector).norm();
    assert!(off < 1e-3 && 1e3 * off < answer["residual_mm"].as_f64().unwrap(), "{off} {answer}");

    let wide = calibrate(&session, "560mm", &["--check"]);
    assert_eq!(wide.status.code(), Some(1));
    assert!(text(&wide.stderr).contains("560.0 mm are given"), "{}", text(&wide.stderr));
    assert_eq!(calibrate(&session, "530", &["--check"]).status.code(), Some(2));
}
