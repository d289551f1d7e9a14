//! Seeing alone, without valves: `examples/head-tracking.yaml`.

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};
use stillpoint_pipeline::files::DiskFiles;
use stillpoint_samples::{Diagnostics, Pose, Track};
use stillpoint_testing::{Run, run};

use crate::{from_root, registry};

fn head_tracking(ms: u64, change: impl Fn(String) -> String) -> Run {
    let path = from_root("examples/head-tracking.yaml");
    let text = change(std::fs::read_to_string(&path).unwrap());
    run(&text, &registry(), &DiskFiles::beside(&path), ms).unwrap()
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
        let said = poses.iter().map(|p| p.covariance[7 * channel]).sum::<f64>() / n;
        eprintln!("channel {channel}: measured {:.1e}, said {:.1e}", variance.sqrt(), said.sqrt());
        // Frames err with the reference alike: the covariance has that error in it, the scatter has not.
        assert!(variance < 1.5 * said, "channel {channel}: {variance}, said {said}");
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
