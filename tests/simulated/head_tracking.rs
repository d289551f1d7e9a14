//! Seeing alone, without valves: `examples/head-tracking.yaml`.

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};
use stillpoint_operator::files::DiskFiles;
use stillpoint_samples::{Diagnostics, Pose, PoseReport, Track};
use stillpoint_testing::{Run, run};

use crate::{from_root, registry};

fn head_tracking(ms: u64, change: impl Fn(String) -> String) -> Run {
    let path = from_root("examples/head-tracking.yaml");
    let text = change(std::fs::read_to_string(&path).unwrap());
    run(&text, &registry(), &DiskFiles::next_to(&path), ms).unwrap()
}

fn isometry(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Vector3::from(position).into(), rotation)
}

#[test]
fn the_filtered_pose_follows_the_head_in_the_couchs_frame() {
    let run = head_tracking(12_000, |text| text.replace("motion: sweep", "motion: steps"));
    let truth = run.samples::<Pose>("rig.truth");
    let states = run.samples::<Track>("filter.state");
    let true_at = |i: usize| truth[i].first().map(|p| isometry(p.position, p.orientation)).unwrap();
    let seen_at = |i: usize| states[i].first().map(|s| isometry(s.position, s.orientation)).unwrap();
    // The motion of the rig's place on the head, by the truth and by what was seen.
    let place = Point3::from(true_at(90).translation.vector);
    let moved = true_at(119) * true_at(90).inverse();
    let seen = seen_at(119) * seen_at(90).inverse();
    let far = (moved * place - place).norm();
    assert!(far > 2e-3 && moved.rotation.angle() > 5e-3, "the script has moved the head {moved}");
    let (off, turned) = ((moved * place - seen * place).norm(), moved.rotation.angle_to(&seen.rotation));
    eprintln!(
        "moved {:.2} mm, {:.2} deg; off {:.3} mm, {:.3} deg",
        far * 1e3,
        moved.rotation.angle().to_degrees(),
        off * 1e3,
        turned.to_degrees()
    );
    assert!(off < 0.3e-3 && turned.to_degrees() < 0.2, "{off} m, {turned} rad");
    // The head's origin, the centroid of the reference, lies in the face: above and in front of the ear canals.
    let offset = seen_at(90).translation.vector - true_at(90).translation.vector;
    assert!(offset.x.abs() < 0.02 && offset.z > 0.0 && offset.z < 0.12, "{offset}");
}

/// How far the filtered pose is from the measured one of the same frame, for each frame that has one: m, rad.
fn filtered_from_measured(run: &Run) -> Vec<(u64, [f64; 2])> {
    let poses = run.samples::<Pose>("head.pose");
    let states = run.samples::<Track>("filter.state");
    let of = |origin: u64| states.iter().rev().find(|s| s.header.origin == origin);
    let pairs = poses.iter().filter_map(|pose| {
        let origin = pose.header.origin;
        let (p, s) = (*pose.first()?, *of(origin)?.first()?);
        let off = isometry(p.position, p.orientation).inverse() * isometry(s.position, s.orientation);
        Some((origin, [off.translation.vector.norm(), off.rotation.angle()]))
    });
    pairs.collect()
}

/// The head nods and coughs from 11 s on, by 2 mm and 1.7 degrees within some frames.
#[test]
fn a_cough_is_followed() {
    let run = head_tracking(13_000, |text| text.replace("motion: sweep", "motion: nods"));
    let off = filtered_from_measured(&run);
    assert!(off.len() > 120, "{} frames", off.len());
    let worst = |i: usize| off.iter().map(|(_, off)| off[i]).fold(0.0, f64::max);
    assert!(worst(0) < 0.1e-3 && worst(1).to_degrees() < 0.1, "{} m, {} rad", worst(0), worst(1));
}

/// A person says `capture` again while the head is turned: from the first frame against the new reference on the filter
/// has that pose, and nothing of the way from the old one to it.
#[test]
fn another_reference_is_no_motion() {
    let output_text = "every: 20 ms, params: { script: [{ at: 3 s, say: capture }] } }";
    let run = head_tracking(5000, |text| text.replacen("every: 20 ms }", output_text, 1));
    let reports = run.samples::<PoseReport>("head.report");
    let numbers: Vec<u32> = reports.iter().map(|r| r.first().unwrap().reference).collect();
    assert_eq!((numbers[0], *numbers.last().unwrap()), (1, 2), "{numbers:?}");
    let off = filtered_from_measured(&run);
    let worst = |i: usize| off.iter().map(|(_, off)| off[i]).fold(0.0, f64::max);
    assert!(worst(0) < 0.1e-3 && worst(1).to_degrees() < 0.1, "{} m, {} rad", worst(0), worst(1));
    let runs: Vec<u64> =
        run.samples::<Track>("filter.state").iter().map(|s| s.first().unwrap().run).collect();
    assert_eq!(runs.iter().filter(|run| **run == 1).count(), 2, "{runs:?}");
}

#[test]
fn a_head_at_rest_has_a_pose_as_exact_as_its_covariance_says() {
    let run = head_tracking(6000, |text| text.replace("motion: sweep", "motion: still"));
    let poses: Vec<_> = run.samples::<Pose>("head.pose").iter().map(|p| *p.first().unwrap()).collect();
    // The first frame is the reference itself.
    let (first, poses) = poses.split_first().unwrap();
    let start = isometry(first.position, first.orientation);
    let n = poses.len() as f64;
    for channel in 0..6 {
        let value = |p: &stillpoint_samples::PoseElement| {
            let turn =
                (isometry(p.position, p.orientation).rotation * start.rotation.inverse()).scaled_axis();
            if channel < 3 { p.position[channel] } else { turn[channel - 3] }
        };
        let mean = poses.iter().map(value).sum::<f64>() / n;
        let variance = poses.iter().map(|p| (value(p) - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let output_text = poses.iter().map(|p| p.covariance[7 * channel]).sum::<f64>() / n;
        eprintln!("channel {channel}: measured {:.1e}, said {:.1e}", variance.sqrt(), output_text.sqrt());
        // Frames err with the reference alike: the covariance has that error in it, the scatter has not.
        assert!(variance < 1.5 * output_text, "channel {channel}: {variance}, said {output_text}");
    }
}

#[test]
fn diagnostics_name_the_couchs_plane() {
    let run = head_tracking(1000, |text| text);
    let plane: Vec<f64> =
        run.samples::<Diagnostics>("face.diagnostics").iter().map(|d| d.elements[4].value).collect();
    assert_eq!(plane.len(), 10);
    // The camera is 590 mm over the couch.
    assert!(plane.iter().all(|offset| (offset - 0.59).abs() < 2e-3), "{plane:?}");
}

#[test]
fn diagnostics_count_what_was_cut_from_the_head() {
    let cut = |setting: &str| -> Vec<f64> {
        let run = head_tracking(500, |text| {
            text.replace("noise: structured_light", &format!("noise: structured_light, setting: {setting}"))
        });
        let metric = |d: &stillpoint_samples::View<'_, Diagnostics>| {
            d.elements.iter().find(|m| m.name() == "cut_voxels").unwrap().value
        };
        run.samples::<Diagnostics>("face.diagnostics").iter().map(metric).collect()
    };
    // Pillow, shoulders and pads are one cluster with the head.
    let patient = cut("patient");
    assert!(patient.len() == 5 && patient.iter().all(|voxels| *voxels > 500.0), "{patient:?}");
}
