//! Motion of rendered heads against their exact poses, by the whole chain of operators.

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::Value;
use stillpoint_operator::Registry;
use stillpoint_operator::files::DiskFiles;
use stillpoint_pose::PoseNumbers;
use stillpoint_samples::{Pose, PoseElement, PoseReport, Proof};
use stillpoint_testing::{Run, reference, run};

fn isometry(rotation: &Value, translation: impl Fn(usize) -> f64) -> Isometry3<f64> {
    let r = Matrix3::from_fn(|i, j| rotation[i][j].as_f64().unwrap());
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
    Isometry3::from_parts(Translation3::from(Vector3::from_fn(|i, _| translation(i))), turn)
}

fn pose(element: &PoseElement) -> Isometry3<f64> {
    let [w, x, y, z] = element.orientation;
    let turn = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Translation3::from(element.position), turn)
}

/// A sequence of one sensor as a pipeline.
fn chain(root: &Path, meta: &Value, sensor: &str) -> Run {
    let view = &meta["sensors"][sensor];
    let number = |key: &str| view[key].as_f64().unwrap();
    let matrix = &view["T_world_camera"];
    let camera = PoseNumbers::of(&isometry(matrix, |i| matrix[i][3].as_f64().unwrap()));
    let [x, y, z] = camera.position;
    let text = format!(
        "
stillpoint: 1
name: rendered
frames: {{ camera: {{ parent: couch, at: [{x} m, {y} m, {z} m], rotation: [{} rad, {} rad, {} rad] }} }}
operators:
  cloud:
    use: ingest.depth
    every: 100 ms
    frame: camera
    params:
      files: {folder}/{sensor}_*_depth.png
      camera: {{ fx: {fx} px, fy: {fy} px, cx: {cx} px, cy: {cy} px, depth_unit: {unit} m }}
  face: {{ use: segment.face, inputs: {{ cloud: cloud.cloud }}, params: {{ body: waived }} }}
  head: {{ use: track.head, inputs: {{ face: face.face }}, frame: couch }}
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
    );
    let registry =
        Registry::new(&[stillpoint_ingest::STAGES, stillpoint_segment::STAGES, stillpoint_track::STAGES]);
    let frames = meta["frames"].as_array().unwrap().len() as u64;
    run(&text, &registry, &DiskFiles::next_to(&root.join("x.yaml")), frames * 100).unwrap()
}

/// Root mean square of the errors of the motion since the first frame, per axis: mm at the head's pivot, degrees.
pub fn errors(topic: &[Isometry3<f64>], truth: &[Isometry3<f64>]) -> ([f64; 3], [f64; 3]) {
    let (mut squares, mut turns) = (Vector3::zeros(), Vector3::zeros());
    let pivot = Point3::from(truth[0].translation.vector);
    for k in 1..truth.len() {
        let found = topic[k] * topic[0].inverse();
        let exact = truth[k] * truth[0].inverse();
        let shift = (found * pivot - exact * pivot) * 1e3;
        let turn = (found.rotation * exact.rotation.inverse()).scaled_axis().map(f64::to_degrees);
        if std::env::var_os("VERBOSE").is_some() {
            eprintln!(
                "{k:2} mm {:+.3} {:+.3} {:+.3} deg {:+.3} {:+.3} {:+.3}",
                shift.x, shift.y, shift.z, turn.x, turn.y, turn.z
            );
        }
        squares += shift.component_mul(&shift);
        turns += turn.component_mul(&turn);
    }
    let rms = |sum: Vector3<f64>| (sum / (truth.len() - 1) as f64).map(f64::sqrt).into();
    (rms(squares), rms(turns))
}

#[test]
fn motion_of_rendered_heads_is_found_within_the_bounds() {
    let Some(perception) = reference::folder("perception") else { return };
    eprintln!("sequence      sensor     way           rms mm (x y z)         rms deg (x y z)        overlap");
    let mut failures = Vec::new();
    for (name, mm, degrees) in [("synth_fig411", 0.3, 0.15), ("synth_random", 0.5, 0.3)] {
        let root = perception.join(name).canonicalize().unwrap();
        let meta: Value = serde_json::from_slice(&std::fs::read(root.join("meta.json")).unwrap()).unwrap();
        let frames = meta["frames"].as_array().unwrap();
        let head = |f: &Value| isometry(&f["R_head"], |i| f["t_head_m"][i].as_f64().unwrap());
        let truth: Vec<_> = frames.iter().map(head).collect();
        for sensor in ["n35", "kinect_v1", "kinect_v2"] {
            let run = chain(&root, &meta, sensor);
            assert_eq!(run.failed(), [] as [&str; 0]);
            if std::env::var_os("VERBOSE").is_some() {
                for r in run.samples::<PoseReport>("head.report") {
                    let r = r.first().unwrap();
                    eprintln!(
                        "status {} iterations {} sd {:.3} overlap {:.3} sens {:.3?}",
                        r.status,
                        r.iterations,
                        r.residual_sd * 1e3,
                        r.overlap,
                        r.sensitivity
                    );
                }
            }
            let overlap = run
                .samples::<PoseReport>("head.report")
                .iter()
                .fold(1.0_f64, |least, report| least.min(report.first().unwrap().overlap));
            // Heads of meshes that are not the rig's move as one, too; six frames are too few to tell.
            if frames.len() > 10 {
                let last = *run.samples::<PoseReport>("head.report").last().unwrap().first().unwrap();
                assert_eq!(last.proof, Proof::Proven as u32, "{name} {sensor}: {}", last.moved);
            }
            for (source, bound) in [("pose", sensor == "n35"), ("three_points", false)] {
                let poses = run.samples::<Pose>(&format!("head.{source}"));
                let poses: Vec<_> = poses.iter().map(|p| pose(p.first().unwrap())).collect();
                assert_eq!(poses.len(), truth.len(), "{name} {sensor} {source}");
                let (shift, turn) = errors(&poses, &truth);
                eprintln!("{name:13} {sensor:10} {source:13} {shift:6.3?}  {turn:6.3?}  {overlap:.3}");
                if bound && (shift.iter().any(|&e| e > mm) || turn.iter().any(|&e| e > degrees)) {
                    failures.push(format!("{name} {sensor}: {shift:?} mm, {turn:?} degrees"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}
