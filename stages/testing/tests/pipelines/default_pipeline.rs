//! `pipeline.yaml` at the root.

use stillpoint_pipeline::files::DiskFiles;
use stillpoint_pipeline::live::contracts;
use stillpoint_samples::{Diagnostics, Pose, Track};
use stillpoint_testing::{Run, run};

use crate::{from_root, registry};

fn default_pipeline(ms: u64, change: impl Fn(String) -> String) -> Run {
    let path = from_root("pipeline.yaml");
    let text = change(std::fs::read_to_string(&path).unwrap());
    run(&text, &registry(), &DiskFiles::beside(&path), ms).unwrap()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn every_frame_of_the_default_pipeline_becomes_a_state() {
    let run = default_pipeline(3000, |text| text);
    assert_eq!(run.failed(), [] as [&str; 0]);
    for topic in ["rig.depth", "rig.truth", "cloud.cloud", "face.face", "head.position", "filter.state"] {
        assert!(!run.bytes(topic).is_empty(), "{topic}");
    }
    let states = run.samples::<Track>("filter.state");
    assert_eq!(states.len(), 30);
    let last = states.last().unwrap();
    assert_eq!((last.first().unwrap().accepted, last.first().unwrap().rejected), (30, 0));
}

#[test]
fn the_filtered_centroid_follows_the_head_in_the_couchs_frame() {
    let run = default_pipeline(12_000, |text| text.replace("motion: nods", "motion: steps"));
    let truth = run.samples::<Pose>("rig.truth");
    let states = run.samples::<Track>("filter.state");
    let moved = |from: usize, to: usize| -> (f64, f64) {
        let head = distance(truth[from].first().unwrap().position, truth[to].first().unwrap().position);
        let seen = distance(states[from].first().unwrap().position, states[to].first().unwrap().position);
        (head, seen)
    };
    let (head, seen) = moved(90, 119);
    assert!(head > 2e-3, "the script has moved the head {head} m");
    assert!((head - seen).abs() < 1.5e-3, "the head went {head} m, the centroid {seen} m");
    // The centroid lies in the face, above and in front of the ear canals.
    let offset: Vec<f64> = (0..3)
        .map(|i| states[90].first().unwrap().position[i] - truth[90].first().unwrap().position[i])
        .collect();
    assert!(offset[0].abs() < 0.02 && offset[2] > 0.0 && offset[2] < 0.12, "{offset:?}");
}

#[test]
fn a_head_at_rest_has_a_centroid_as_exact_as_its_covariance_says() {
    let run = default_pipeline(6000, |text| text.replace("motion: nods", "motion: still"));
    let positions: Vec<_> =
        run.samples::<Pose>("head.position").iter().map(|p| *p.first().unwrap()).collect();
    let n = positions.len() as f64;
    for axis in 0..3 {
        let mean = positions.iter().map(|p| p.position[axis]).sum::<f64>() / n;
        let variance = positions.iter().map(|p| (p.position[axis] - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let said = positions[0].covariance[7 * axis];
        eprintln!("axis {axis}: measured {:.3} mm, said {:.3} mm", variance.sqrt() * 1e3, said.sqrt() * 1e3);
        assert!(variance < said, "axis {axis}: {variance} m2, said {said} m2");
    }
}

#[test]
fn diagnostics_name_the_couchs_plane() {
    let run = default_pipeline(1000, |text| text);
    let plane: Vec<f64> =
        run.samples::<Diagnostics>("face.diagnostics").iter().map(|d| d.elements[4].value).collect();
    assert_eq!(plane.len(), 10);
    // The camera is 590 mm over the couch.
    assert!(plane.iter().all(|offset| (offset - 0.59).abs() < 2e-3), "{plane:?}");
}

#[test]
fn two_runs_send_the_same_bytes_and_another_seed_others() {
    let (a, b) = (default_pipeline(1500, |t| t), default_pipeline(1500, |t| t));
    assert_eq!(a.topics(), b.topics());
    for topic in a.topics() {
        assert!(a.bytes(topic) == b.bytes(topic), "{topic} differs");
    }
    let other = default_pipeline(1500, |t| t.replace("seed: 7", "seed: 8"));
    assert!(a.bytes("rig.depth") != other.bytes("rig.depth"));
}

#[test]
fn the_topics_of_the_default_pipeline_fit_a_small_shared_memory() {
    let graph = default_pipeline(1, |text| text).graph;
    let mut contracts = contracts::all(&graph);
    contracts.sort_by_key(|c| std::cmp::Reverse(c.pool_bytes()));
    for contract in contracts.iter().take(5) {
        eprintln!("{:20} {:6.1} MiB", contract.topic, contract.pool_bytes() as f64 / f64::from(1 << 20));
    }
    // Containers give 64 MiB by default, and others need some of it.
    let total: usize = contracts.iter().map(|c| c.pool_bytes()).sum();
    assert!(total < 56 << 20, "{} MiB", total >> 20);
}
