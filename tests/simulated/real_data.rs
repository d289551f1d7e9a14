//! The chain of operators on rendered and on measured data, against labels and PCL 1.13.

use std::path::Path;

use nalgebra::Vector3;
use serde_json::Value;
use stillpoint_operator::files::DiskFiles;
use stillpoint_samples::{Diagnostics, PointCloud, View};
use stillpoint_segment::Plane;
use stillpoint_testing::perception::{HEAD, MEASURED, json, labels, pcl_plane};
use stillpoint_testing::{Run, reference, run};

use crate::registry;

/// Degrees and millimetres between the plane of a frame's diagnostics and the `expected` one.
fn difference(found: &View<'_, Diagnostics>, expected: ([f64; 3], f64)) -> (f64, f64) {
    let value = |name: &str| found.elements.iter().find(|m| m.name() == name).unwrap().value;
    let normal = Vector3::new(value("plane_normal_x"), value("plane_normal_y"), value("plane_normal_z"));
    let plane = Plane { normal, offset: value("plane_offset_m") };
    let expected = Plane { normal: Vector3::from(expected.0), offset: expected.1 };
    (plane.angle_to(&expected).to_degrees(), (plane.offset - expected.offset).abs() * 1000.0)
}

/// Intersection over union of the points sent as face and the valid ones labelled head. The face keeps the order of
/// the cloud, so one pass finds the pixel of each of its points.
fn iou(cloud: &[[f32; 3]], face: &[[f32; 3]], labels: &[u8]) -> f64 {
    let (mut next, mut both, mut either) = (0, 0.0, 0.0);
    for (point, label) in cloud.iter().zip(labels).filter(|(p, _)| p[2].is_finite()) {
        let in_face = face.get(next) == Some(point);
        next += usize::from(in_face);
        both += f64::from(u8::from(in_face && *label == HEAD));
        either += f64::from(u8::from(in_face || *label == HEAD));
    }
    assert_eq!(next, face.len(), "the face has points that the cloud has not");
    both / either
}

fn xyz(run: &Run, topic: &str) -> Vec<Vec<[f32; 3]>> {
    run.samples::<PointCloud>(topic).iter().map(|c| c.elements.iter().map(|p| p.xyz).collect()).collect()
}

/// The chain on one sequence of one sensor, as a pipeline.
fn chain(root: &Path, meta: &Value, sensor: &str) -> Run {
    let number = |key: &str| meta["sensors"][sensor][key].as_f64().unwrap();
    let unit = meta["depth_unit_m"].as_f64().unwrap();
    let text = format!(
        "
stillpoint: 1
name: rendered
frames: {{ camera: {{ parent: world, at: [0 m, 0 m, 1 m] }} }}
operators:
  cloud:
    use: ingest.depth
    every: 100 ms
    frame: camera
    params:
      files: {folder}/{sensor}_*_depth.png
      camera: {{ fx: {fx} px, fy: {fy} px, cx: {cx} px, cy: {cy} px, depth_unit: {unit} m }}
  face: {{ use: segment.face, inputs: {{ cloud: cloud.cloud }}, params: {{ body: waived }} }}
",
        folder = root.display(),
        fx = number("fx"),
        fy = number("fy"),
        cx = number("cx"),
        cy = number("cy"),
    );
    let frames = meta["frames"].as_array().unwrap().len() as u64;
    run(&text, &registry(), &DiskFiles::next_to(&root.join("x.yaml")), frames * 100).unwrap()
}

#[test]
fn the_chain_finds_head_and_plane_in_every_rendered_frame() {
    let Some(perception) = reference::folder("perception") else { return };
    let mut failures = Vec::new();
    for name in ["synth_fig411", "synth_random"] {
        let root = perception.join(name).canonicalize().unwrap();
        let (meta, reference) = (json(&root.join("meta.json")), json(&root.join("pcl_reference.json")));
        for sensor in ["kinect_v1", "kinect_v2", "n35"] {
            let run = chain(&root, &meta, sensor);
            let (clouds, faces) = (xyz(&run, "cloud.cloud"), xyz(&run, "face.face"));
            let diagnostics = run.samples::<Diagnostics>("face.diagnostics");
            let frames = meta["frames"].as_array().unwrap();
            assert_eq!(
                (clouds.len(), faces.len(), diagnostics.len()),
                (frames.len(), frames.len(), frames.len())
            );
            let (mut least, mut sum, mut degrees, mut millimetres) = (1.0_f64, 0.0, 0.0_f64, 0.0_f64);
            for (i, frame) in frames.iter().enumerate() {
                let files = &frame["files"][sensor];
                let labels = labels(&root.join(files["label"].as_str().unwrap()));
                let iou = iou(&clouds[i], &faces[i], &labels);
                let plane = pcl_plane(&reference, files["depth"].as_str().unwrap());
                let (d, m) = difference(&diagnostics[i], plane);
                (least, sum) = (least.min(iou), sum + iou);
                (degrees, millimetres) = (degrees.max(d), millimetres.max(m));
            }
            let mean = sum / frames.len() as f64;
            eprintln!(
                "{name:13} {sensor:10} IoU mean {mean:.4} least {least:.4}, plane to PCL at most {degrees:.3} deg {millimetres:.2} mm"
            );
            if least < 0.8 || degrees > 1.0 || millimetres > 5.0 {
                failures.push(format!("{name} {sensor}"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn the_chain_finds_the_planes_of_measured_clouds() {
    let Some(root) = reference::folder("perception/real") else { return };
    let root = root.canonicalize().unwrap();
    let reference = json(&root.join("pcl_reference.json"));
    let mut failures = Vec::new();
    for name in MEASURED {
        let input = format!("{name}.pcd");
        // Each of the five ticks draws other hypotheses. These tables lie farther than a couch, in sparser clouds.
        let text = format!(
            "
stillpoint: 1
name: measured
frames: {{ camera: {{ parent: world, at: [0 m, 0 m, 1 m] }} }}
operators:
  cloud: {{ use: ingest.pcd, every: 100 ms, frame: camera, params: {{ files: {file}, at_end: repeat }} }}
  face: {{ use: segment.face, inputs: {{ cloud: cloud.cloud }}, params: {{ body: waived, range_max: 2.5 m, iterations: 1000, min_voxels: 30 }} }}
",
            file = root.join(&input).display()
        );
        let run = run(&text, &registry(), &DiskFiles::next_to(&root.join("x.yaml")), 500).unwrap();
        let expected = pcl_plane(&reference, &input);
        let (mut degrees, mut millimetres) = (0.0_f64, 0.0_f64);
        let diagnostics = run.samples::<Diagnostics>("face.diagnostics");
        assert_eq!(diagnostics.len(), 5, "{name}");
        for frame in &diagnostics {
            let (d, m) = difference(frame, expected);
            // A frame without a plane has NaN, which is no small difference.
            (degrees, millimetres) =
                (if d > degrees || d.is_nan() { d } else { degrees }, millimetres.max(m));
        }
        eprintln!("{name:33} worst of 5: {degrees:.3} deg {millimetres:.2} mm");
        let close = degrees <= 0.5 && millimetres <= 3.0;
        if !close {
            failures.push(name);
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}
