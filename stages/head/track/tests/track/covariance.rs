//! Whether the errors of poses agree with their covariance, behind the segmentation, on patients drawn by chance: one
//! capture of each, and later frames of a head that nods. The reference's own error, which stays the same from frame to
//! frame, is part of the error.
//!
//! `STILLPOINT_PATIENTS=10000..10300` says which are drawn.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};
use rand::SeedableRng;
use stillpoint_rig::patient::drawn::{Extra, Patient, patient};
use stillpoint_rig::patient::worn::WORN;
use stillpoint_rig::trajectory::{Motion, Trajectory};
use stillpoint_samples::PoseElement;
use stillpoint_segment::identity::{IdentityParams, Region};
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter};

use crate::behind_face::numbers;
use crate::head::{bench, feed, isometry};
use crate::planned::Random;
use crate::scene::Frame;

/// Frames after the capture, and the time between them, s.
const FRAMES: u64 = 12;
const PERIOD: f64 = 0.25;
/// 95 % of the squared errors of six channels, in units of their covariance, lie below.
const REGION_95: f64 = 12.592;
/// A capture has the right identity if this part of its points is the head's.
const PURE: f64 = 0.95;

/// The poses of one capture.
struct Capture {
    camera: &'static str,
    is_head: bool,
    /// Squared errors in units of the covariance, 6 in the mean.
    nees: Vec<f64>,
}

fn error(estimate: &Isometry3<f64>, due: &Isometry3<f64>) -> Vector6<f64> {
    let shift = estimate.translation.vector - due.translation.vector;
    let turn = (estimate.rotation * due.rotation.inverse()).scaled_axis();
    Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
}

fn squared(error: &Vector6<f64>, pose: &PoseElement) -> f64 {
    let covariance = Matrix6::from_row_slice(&pose.covariance);
    error.dot(&covariance.cholesky().unwrap().solve(error))
}

/// `None`: the first face that is sent is not captured, or none is sent.
fn capture(p: &Patient, number: u64) -> Option<Capture> {
    let motion = Trajectory::new(Motion::Nods, number, p.couch_from_head);
    let worn = WORN[(number / 30) as usize % WORN.len()];
    let camera = &p.couch_from_camera;
    let identity = IdentityParams {
        couch_from_cloud: *camera,
        region: Some(Region::DEFAULT),
        needs_body: true,
        margin: 0.2,
    };
    let params = FaceParams { identity: Some(identity), ..FaceParams::default() };
    let mut segmenter = FaceSegmenter::new(params).unwrap();
    let list = |values: [f64; 3], unit: &str| values.map(|v| format!("{v:.17} {unit}")).join(", ");
    let place = list(camera.translation.vector.into(), "m");
    let (x, y, z) = camera.rotation.euler_angles();
    let turn = list([x, y, z], "rad");
    let mut bench =
        bench(|text| text.replace("1 m, 2 m, 3 m", &place).replace("0 deg, 0 deg, 90 deg", &turn));
    let mut captured: Option<(Isometry3<f64>, bool)> = None;
    let mut nees = Vec::new();
    for k in 0..=FRAMES {
        let truth = motion.couch_from_head(PERIOD * k as f64);
        let head = worn.on_head(p.scale).unwrap();
        let frame = Frame::of_head(&p.kind, camera, &p.scene, head, &truth, 1000 * number + k);
        let cloud = Cloud { points: &frame.cloud, width: frame.width };
        let found = segmenter.segment(cloud, &mut Random::seed_from_u64(number));
        let Ok(face) = found.face else { continue };
        let own = face.iter().filter(|i| frame.head[**i as usize]).count();
        let is_head = own as f64 > PURE * face.len() as f64;
        let points: Vec<Vector3<f64>> =
            face.iter().map(|i| Vector3::from(frame.cloud[*i as usize].map(f64::from))).collect();
        let Some(pose) = feed(&mut bench, &points).pose else { continue };
        let estimate = isometry(&pose);
        match captured {
            None => captured = Some((truth.inverse() * estimate, is_head)),
            Some((body, _)) => nees.push(squared(&error(&estimate, &(truth * body)), &pose)),
        }
    }
    let (_, is_head) = captured?;
    Some(Capture { camera: p.kind.name, is_head: is_head && p.extra != Extra::Fist, nees })
}

#[test]
fn errors_of_poses_agree_with_their_covariance() {
    let mut of_cameras: BTreeMap<(bool, &str), Vec<Vec<f64>>> = BTreeMap::new();
    for number in numbers() {
        let p = patient(number).unwrap();
        if let Some(capture) = p.has_head().then(|| capture(&p, number)).flatten()
            && !capture.nees.is_empty()
        {
            of_cameras.entry((!capture.is_head, capture.camera)).or_default().push(capture.nees);
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mut all, mut worst) = (Vec::new(), 0.0_f64);
    for ((is_foreign, camera), captures) in &of_cameras {
        let pooled = captures.concat();
        let inside = pooled.iter().filter(|v| **v <= REGION_95).count() as f64 / pooled.len() as f64;
        let greatest = captures.iter().map(|c| mean(c)).fold(0.0, f64::max);
        let what = if *is_foreign { "a part of it foreign" } else { "the head alone" };
        println!(
            "{camera:11} {what:21} captures {:4} poses {:5} NEES {:6.1} inside {:3.0} % worst capture {greatest:.1}",
            captures.len(),
            pooled.len(),
            mean(&pooled),
            100.0 * inside,
        );
        if !is_foreign {
            worst = worst.max(greatest);
            all.extend(pooled);
        }
    }
    let inside = all.iter().filter(|v| **v <= REGION_95).count() as f64 / all.len() as f64;
    assert!((1.0..8.0).contains(&mean(&all)), "NEES {:.1}", mean(&all));
    assert!(inside >= 0.92 && worst <= REGION_95, "{inside:.2} inside, worst capture {worst:.1}");
}
