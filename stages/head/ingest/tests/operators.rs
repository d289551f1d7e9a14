//! `ingest.depth`, `ingest.pcd` and `ingest.mcap` with files and with a rig's port.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::io::Cursor;

use proptest::prelude::*;
use stillpoint_ingest::pcd::{write_ascii, write_binary};
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{DepthImage, Intrinsics, PointCloud};
use stillpoint_testing::{Bench, feed, run};

const HEAD: &str = "
stillpoint: 1
name: ingest
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
";
const CAMERA: &str = "camera: { fx: 100 px, fy: 50 px, cx: 1 px, cy: 0 px, depth_unit: 0.1 mm }";

fn files(list: &[(&str, Vec<u8>)]) -> MemoryFiles {
    MemoryFiles { files: list.iter().map(|(n, b)| ((*n).to_string(), b.clone())).collect() }
}

fn png(width: u32, height: u32, counts: &[u16]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let big_endian: Vec<u8> = counts.iter().flat_map(|c| c.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&big_endian).unwrap();
    bytes
}

/// Width, height and points.
type Cloud = (u32, u32, Vec<[f32; 3]>);

/// Clouds that one operator sends in 500 ms with a tick each 100 ms.
fn clouds(operator: &str, files: &MemoryFiles) -> Result<Vec<Cloud>, String> {
    let registry = Registry::new(&[feed::STAGES, stillpoint_ingest::STAGES]);
    let run = run(&format!("{HEAD}  it: {operator}\n"), &registry, files, 500)?;
    assert_eq!(run.failed(), [] as [&str; 0]);
    let samples = run.samples::<PointCloud>("it.cloud");
    let points = |c: &stillpoint_samples::View<'_, PointCloud>| c.elements.iter().map(|p| p.xyz).collect();
    Ok(samples.iter().map(|c| (c.body.width, c.body.height, points(c))).collect())
}

fn refused(operator: &str, files: &MemoryFiles) -> String {
    clouds(operator, files).unwrap_err()
}

#[test]
fn depth_files_become_clouds_in_the_order_of_their_names() {
    let files = files(&[
        ("scans/b_depth.png", png(2, 1, &[0, 20_000])),
        ("scans/a_depth.png", png(2, 1, &[10_000, 0])),
        ("scans/a_label.png", vec![1, 2, 3]),
    ]);
    let it = format!(
        "{{ use: ingest.depth, every: 100 ms, frame: camera, params: {{ files: scans/*_depth.png, {CAMERA} }} }}"
    );
    let sent = clouds(&it, &files).unwrap();
    assert_eq!(sent.len(), 2);
    assert_eq!((sent[0].0, sent[0].1, sent[0].2[0]), (2, 1, [-0.01, 0.0, 1.0]));
    assert!(sent[0].2[1][2].is_nan());
    assert_eq!(sent[1].2[1], [0.0, 0.0, 2.0]);
    let repeated = clouds(&it.replace("files: scans", "at_end: repeat, files: scans"), &files).unwrap();
    assert_eq!(repeated.len(), 5);
    assert_eq!(repeated[2].2[0], sent[0].2[0]);
}

#[test]
fn depth_without_or_with_two_origins_is_refused_with_what_to_do() {
    let files = files(&[("a.png", png(1, 1, &[1]))]);
    let none = refused("{ use: ingest.depth, every: 100 ms, frame: camera }", &files);
    assert!(none.contains("it has neither `image` nor `files`: connect or name one of them"), "{none}");
    let bare =
        refused("{ use: ingest.depth, every: 100 ms, frame: camera, params: { files: a.png } }", &files);
    assert!(bare.contains("its files have no intrinsics: add `camera`"), "{bare}");
    let both = format!(
        "{{ use: ingest.depth, frame: camera, inputs: {{ image: f.out }}, params: {{ files: a.png, {CAMERA} }} }}\n  f: {{ use: feed.image, frame: camera }}"
    );
    let both = refused(&both, &files);
    assert!(both.contains("it has both `image` and `files`: remove one of them"), "{both}");
}

#[test]
fn a_broken_file_is_named_before_the_first_tick() {
    let files = files(&[("scans/0.png", png(2, 1, &[1, 1])), ("scans/1.png", vec![7; 40])]);
    let it = format!(
        "{{ use: ingest.depth, every: 100 ms, frame: camera, params: {{ files: scans, strict: true, {CAMERA} }} }}"
    );
    let error = refused(&it, &files);
    assert!(error.contains("scans/1.png: the depth image is not a readable PNG"), "{error}");
}

#[test]
fn pcd_files_become_clouds() {
    let points = [[0.5, 1.0, 2.0], [f32::NAN; 3], [-1.0, 0.0, 1.0], [0.0, 0.25, 3.0]];
    let files = files(&[
        ("c/0.pcd", write_ascii(&points, 2).into_bytes()),
        ("c/1.pcd", write_binary(&points[..3], 3)),
    ]);
    let sent =
        clouds("{ use: ingest.pcd, every: 100 ms, frame: camera, params: { files: c } }", &files).unwrap();
    assert_eq!(sent.iter().map(|c| (c.0, c.1)).collect::<Vec<_>>(), [(2, 2), (3, 1)]);
    assert_eq!((sent[0].2[0], sent[0].2[3]), (points[0], points[3]));
    assert!(sent[1].2[1][0].is_nan());
    let it = "{ use: ingest.pcd, every: 100 ms, frame: camera, params: { files: c, max_points: 3 } }";
    let error = refused(it, &files);
    assert!(error.contains("c/0.pcd: it has 4 points: raise `max_points`"), "{error}");
}

/// A message of one row of points without other fields.
fn message(points: &[[f32; 3]]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    let mut words = vec![1, 2, 1, 0, 1, points.len() as u32, 3];
    for (name, offset) in [(b'x', 0), (b'y', 4), (b'z', 8)] {
        // A text of two bytes, an offset, a datatype, a count.
        words.extend([2, u32::from(name), offset, 7, 1]);
    }
    words.extend([0, 12, 12 * points.len() as u32, 12 * points.len() as u32]);
    out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    out.extend(points.iter().flatten().flat_map(|c| c.to_le_bytes()));
    out.push(0);
    out
}

fn recording(messages: &[(&str, u64, Vec<u8>)]) -> Vec<u8> {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/PointCloud2", "ros2msg", b"").unwrap();
    let mut channels = BTreeMap::new();
    for (number, (topic, log_time, data)) in messages.iter().enumerate() {
        let channel_id = *channels
            .entry(*topic)
            .or_insert_with(|| writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap());
        let header = mcap::records::MessageHeader {
            channel_id,
            sequence: number as u32,
            log_time: *log_time,
            publish_time: *log_time,
        };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn clouds_of_a_recording_are_sent_in_the_order_of_their_times() {
    let (a, b) = ([[1.0, 2.0, 3.0], [f32::NAN; 3]], [[4.0, 5.0, 6.0]]);
    let files = files(&[(
        "r.mcap",
        recording(&[("/cam", 20, message(&b)), ("/other", 15, message(&a)), ("/cam", 10, message(&a))]),
    )]);
    let it = "{ use: ingest.mcap, every: 100 ms, frame: camera, params: { file: r.mcap, topic: /cam } }";
    let sent = clouds(it, &files).unwrap();
    assert_eq!(sent.iter().map(|c| (c.0, c.1)).collect::<Vec<_>>(), [(2, 1), (1, 1)]);
    assert_eq!((sent[0].2[0], sent[1].2[0]), (a[0], b[0]));
    let one = clouds(&it.replace("topic: /cam", "topic: /cam, skip: 1, frames: 1"), &files).unwrap();
    assert_eq!(one.iter().map(|c| c.2[0]).collect::<Vec<_>>(), [b[0]]);
    let cut = MemoryFiles { files: [("r.mcap".to_string(), files.files["r.mcap"][..300].to_vec())].into() };
    let error = refused(it, &cut);
    assert!(error.contains("repair a copy of it with `stillpoint recover`"), "{error}");
}

#[test]
fn a_recording_without_the_topic_names_those_that_it_has() {
    let files = files(&[("r.mcap", recording(&[("/cam", 1, message(&[]))])), ("s.mcap", vec![1; 90])]);
    let it = "{ use: ingest.mcap, every: 100 ms, frame: camera, params: { file: r.mcap, topic: /points } }";
    let error = refused(it, &files);
    assert!(error.contains("r.mcap: it has no messages on /points, but on /cam"), "{error}");
    assert!(refused(&it.replace("r.mcap", "s.mcap"), &files).contains("s.mcap: "));
}

#[test]
fn a_broken_message_is_named_by_its_number() {
    let mut cut = message(&[[1.0; 3]]);
    cut.truncate(60);
    let files = files(&[("r.mcap", recording(&[("/cam", 2, cut), ("/cam", 1, message(&[]))]))]);
    let it = "{ use: ingest.mcap, every: 100 ms, frame: camera, params: { file: r.mcap, topic: /cam, strict: true } }";
    let error = refused(it, &files);
    assert!(error.contains("r.mcap: message 2 by time: it ends at byte 60"), "{error}");
}

fn port() -> Bench {
    let text = format!(
        "{HEAD}  f: {{ use: feed.image, frame: camera }}\n  it: {{ use: ingest.depth, frame: camera, inputs: {{ image: f.out }}, params: {{ max_pixels: 64 }} }}\n"
    );
    Bench::new(&text, "it", stillpoint_ingest::STAGES, &MemoryFiles::default()).unwrap()
}

fn intrinsics(width: u32, height: u32) -> Intrinsics {
    Intrinsics {
        fx: 100.0,
        fy: 50.0,
        cx: 1.0,
        cy: 0.0,
        depth_unit: 1e-4,
        width,
        height,
        reserved: 0,
        length: 0,
    }
}

#[test]
fn an_image_is_deprojected_with_its_own_intrinsics_wherever_the_buffers_lie() {
    let left =
        |padding| port().padded(padding).feed::<DepthImage>(0, &intrinsics(2, 2), &[10_000, 0, 20_000, 1], 0);
    let sent = left(0);
    let cloud = sent.outputs[0].1.pieces().view::<PointCloud>().unwrap();
    assert_eq!((cloud.body.width, cloud.body.height), (2, 2));
    assert_eq!(cloud.elements[2].xyz, [-0.02, 0.04, 2.0]);
    assert!(left(0).bytes() == left(11).bytes());
}

#[test]
fn an_image_in_another_frame_than_the_cloud_is_refused() {
    let text = format!(
        "{HEAD}  f: {{ use: feed.image, frame: camera }}\n  it: {{ use: ingest.depth, frame: couch, inputs: {{ image: f.out }} }}\n"
    );
    let error = Bench::new(&text, "it", stillpoint_ingest::STAGES, &MemoryFiles::default()).err().unwrap();
    assert!(error.contains("write `frame: camera`"), "{error}");
}

proptest! {
    #[test]
    fn no_image_makes_it_panic(
        numbers in prop::array::uniform5(prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(0.0), Just(1e308), -1e3..1e3f64]),
        width in prop_oneof![0u32..20, Just(u32::MAX)],
        height in prop_oneof![0u32..20, Just(u32::MAX)],
        counts in prop::collection::vec(any::<u16>(), 0..80),
        fits in any::<bool>(),
    ) {
        let [fx, fy, cx, cy, depth_unit] = numbers;
        let (width, height) = if fits { (counts.len() as u32, 1) } else { (width, height) };
        let body = Intrinsics { fx, fy, cx, cy, depth_unit, width, height, reserved: 0, length: 0 };
        prop_assert!(!port().feed::<DepthImage>(0, &body, &counts, 0).panicked);
    }
}
