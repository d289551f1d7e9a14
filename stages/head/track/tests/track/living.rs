//! Persons whose faces and necks move, by the whole chain of operators, against the exact motion of the skull.
//!
//! `LIVING=FOLDER` names another folder of scenes; then figures are printed and nothing is asserted.

use std::path::{Path, PathBuf};

use nalgebra::{
    Isometry3, Matrix3, Matrix6, Point3, Quaternion, Rotation3, UnitQuaternion, Vector3, Vector6,
};
use serde_json::Value;
use stillpoint_operator::Registry;
use stillpoint_operator::files::DiskFiles;
use stillpoint_samples::{
    IdentityPart, PointCloud, Pose, PoseElement, PoseReport, PoseReportElement, PoseStatus, Proof, Unproven,
};
use stillpoint_testing::perception::{HEAD, json, labels};
use stillpoint_testing::{reference, run::run_keeping};

fn isometry(rows: &Value) -> Isometry3<f64> {
    let at = |i: usize, j: usize| rows[i][j].as_f64().unwrap();
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&Matrix3::from_fn(at)));
    Isometry3::from_parts(Vector3::new(at(0, 3), at(1, 3), at(2, 3)).into(), turn)
}

fn pose(element: &PoseElement) -> Isometry3<f64> {
    let [w, x, y, z] = element.orientation;
    let turn = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Vector3::from(element.position).into(), turn)
}

/// A frame since the capture.
struct Frame {
    index: usize,
    report: PoseReportElement,
    pose: Option<PoseElement>,
    /// Movement of the middle of the skull less the true one, m, and turn less the true one, rad; NaN without a pose.
    error: Vector3<f64>,
    turn: f64,
    nees: f64,
    is_face: bool,
    is_blocked: bool,
}

/// What came of a scene.
struct Scene {
    name: String,
    is_tof: bool,
    /// Frame that became the reference, and the head's share of its points.
    captured: Option<(usize, f64)>,
    frames: Vec<Frame>,
    proven: Option<usize>,
}

fn text(root: &Path, meta: &Value, sensor: &str) -> String {
    let view = &meta["sensors"][sensor];
    let number = |key: &str| view[key].as_f64().unwrap();
    let camera = stillpoint_pose::PoseNumbers::of(&isometry(&view["T_world_camera"]));
    let [x, y, z] = camera.position;
    format!(
        "
stillpoint: 1
name: living
seed: 7
frames: {{ camera: {{ parent: couch, at: [{x} m, {y} m, {z} m], rotation: [{} rad, {} rad, {} rad] }} }}
operators:
  console: {{ use: console, every: 20 ms, params: {{ script: [{{ at: 900 ms, say: capture }}] }} }}
  cloud:
    use: ingest.depth
    every: 100 ms
    frame: camera
    params:
      files: {folder}/{sensor}_*_depth.png
      camera: {{ fx: {fx} px, fy: {fy} px, cx: {cx} px, cy: {cy} px, depth_unit: {unit} m }}
  face: {{ use: segment.face, inputs: {{ cloud: cloud.cloud }} }}
  head:
    use: track.head
    inputs: {{ face: face.face, rejection: face.rejection, command: console.capture, confirm: console.confirm, cloud: cloud.cloud }}
    frame: couch
    params: {{ capture: command, soft_tissue: weighted }}
",
        camera.pitch,
        camera.roll,
        camera.yaw,
        folder = root.display(),
        fx = number("fx"),
        fy = number("fy"),
        cx = number("cx"),
        cy = number("cy"),
        unit = meta["depth_unit_m"],
    )
}

fn measured(root: &Path) -> Scene {
    let meta = json(&root.join("meta.json"));
    let sensor = if meta["sensors"]["n35"].is_null() { "tof" } else { "n35" };
    let registry = Registry::new(&[
        stillpoint_ingest::STAGES,
        stillpoint_segment::STAGES,
        stillpoint_track::STAGES,
        stillpoint_testing::pipeline::STAGES,
    ]);
    let truth = meta["frames"].as_array().unwrap();
    let retained = |topic: &str| topic.starts_with("head.");
    let ms = truth.len() as u64 * 100;
    let run = run_keeping(
        retained,
        &text(root, &meta, sensor),
        &registry,
        &DiskFiles::next_to(&root.join("x.yaml")),
        ms,
    )
    .unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    let poses = run.samples::<Pose>("head.pose");
    let reports = run.samples::<PoseReport>("head.report");
    let origin = |k: usize| reports[0].header.origin + 100_000_000 * k as u64;
    let is = |report: &PoseReportElement, status: PoseStatus| report.status == status as u32;
    let report_of =
        |k: usize| reports.iter().find(|r| r.header.origin == origin(k)).map(|r| *r.first().unwrap());
    let pose_of = |k: usize| poses.iter().find(|p| p.header.origin == origin(k)).map(|p| *p.first().unwrap());
    let name = root.file_name().unwrap().to_string_lossy().into_owned();
    let mut scene = Scene { name, is_tof: sensor == "tof", captured: None, frames: Vec::new(), proven: None };
    let first = (0..truth.len()).find(|k| report_of(*k).is_some_and(|r| is(&r, PoseStatus::Captured)));
    let Some(first) = first else {
        if std::env::var_os("VERBOSE").is_some() {
            let statuses: Vec<u32> = (0..truth.len()).filter_map(report_of).map(|r| r.status).collect();
            eprintln!("{} {statuses:?}", scene.name);
        }
        return scene;
    };
    let digits = if truth.len() > 100 { 3 } else { 2 };
    let label = labels(&root.join(format!("{sensor}_{first:0digits$}_label.png")));
    let view = &meta["sensors"][sensor];
    let number = |key: &str| view[key].as_f64().unwrap();
    let reference = run.samples::<PointCloud>("head.reference");
    let points = reference[0].elements;
    let is_head = points.iter().filter(|p| {
        let [x, y, z] = p.xyz.map(f64::from);
        let (u, v) = (number("fx") * x / z + number("cx"), number("fy") * y / z + number("cy"));
        let place = v.round() as usize * view["width"].as_u64().unwrap() as usize + u.round() as usize;
        label.get(place) == Some(&HEAD)
    });
    scene.captured = Some((first, is_head.count() as f64 / points.len() as f64));
    let at_capture = pose(&pose_of(first).unwrap());
    let true_then = isometry(&truth[first]["T"]);
    let centre = Point3::from(Vector3::from_fn(|i, _| truth[first]["centre"][i].as_f64().unwrap()));
    let middle = true_then * centre;
    for (k, now) in truth.iter().enumerate().skip(first) {
        let Some(report) = report_of(k) else { continue };
        if report.proof == Proof::Proven as u32 {
            scene.proven.get_or_insert(k - first);
        }
        let mut frame = Frame {
            index: k,
            report,
            pose: pose_of(k),
            error: Vector3::repeat(f64::NAN),
            turn: f64::NAN,
            nees: f64::NAN,
            is_face: now["acts"].as_array().is_some_and(|acts| !acts.is_empty()),
            is_blocked: now["arm"].as_f64().unwrap_or(0.0) > 0.0,
        };
        if let Some(element) = &frame.pose {
            let found = pose(element);
            let (moved, exact) = (found * at_capture.inverse(), isometry(&now["T"]) * true_then.inverse());
            frame.error = moved * middle - exact * middle;
            let turn = (moved.rotation * exact.rotation.inverse()).scaled_axis();
            frame.turn = turn.norm();
            let shift =
                found.translation.vector - (exact * Point3::from(at_capture.translation.vector)).coords;
            let all = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
            let covariance = Matrix6::from_row_slice(&element.covariance);
            if k > first {
                frame.nees = covariance.cholesky().map_or(f64::NAN, |c| all.dot(&c.solve(&all)));
            }
        }
        scene.frames.push(frame);
    }
    scene
}

fn quantile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    if values.is_empty() { f64::NAN } else { values[((values.len() - 1) as f64 * part).round() as usize] }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

impl Scene {
    /// Errors less their mean before the first face, mm, of the frames with a face and a pose.
    fn false_motion(&self) -> Vec<f64> {
        let quiet = self.frames.iter().take_while(|f| !f.is_face).filter(|f| f.pose.is_some());
        let (sum, count) = quiet.fold((Vector3::zeros(), 0.0), |(sum, n), f| (sum + f.error, n + 1.0));
        let rest = sum / f64::max(count, 1.0);
        let faces = self.frames.iter().filter(|f| f.is_face && f.pose.is_some());
        faces.map(|f| 1e3 * (f.error - rest).norm()).collect()
    }

    fn share(&self, of: impl Fn(&&Frame) -> bool) -> f64 {
        let all = self.frames.iter().filter(&of).count();
        self.frames.iter().filter(&of).filter(|f| f.pose.is_some()).count() as f64 / all as f64
    }

    fn line(&self) -> String {
        let Some((first, head)) = self.captured else { return format!("{:18} not captured", self.name) };
        let seen = self.frames.iter().filter(|f| f.pose.is_some());
        let mut errors: Vec<f64> = seen.clone().map(|f| 1e3 * f.error.norm()).collect();
        let mut turns: Vec<f64> = seen.clone().map(|f| f.turn.to_degrees()).collect();
        let nees: Vec<f64> = seen.clone().map(|f| f.nees).filter(|n| n.is_finite()).collect();
        let mut faces = self.false_motion();
        let mut why = std::collections::BTreeMap::<String, u32>::new();
        for f in &self.frames {
            let status =
                PoseStatus::ALL.iter().find(|(_, s)| *s as u32 == f.report.status).map_or("", |s| s.0);
            if f.pose.is_none() || status == "face moves" {
                let least =
                    (0..5).min_by(|a, b| f.report.certainty[*a].total_cmp(&f.report.certainty[*b])).unwrap();
                let part = if status == "doubted" { IdentityPart::ALL[least].0 } else { "" };
                *why.entry(format!("{status} {part}")).or_default() += 1;
            }
        }
        format!(
            "{:18} at {first:2} head {head:.2} pose {:.2} faces {:.2} blocked {:.2} err {:.2}/{:.2}/{:.2} turn p95 {:.2} false {:.2}/{:.2}/{:.2} nees {:5.1} proven {:?}, cause and face {:?} {why:?}",
            self.name,
            self.share(|_| true),
            self.share(|f| f.is_face),
            self.share(|f| f.is_blocked),
            mean(&errors),
            quantile(&mut errors, 0.95),
            quantile(&mut errors, 1.0),
            quantile(&mut turns, 0.95),
            mean(&faces),
            quantile(&mut faces, 0.95),
            quantile(&mut faces, 1.0),
            mean(&nees),
            self.proven.map(|k| k as f64 / 10.0),
            self.frames.last().map(|f| (f.report.unproven, f.report.face)),
        )
    }
}

fn pooled(scenes: &[Scene]) {
    let kinds: std::collections::BTreeSet<char> =
        scenes.iter().filter_map(|s| s.name.chars().next()).collect();
    for kind in kinds {
        for is_tof in [false, true] {
            let of: Vec<&Scene> =
                scenes.iter().filter(|s| s.name.starts_with(kind) && s.is_tof == is_tof).collect();
            if of.is_empty() {
                continue;
            }
            let captured = of.iter().filter(|s| s.captured.is_some()).count();
            let frames = || of.iter().flat_map(|s| &s.frames);
            let share = |pick: &dyn Fn(&Frame) -> bool| {
                let all = frames().filter(|f| pick(f)).count();
                frames().filter(|f| pick(f) && f.pose.is_some()).count() as f64 / all as f64
            };
            let mut errors: Vec<f64> =
                frames().map(|f| 1e3 * f.error.norm()).filter(|e| e.is_finite()).collect();
            let mut blocked: Vec<f64> = frames()
                .filter(|f| f.is_blocked)
                .map(|f| 1e3 * f.error.norm())
                .filter(|e| e.is_finite())
                .collect();
            let mut turns: Vec<f64> = frames()
                .filter(|f| f.is_face || kind == 'N')
                .map(|f| f.turn.to_degrees())
                .filter(|e| e.is_finite())
                .collect();
            let nees: Vec<f64> = frames().map(|f| f.nees).filter(|n| n.is_finite()).collect();
            let inside = nees.iter().filter(|n| **n < 12.6).count() as f64 / nees.len() as f64;
            let mut faces: Vec<f64> = of.iter().flat_map(|s| s.false_motion()).collect();
            let mut heads: Vec<f64> = of.iter().filter_map(|s| s.captured).map(|c| c.1).collect();
            let worst = of.iter().map(|s| s.share(|_| true)).filter(|s| s.is_finite()).fold(1.0, f64::min);
            let doubted = frames().filter(|f| f.report.status == PoseStatus::Doubted as u32).count() as f64
                / frames().count() as f64;
            eprintln!(
                "{kind}{} {captured}/{} captured, head {:.3} (10 % {:.3}), pose {:.3} (least {worst:.2}), faces {:.3}, pauses {:.3}, blocked {:.3}, doubted {doubted:.3}, err {:.2} p95 {:.2}, blocked p95 {:.2}, turn p95 {:.2}, false {:.2} p95 {:.2} max {:.2}, nees {:.1} inside {inside:.2}, proven {}",
                if is_tof { " tof" } else { "    " },
                of.len(),
                quantile(&mut heads, 0.5),
                quantile(&mut heads, 0.1),
                share(&|_| true),
                share(&|f| f.is_face),
                share(&|f| !f.is_face),
                share(&|f| f.is_blocked),
                mean(&errors),
                quantile(&mut errors, 0.95),
                quantile(&mut blocked, 0.95),
                quantile(&mut turns, 0.95),
                mean(&faces),
                quantile(&mut faces, 0.95),
                quantile(&mut faces, 1.0),
                mean(&nees),
                of.iter().filter(|s| s.proven.is_some()).count(),
            );
        }
    }
}

/// The scenes of a folder, measured on two threads.
fn scenes(root: &Path) -> Vec<Scene> {
    let only = std::env::var("SCENES").unwrap_or_default();
    let entries = std::fs::read_dir(root).unwrap().map(|e| e.unwrap().path());
    let mut folders: Vec<PathBuf> = entries
        .filter(|p| {
            p.join("meta.json").is_file()
                && (only.is_empty()
                    || only.split(',').any(|o| p.file_name().unwrap().to_string_lossy().starts_with(o)))
        })
        .collect();
    folders.sort();
    let half = folders.len().div_ceil(2);
    let mut all: Vec<Scene> = std::thread::scope(|scope| {
        let parts = [&folders[..half], &folders[half..]];
        let threads = parts.map(|part| scope.spawn(|| part.iter().map(|f| measured(f)).collect::<Vec<_>>()));
        threads.into_iter().flat_map(|t| t.join().unwrap()).collect()
    });
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all
}

#[test]
fn heads_are_followed_although_necks_bend_faces_move_and_arms_block_the_view() {
    let chosen = std::env::var_os("LIVING").map(PathBuf::from);
    let Some(root) = chosen.clone().or_else(|| reference::folder("perception/living")) else { return };
    let all = scenes(&root);
    for scene in &all {
        eprintln!("{}", scene.line());
        if std::env::var_os("VERBOSE").is_some() {
            for f in &scene.frames {
                eprintln!(
                    "  {:3} status {} face {} conf {:.2} {:.2?} apart {:.2} overlap {:.2} sd {:.2} moved {:.2} err {:.2} turn {:.2} nees {:.1}",
                    f.index,
                    f.report.status,
                    f.is_face,
                    f.report.confidence,
                    f.report.certainty,
                    1e3 * f.report.apart,
                    f.report.overlap,
                    1e3 * f.report.residual_sd,
                    f.report.moved,
                    1e3 * f.error.norm(),
                    f.turn.to_degrees(),
                    f.nees
                );
            }
        }
    }
    pooled(&all);
    if chosen.is_some() {
        return;
    }
    for scene in &all {
        let head = scene.captured.map(|(_, head)| head);
        assert!(
            head.is_some_and(|head| head > 0.95),
            "{}: {head:?} of the reference is the head",
            scene.name
        );
    }
    // An arm over a third of the head, for two seconds and more: the head is followed, and closely.
    let arm = all.iter().find(|scene| scene.name == "arm_blocks").unwrap();
    let blocked = || arm.frames.iter().filter(|f| f.is_blocked);
    assert!(blocked().count() > 15 && arm.share(|f| f.is_blocked) >= 0.9, "{}", arm.line());
    assert!(blocked().any(|f| f.report.status == PoseStatus::Followed as u32));
    assert!(blocked().all(|f| f.pose.is_none() || f.error.norm() < 1.4e-3), "{}", arm.line());
    // Persons whose faces move have a pose in nine of ten frames, and one that is near the truth.
    for scene in all.iter().filter(|scene| scene.frames.iter().any(|f| f.is_face)) {
        let face = scene.false_motion().iter().copied().fold(0.0, f64::max);
        assert!(scene.share(|_| true) >= 0.9 && face < 2.0, "{}", scene.line());
    }
    // Who yawns before the proof is not proven, and the report says why.
    let yawns = all.iter().find(|scene| scene.name == "yawn_jaw").unwrap();
    let last = yawns.frames.last().unwrap().report;
    assert_eq!((last.proof, last.unproven), (Proof::Waiting as u32, Unproven::FaceMoves as u32));
    assert!(all.iter().all(|scene| scene.frames.iter().all(|f| f.report.face == 1)));
    // No doubt once the neck bends, as before, in more than half of the frames.
    let turns = all.iter().find(|scene| scene.name == "neutral_turns").unwrap();
    assert!(turns.share(|_| true) > 0.95, "{}", turns.line());
}
