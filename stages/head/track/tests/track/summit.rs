//! What `track.summit` claims of itself, beside how far the heights of a rig's head scatter about the truth.

use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::Pose;
use stillpoint_testing::run;

/// Variance of the heights' errors about their mean, and the mean of the variances claimed, mm2.
fn variances(noise: &str) -> [f64; 2] {
    let text = format!(
        "
stillpoint: 1
name: summit
seed: 3
frames: {{ camera: {{ parent: couch, at: [-60 mm, 0 mm, 720 mm], rotation: [180 deg, 0 deg, 0 deg] }} }}
operators:
  rig:
    use: rig.camera
    every: 100 ms
    frame: camera
    params: {{ motion: raise, noise: {noise}, width: 320 px, height: 240 px, focal_length: 283 px }}
  cloud: {{ use: ingest.depth, inputs: {{ image: rig.depth }}, frame: camera }}
  face: {{ use: segment.face, inputs: {{ cloud: cloud.cloud }}, params: {{ body: waived }} }}
  height: {{ use: track.summit, inputs: {{ face: face.face }}, frame: couch, params: {{ shared_sd: 0.01 mm }} }}
"
    );
    let stages = [
        stillpoint_rig::STAGES,
        stillpoint_ingest::STAGES,
        stillpoint_segment::STAGES,
        stillpoint_track::STAGES,
    ];
    let run = run(&text, &Registry::new(&stages), &MemoryFiles::default(), 30_000).unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    let truth = run.samples::<Pose>("rig.truth");
    let true_at = |origin: u64| {
        let sample = truth.iter().find(|t| t.header.origin == origin).unwrap();
        sample.first().unwrap().position[2]
    };
    let heights = run.samples::<Pose>("height.position");
    let n = heights.len() as f64;
    assert!(n > 290.0, "{n}");
    let errors: Vec<f64> =
        heights.iter().map(|h| 1e3 * (h.first().unwrap().position[2] - true_at(h.header.origin))).collect();
    let mean = errors.iter().sum::<f64>() / n;
    let claimed = heights.iter().map(|h| 1e6 * h.first().unwrap().covariance[14]).sum::<f64>() / n;
    [errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / n, claimed]
}

#[test]
fn a_summit_scatters_as_it_claims() {
    for noise in ["kinect_v1", "kinect_v2"] {
        let [actual, claimed] = variances(noise);
        eprintln!("{noise}: {actual:.4} mm2, claimed {claimed:.4} mm2: {:.3}", claimed / actual);
        // Of 300 errors the variance is known to 8 %.
        assert!((0.8..1.25).contains(&(claimed / actual)), "{noise}: {claimed} of {actual}");
    }
}
