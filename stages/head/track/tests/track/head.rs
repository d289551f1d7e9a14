//! `track.head` on a bench.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Registry, Stage};
use stillpoint_samples::{
    CloudShape, Command, ConsoleCommand, Point, PointCloud, Pose, PoseElement, PoseReport, PoseReportElement,
    PoseStatus, Rejection, RejectionElement, SurfacePiece, SurfacePieces, Verb,
};
use stillpoint_testing::Bench;
use stillpoint_testing::bench::Left;
use stillpoint_testing::pipeline::config::check;
use stillpoint_track::head::HeadParams;
use stillpoint_track::tracker::TrackParams;
use zerocopy::IntoBytes;

use crate::shapes::{camera_from_body, head, sphere};

const TEXT: &str = "
stillpoint: 1
name: track
frames: { camera: { parent: couch, at: [1 m, 2 m, 3 m], rotation: [0 deg, 0 deg, 90 deg] } }
operators:
  console: { use: console, every: 20 ms }
  feed: { use: feed.cloud, frame: camera }
  why: { use: feed.rejection }
  head: { use: track.head, inputs: { face: feed.out, command: console.capture, confirm: console.confirm, rejection: why.out }, frame: couch, params: { capture: first } }
";

fn stages() -> Vec<Stage> {
    [stillpoint_track::STAGES, stillpoint_testing::pipeline::STAGES].concat()
}

fn bench_with(text: &str, files: &MemoryFiles) -> Result<Bench, String> {
    Bench::new(text, "head", &stages(), files)
}

pub fn bench(change: impl Fn(&str) -> String) -> Bench {
    bench_with(&change(TEXT), &MemoryFiles::default()).unwrap()
}

/// A bench whose couch has the axes of the head, so that the parts of its face are found: `bench` turns the head by more
/// than any on a couch, and takes all of it for rigid.
pub fn lying(change: impl Fn(&str) -> String) -> Bench {
    bench(|text| change(&text.replace("[0 deg, 0 deg, 90 deg]", "[180 deg, 0 deg, 0 deg]")))
}

#[test]
fn a_tracker_has_the_operators_defaults() {
    let registry = Registry::new(&[stillpoint_testing::feed::STAGES, &stages()]);
    let graph = check(TEXT, "track.yaml", &[], &registry, &MemoryFiles::default()).unwrap();
    let head = graph.operator("head").unwrap();
    let params = graph.operators[head].params.value.downcast_ref::<HeadParams>().unwrap();
    assert_eq!(params.tracking(), TrackParams::default());
}

/// What one frame left: pose, three points, reference, report, pieces.
pub struct Said {
    pub pose: Option<PoseElement>,
    three_points: Option<PoseElement>,
    reference: Option<Vec<[f32; 3]>>,
    pub report: PoseReportElement,
    pub pieces: Vec<SurfacePiece>,
    bytes: Vec<u8>,
}

impl Said {
    pub fn status(&self) -> PoseStatus {
        PoseStatus::from_number(self.report.status).unwrap()
    }

    fn of(left: &Left) -> Self {
        assert_eq!(left.fault, None);
        let on = |port: usize| left.outputs.iter().find(|(p, _)| *p == port).map(|(_, owned)| owned);
        let pose = |port: usize| on(port).map(|p| *p.pieces().view::<Pose>().unwrap().first().unwrap());
        let cloud = on(2).map(|p| p.pieces().view::<PointCloud>().unwrap().elements.to_vec());
        Self {
            pose: pose(0),
            three_points: pose(1),
            reference: cloud.map(|c: Vec<Point>| c.iter().map(|p| p.xyz).collect()),
            report: *on(3).unwrap().pieces().view::<PoseReport>().unwrap().first().unwrap(),
            pieces: on(4)
                .map_or_else(Vec::new, |p| p.pieces().view::<SurfacePieces>().unwrap().elements.to_vec()),
            bytes: left.bytes(),
        }
    }
}

pub fn feed(bench: &mut Bench, cloud: &[Vector3<f64>]) -> Said {
    let points: Vec<Point> =
        cloud.iter().map(|p| Point { xyz: [p.x as f32, p.y as f32, p.z as f32] }).collect();
    feed_points(bench, &points)
}

fn feed_points(bench: &mut Bench, points: &[Point]) -> Said {
    let shape = CloudShape { width: points.len() as u32, height: 1, reserved: 0, length: 0 };
    Said::of(&bench.feed::<PointCloud>(0, &shape, points, 0))
}

/// A frame without a face.
fn reject(bench: &mut Bench) -> Said {
    let why = RejectionElement::new(4, "nothing there is a head", 0.0, 100.0);
    Said::of(&bench.feed::<Rejection>(2, &(), &[why], 0))
}

pub fn command(bench: &mut Bench, verb: Verb) {
    let command = Command { verb: verb as u32, ..Command::default() };
    let left = bench.feed::<ConsoleCommand>(1, &(), &[command], 0);
    assert!(left.fault.is_none() && left.outputs.is_empty());
}

/// A word on the input that confirms.
pub fn confirm(bench: &mut Bench, verb: Verb) {
    let command = Command { verb: verb as u32, ..Command::default() };
    let left = bench.feed::<ConsoleCommand>(3, &(), &[command], 0);
    assert!(left.fault.is_none() && left.outputs.is_empty());
}

/// A body moved in the camera's axes, turned about its own origin: m and rad.
pub fn moved(shift: [f64; 3], turn: [f64; 3]) -> Isometry3<f64> {
    let mut pose = camera_from_body();
    pose.translation.vector += Vector3::from(shift);
    pose.rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn)) * pose.rotation;
    pose
}

pub fn isometry(pose: &PoseElement) -> Isometry3<f64> {
    let [w, x, y, z] = pose.orientation;
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    Isometry3::from_parts(Vector3::from(pose.position).into(), rotation)
}

#[test]
fn the_first_face_is_the_reference_and_its_pose_a_translation_to_its_centroid() {
    let cloud = head(&camera_from_body());
    let element = feed(&mut bench(str::to_owned), &cloud);
    assert_eq!(element.status(), PoseStatus::Captured);
    assert_eq!(element.report.reference, 1);
    assert_eq!(element.reference.unwrap().len(), cloud.len());
    let pose = isometry(&element.pose.unwrap());
    assert!(pose.rotation.angle() < 1e-4, "{pose}");
    // A quarter turn about z takes the camera's x to the couch's y.
    let mean = cloud.iter().sum::<Vector3<f64>>() / cloud.len() as f64;
    let expected = Vector3::new(1.0 - mean.y, 2.0 + mean.x, 3.0 + mean.z);
    assert!((pose.translation.vector - expected).norm() < 5e-5, "{pose} {expected}");
}

#[test]
fn a_motion_of_the_head_is_given_in_the_couchs_axes_with_its_covariance() {
    let mut bench = bench(str::to_owned);
    let first = feed(&mut bench, &head(&camera_from_body())).pose.unwrap();
    let element = feed(&mut bench, &head(&moved([0.003, -0.002, 0.004], [0.05, 0.0, 0.0])));
    assert_eq!(element.status(), PoseStatus::Tracked);
    let pose = element.pose.unwrap();
    let turn = (isometry(&pose) * isometry(&first).inverse()).rotation.scaled_axis();
    // The camera's x is the couch's y.
    assert!((turn - Vector3::new(0.0, 0.05, 0.0)).norm() < 1e-3, "{turn}");
    let c = |i: usize, j: usize| pose.covariance[6 * i + j];
    for i in 0..6 {
        assert!(c(i, i) > 0.0 && c(i, i).sqrt() < 1e-3, "{i}: {}", c(i, i));
        for j in 0..6 {
            assert_eq!(c(i, j), c(j, i));
            assert!(c(i, j).abs() <= (c(i, i) * c(j, j)).sqrt() * (1.0 + 1e-9));
        }
    }
    let report = element.report;
    assert_eq!(report.refused, 0);
    assert!(report.sensitivity.windows(2).all(|s| s[0] >= s[1]));
    assert!(report.overlap > 0.8, "{}", report.overlap);
    assert!(report.direction_sd.iter().all(|sd| *sd < 1e-3), "{:?}", report.direction_sd);
    // The three points see the turn too, if less well.
    let three = isometry(&element.three_points.unwrap());
    assert!(three.rotation.angle() > 0.02 && element.report.three_points_gap > 0.0);
}

#[test]
fn the_pose_of_another_point_of_the_head_is_that_of_its_origin_seen_from_there() {
    let place = Vector3::new(0.02, 0.03, -0.06);
    let with_point =
        |text: &str| text.replace("capture: first", "capture: first, point: [20 mm, 30 mm, -60 mm]");
    let (mut of_origin, mut of_point) = (bench(str::to_owned), bench(with_point));
    for pose in [camera_from_body(), moved([0.003, -0.002, 0.004], [0.05, 0.1, 0.0])] {
        let cloud = head(&pose);
        let [origin, point] = [&mut of_origin, &mut of_point].map(|bench| feed(bench, &cloud).pose.unwrap());
        let (from, found) = (isometry(&origin), isometry(&point));
        let due = from * nalgebra::Translation3::from(place);
        assert!((found.to_homogeneous() - due.to_homogeneous()).norm() < 1e-12, "{found} {due}");
        // A turn of which little is known moves a point far away by much.
        let mut carried = nalgebra::Matrix6::<f64>::identity();
        let arm = (from.rotation * place).cross_matrix();
        carried.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm);
        let matrix = |e: &PoseElement| nalgebra::Matrix6::from_row_slice(&e.covariance);
        let due = carried * matrix(&origin) * carried.transpose();
        assert!((matrix(&point) - due).norm() < 1e-9 * due.norm(), "{}", matrix(&point) - due);
    }
}

#[test]
fn before_a_command_there_is_no_pose_and_it_is_said() {
    let mut bench = bench(|t| t.replace("capture: first", "capture: command, capture_seen: 1"));
    let cloud = head(&camera_from_body());
    for verb in [Verb::Arm, Verb::Capture] {
        let element = feed(&mut bench, &cloud);
        assert_eq!(element.status(), PoseStatus::NoReference);
        assert!(element.pose.is_none() && element.three_points.is_none() && element.reference.is_none());
        command(&mut bench, verb);
    }
    let element = feed(&mut bench, &cloud);
    assert_eq!(element.status(), PoseStatus::Captured);
    assert!(element.pose.is_some() && element.reference.is_some());
}

/// Frames of a head that breathes: no two are the same.
fn breathing(k: u32) -> Vec<Vector3<f64>> {
    head(&moved([1e-4 * f64::from(k), 0.0, 0.0], [0.0; 3]))
}

#[test]
fn a_person_captures_a_face_that_was_seen_in_the_frames_before() {
    let mut bench = bench(|t| t.replace("capture: first", "capture: command"));
    feed(&mut bench, &breathing(0));
    // Elsewhere, and nowhere.
    feed(&mut bench, &head(&moved([0.05, 0.0, 0.0], [0.0; 3])));
    reject(&mut bench);
    command(&mut bench, Verb::Capture);
    let mut statuses = Vec::new();
    for k in [1, 2, 2, 3] {
        statuses.push(feed(&mut bench, &breathing(k)).status());
    }
    // The third is the second again, which is no new frame.
    let refused = PoseStatus::CaptureRefused;
    assert_eq!(statuses, [refused, refused, refused, PoseStatus::Captured]);
}

#[test]
fn a_command_lapses_before_a_face_that_comes_later() {
    let within = "capture: command, capture_seen: 1, capture_within: 100 ms";
    let mut bench = bench(|t| t.replace("capture: first", within));
    command(&mut bench, Verb::Capture);
    // Frames come every 10 ms.
    let without: Vec<PoseStatus> = (0..12).map(|_| reject(&mut bench).status()).collect();
    assert_eq!(without.iter().filter(|s| **s == PoseStatus::CaptureLapsed).count(), 1, "{without:?}");
    assert_eq!(feed(&mut bench, &breathing(0)).status(), PoseStatus::NoReference);
    command(&mut bench, Verb::Capture);
    assert_eq!(feed(&mut bench, &breathing(1)).status(), PoseStatus::Captured);
}

#[test]
fn another_command_makes_another_reference() {
    let mut bench = bench(|t| t.replace("capture: first", "capture: first, capture_seen: 1"));
    feed(&mut bench, &head(&camera_from_body()));
    let cloud = head(&moved([0.005, 0.0, 0.0], [0.0, 0.1, 0.0]));
    let before = feed(&mut bench, &cloud);
    assert!(isometry(&before.pose.unwrap()).rotation.angle() > 0.05);
    command(&mut bench, Verb::Capture);
    let after = feed(&mut bench, &cloud);
    assert_eq!((after.status(), after.report.reference), (PoseStatus::Captured, 2));
    assert!(isometry(&after.pose.unwrap()).rotation.angle() < 1e-3);
}

#[test]
fn a_face_that_is_unfit_is_refused_and_the_next_one_captured() {
    let mut bench = bench(str::to_owned);
    let cloud = head(&camera_from_body());
    let element = feed(&mut bench, &cloud[..300]);
    assert_eq!(element.status(), PoseStatus::CaptureRefused);
    assert!(element.pose.is_none());
    assert_eq!(feed(&mut bench, &cloud).status(), PoseStatus::Captured);
}

#[test]
fn a_ball_is_not_captured_and_the_head_after_it_is() {
    let mut bench = bench(str::to_owned);
    let element = feed(&mut bench, &sphere(&camera_from_body(), 0.09));
    assert_eq!((element.status(), element.report.reference), (PoseStatus::CaptureRefused, 0));
    assert!(element.pose.is_none());
    assert_eq!(element.report.refused, 0b11_1000);
    assert!(element.report.sensitivity[3..].iter().all(|s| *s < 0.005), "{:?}", element.report.sensitivity);
    let head = feed(&mut bench, &head(&camera_from_body()));
    assert_eq!((head.status(), head.report.reference), (PoseStatus::Captured, 1));
}

#[test]
fn points_that_are_not_finite_are_left_out_and_counted() {
    let cloud = head(&camera_from_body());
    let clean = feed(&mut bench(str::to_owned), &cloud);
    let mut points: Vec<Point> =
        cloud.iter().map(|p| Point { xyz: [p.x as f32, p.y as f32, p.z as f32] }).collect();
    points.insert(100, Point { xyz: [f32::NAN; 3] });
    points.push(Point { xyz: [0.0, f32::INFINITY, 1.0] });
    let element = feed_points(&mut bench(str::to_owned), &points);
    assert_eq!(element.report.not_finite, 2);
    assert_eq!(element.pose, clean.pose);
    let none = feed_points(&mut bench(str::to_owned), &vec![Point { xyz: [f32::NAN; 3] }; 2000]);
    assert_eq!((none.status(), none.report.not_finite), (PoseStatus::CaptureRefused, 2000));
}

#[test]
fn a_lost_head_has_no_pose_and_is_found_again() {
    let mut bench = bench(str::to_owned);
    let cloud = head(&camera_from_body());
    feed(&mut bench, &cloud);
    let lost = feed(&mut bench, &sphere(&moved([0.05, 0.0, 0.1], [0.0; 3]), 0.05));
    assert_eq!(lost.status(), PoseStatus::Lost);
    assert!(lost.pose.is_none() && lost.report.overlap < 0.5);
    let few = feed(&mut bench, &cloud[..50]);
    assert_eq!(few.status(), PoseStatus::TooFewPoints);
    assert_eq!(feed(&mut bench, &cloud).status(), PoseStatus::Found);
    let next = head(&moved([0.001, 0.0, 0.0], [0.0; 3]));
    assert_eq!(feed(&mut bench, &next).status(), PoseStatus::Tracked);
}

/// What is said of a frame but its head, which has its time and number.
fn findings(element: &Said) -> (Option<PoseElement>, Option<PoseElement>, Vec<u8>) {
    (element.pose, element.three_points, element.report.as_bytes().to_vec())
}

#[test]
fn the_same_face_again_has_the_same_pose_to_the_bit() {
    for method in ["dense", "three_points"] {
        let mut bench = bench(|t| t.replace("capture: first", &format!("capture: first, method: {method}")));
        feed(&mut bench, &head(&camera_from_body()));
        let still = head(&moved([0.003, -0.002, 0.004], [0.05, 0.0, 0.0]));
        let first = feed(&mut bench, &still);
        assert_eq!(first.status(), PoseStatus::Tracked);
        for _ in 0..3 {
            let repeated = feed(&mut bench, &still);
            assert!(findings(&repeated) == findings(&first));
            assert!(repeated.bytes != first.bytes, "its time differs");
        }
        // Frames without a face, and points that are none, come between.
        reject(&mut bench);
        let mut points: Vec<Point> =
            still.iter().map(|p| Point { xyz: [p.x as f32, p.y as f32, p.z as f32] }).collect();
        points.insert(7, Point { xyz: [f32::NAN; 3] });
        let repeated = feed_points(&mut bench, &points);
        assert_eq!((repeated.pose, repeated.report.not_finite), (first.pose, 1));
        // One number that differs makes it another face.
        points[20].xyz[2] = points[20].xyz[2].next_up();
        assert!(feed_points(&mut bench, &points).report.as_bytes() != repeated.report.as_bytes());
    }
}

#[test]
fn a_lost_head_stays_lost_in_the_same_face_again() {
    let mut bench = bench(str::to_owned);
    feed(&mut bench, &head(&camera_from_body()));
    let elsewhere = sphere(&moved([0.05, 0.0, 0.1], [0.0; 3]), 0.05);
    let lost = feed(&mut bench, &elsewhere);
    let repeated = feed(&mut bench, &elsewhere);
    assert_eq!((lost.status(), repeated.pose), (PoseStatus::Lost, None));
    assert!(findings(&repeated) == findings(&lost));
}

#[test]
fn the_same_face_again_is_captured_where_that_is_asked_for() {
    let mut bench =
        bench(|t| t.replace("capture: first", "capture: first, capture_frames: 3, capture_seen: 1"));
    feed(&mut bench, &head(&camera_from_body()));
    let still = head(&moved([0.005, 0.0, 0.0], [0.0, 0.1, 0.0]));
    (0..4).for_each(|_| drop(feed(&mut bench, &still)));
    let before = feed(&mut bench, &still);
    assert!(isometry(&before.pose.unwrap()).rotation.angle() > 0.05);
    command(&mut bench, Verb::Capture);
    let captured = feed(&mut bench, &still);
    assert_eq!((captured.status(), captured.report.reference), (PoseStatus::Captured, 2));
    assert!(isometry(&captured.pose.unwrap()).rotation.angle() < 1e-3);
    // Gathered, complete, and then tracked on the surface of all three.
    let then = [(); 4].map(|()| feed(&mut bench, &still));
    assert!(then.iter().all(|element| element.status() == PoseStatus::Tracked));
    let sent = [0, 1, 2, 3].map(|i: usize| then[i].reference.as_ref().map(Vec::len));
    assert_eq!(sent, [None, Some(3 * still.len()), None, None]);
    assert!(findings(&then[0]) != findings(&then[2]) && findings(&then[2]) == findings(&then[3]));
}

#[test]
fn a_sphere_has_infinite_variance_where_it_is_refused() {
    for origin in ["centroid", "centre"] {
        let mut bench = bench(|t| {
            t.replace("capture: first", &format!("capture: first, directions: any, origin: {origin}"))
        });
        feed(&mut bench, &sphere(&camera_from_body(), 0.09));
        let element = feed(&mut bench, &sphere(&moved([0.002, 0.0, 0.001], [0.0; 3]), 0.09));
        assert_eq!(element.report.refused, 0b11_1000);
        assert!(element.report.direction_sd[3..].iter().all(|sd| *sd == f64::INFINITY));
        let pose = element.pose.unwrap();
        assert!((3..6).all(|i| pose.covariance[7 * i] == f64::INFINITY));
        // The centre's place is known; the surface's centroid slides with the turns.
        assert_eq!(pose.covariance[0].is_finite(), origin == "centre");
    }
}

#[test]
fn more_frames_make_one_reference_though_the_head_moves() {
    let mut bench = bench(|t| t.replace("capture: first", "capture: first, capture_frames: 3"));
    let mut last = None;
    for k in 0..3 {
        let element = feed(
            &mut bench,
            &head(&moved([0.001 * f64::from(k), 0.0, 0.0], [0.0, 0.01 * f64::from(k), 0.0])),
        );
        assert_eq!(element.reference.is_some(), k == 2, "{k}");
        last = element.reference;
    }
    // All three lie on the first.
    let first = feed(&mut self::bench(str::to_owned), &head(&camera_from_body())).reference.unwrap();
    let all = last.unwrap();
    assert!(all.len() > 2 * first.len());
    let mean = |cloud: &[[f32; 3]]| {
        cloud.iter().map(|p| Vector3::from(p.map(f64::from))).sum::<Vector3<f64>>() / cloud.len() as f64
    };
    assert!((mean(&all) - mean(&first)).norm() < 1e-3);
}

#[test]
fn a_reference_from_a_file_is_searched_for_and_sent() {
    let cloud = head(&camera_from_body());
    let points: Vec<[f32; 3]> = cloud.iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
    let mut files = MemoryFiles::default();
    let bytes = stillpoint_ingest::pcd::write_binary(&points, points.len());
    files.files.insert("face.pcd".into(), bytes);
    let text = TEXT.replace("capture: first", "capture: command, reference: face.pcd");
    let mut bench = bench_with(&text, &files).unwrap();
    let element = feed(&mut bench, &head(&moved([0.01, 0.02, 0.0], [0.0, 0.3, 0.0])));
    assert_eq!((element.status(), element.report.reference), (PoseStatus::Found, 1));
    assert_eq!(element.reference.unwrap().len(), points.len());
    let turn = isometry(&element.pose.unwrap()).rotation.angle();
    assert!((turn - 0.3).abs() < 2e-3, "{turn}");
}

#[test]
fn a_reference_that_is_no_face_is_refused_with_its_name() {
    let mut files = MemoryFiles::default();
    files.files.insert("face.pcd".into(), b"no cloud".to_vec());
    let text = TEXT.replace("capture: first", "reference: face.pcd");
    let refused = bench_with(&text, &files).err().unwrap();
    assert!(refused.contains("face.pcd"), "{refused}");
    let points = [[0.0, 0.0, 1.0]; 20];
    files.files.insert("face.pcd".into(), stillpoint_ingest::pcd::write_binary(&points, 20));
    let refused = bench_with(&text, &files).err().unwrap();
    assert!(refused.contains("face.pcd: the cloud holds 0 pieces of surface"), "{refused}");
}

#[test]
fn without_a_way_to_a_reference_it_does_not_start() {
    let text = TEXT.replace("capture: first", "capture: command").replace(", command: console.capture", "");
    let refused = bench_with(&text, &MemoryFiles::default()).err().unwrap();
    assert!(refused.contains("connect `command`"), "{refused}");
}

#[test]
fn three_points_may_make_the_pose() {
    let mut bench = bench(|t| t.replace("capture: first", "capture: first, method: three_points"));
    let element = feed(&mut bench, &head(&camera_from_body()));
    assert_eq!(element.pose, element.three_points);
    assert!(element.pose.is_some());
}

#[test]
fn equal_frames_give_equal_bytes_wherever_the_buffers_lie() {
    let frames = [camera_from_body(), moved([0.004, 0.0, 0.002], [0.02, 0.05, 0.0])].map(|p| head(&p));
    let all = |mut bench: Bench| frames.iter().flat_map(|f| feed(&mut bench, f).bytes).collect::<Vec<u8>>();
    let straight = all(bench(str::to_owned));
    assert!(straight == all(bench(str::to_owned).padded(4096)));
}

#[test]
fn a_frame_without_a_face_has_a_report_and_the_head_is_followed_on() {
    let mut bench = bench(str::to_owned);
    feed(&mut bench, &head(&camera_from_body()));
    let element = reject(&mut bench);
    assert_eq!((element.status(), element.report.reference), (PoseStatus::NoFace, 1));
    assert!(element.pose.is_none() && element.three_points.is_none() && element.report.overlap.is_nan());
    let element = feed(&mut bench, &head(&moved([2e-3, 0.0, 0.0], [0.0; 3])));
    assert_eq!(element.status(), PoseStatus::Tracked);
}
