//! `ingest.mcap` with depth images, cameras and folders of rosbag2.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::io::Cursor;

use proptest::prelude::*;
use stillpoint_cdr::Writer;
use stillpoint_ingest::INVALID_POINT;
use stillpoint_ingest::bag::{self, Bag, Selected};
use stillpoint_ingest::camera_info::{CameraInfo, Image};
use stillpoint_ingest::depth::{Intrinsics, deproject};
use stillpoint_ingest::depth_message::DepthMessage;
use stillpoint_ingest::operators::{AtEnd, IngestMcap, McapParams, Pace, Unit};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::{Operator, Registry};
use stillpoint_samples::PointCloud;
use stillpoint_testing::run;

const IMAGE: &str = "sensor_msgs/msg/Image";
const COMPRESSED: &str = "sensor_msgs/msg/CompressedImage";
const CAMERA: &str = "sensor_msgs/msg/CameraInfo";
/// fx, fy, cx, cy of an image of 3 x 2 pixels.
const MATRIX: [f64; 4] = [500.0, 400.0, 1.0, 0.5];
const COUNTS: [u16; 6] = [1000, 0, 1234, 65535, 1, 777];
const MS: u64 = 1_000_000;

fn message(fill: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    fill(&mut Writer::new(&mut bytes));
    bytes
}

fn image(stamp: u64, encoding: &str, big_endian: bool, step: u32, data: &[u8]) -> Vec<u8> {
    message(|w| {
        w.header(stamp, "camera");
        w.u32(2);
        w.u32(3);
        w.text(encoding);
        w.u8(u8::from(big_endian));
        w.u32(step);
        w.bytes(data);
    })
}

fn millimetres(stamp: u64) -> Vec<u8> {
    image(stamp, "16UC1", false, 6, &COUNTS.map(u16::to_le_bytes).concat())
}

fn compressed(format: &str, data: &[u8]) -> Vec<u8> {
    message(|w| {
        w.header(7, "camera");
        w.text(format);
        w.bytes(data);
    })
}

fn camera(width: u32, model: &str, d: &[f64], binning: u32) -> Vec<u8> {
    let [fx, fy, cx, cy] = MATRIX;
    message(|w| {
        w.header(7, "camera");
        w.u32(2);
        w.u32(width);
        w.text(model);
        w.u32(d.len() as u32);
        w.f64s(d);
        w.f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        w.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        w.f64s(&[2.0 * fx, 0.0, cx, 0.0, 0.0, 2.0 * fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
        [binning, binning, 0, 0, 0, 0].into_iter().for_each(|n| w.u32(n));
        w.u8(0);
    })
}

fn pinhole() -> Vec<u8> {
    camera(3, "plumb_bob", &[0.0; 5], 0)
}

/// Topic, schema, log time and bytes of each message.
fn recording(messages: &[(&str, &str, u64, Vec<u8>)]) -> Vec<u8> {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    for (number, (topic, schema, log_time, data)) in messages.iter().enumerate() {
        let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
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

fn files(list: &[(&str, Vec<u8>)]) -> MemoryFiles {
    MemoryFiles { files: list.iter().map(|(n, b)| ((*n).to_string(), b.clone())).collect() }
}

/// Origin, offset from the start of the run, and points of each cloud of 500 ms.
type Sent = Vec<(u64, Vec<[f32; 3]>)>;

fn clouds(every: &str, params: &str, files: &MemoryFiles) -> Result<Sent, String> {
    let text = format!(
        "stillpoint: 1\nname: bags\nframes: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}\noperators:\n  \
         it: {{ use: ingest.mcap, every: {every}, frame: camera, params: {{ {params} }} }}\n"
    );
    let run = run(&text, &Registry::new(&[stillpoint_ingest::STAGES]), files, 500)?;
    assert_eq!(run.failed(), [] as [&str; 0]);
    let samples = run.samples::<PointCloud>("it.cloud");
    let start = samples.first().map_or(0, |first| first.header.origin);
    let points = |c: &stillpoint_samples::View<'_, PointCloud>| c.elements.iter().map(|p| p.xyz).collect();
    Ok(samples.iter().map(|c| (c.header.origin - start, points(c))).collect())
}

fn refused(params: &str, files: &MemoryFiles) -> String {
    clouds("100 ms", params, files).unwrap_err()
}

fn bits(points: &[[f32; 3]]) -> Vec<[u32; 3]> {
    points.iter().map(|p| p.map(f32::to_bits)).collect()
}

/// What `ingest.depth` makes of the same counts.
fn expected() -> Vec<[f32; 3]> {
    let [fx, fy, cx, cy] = MATRIX;
    let mut points = [[0.0; 3]; 6];
    deproject(&COUNTS, 3, 2, &Intrinsics { fx, fy, cx, cy, metres_per_count: 1e-3 }, &mut points).unwrap();
    points.to_vec()
}

fn png(counts: &[u16]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 3, 2);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let big_endian: Vec<u8> = counts.iter().flat_map(|c| c.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&big_endian).unwrap();
    bytes
}

#[test]
fn depth_images_are_the_clouds_that_their_pixels_are() {
    let big_endian = {
        // Rows with a gap behind them.
        let row =
            |counts: &[u16]| [counts.iter().flat_map(|c| c.to_be_bytes()).collect(), vec![9; 2]].concat();
        image(2, "16UC1", true, 8, &[row(&COUNTS[..3]), row(&COUNTS[3..])].concat())
    };
    let compressed_depth = [&[0; 12][..], &png(&COUNTS)].concat();
    let of = |schema, bytes| {
        files(&[(
            "r.mcap",
            recording(&[("/d/camera_info", CAMERA, 1, pinhole()), ("/d/image", schema, 2, bytes)]),
        )])
    };
    for (schema, bytes) in [
        (IMAGE, millimetres(2)),
        (IMAGE, big_endian),
        (COMPRESSED, compressed("16UC1; png compressed ", &png(&COUNTS))),
        (COMPRESSED, compressed("16UC1; compressedDepth", &compressed_depth)),
    ] {
        let sent = clouds("100 ms", "file: r.mcap, topic: /d/image", &of(schema, bytes)).unwrap();
        assert_eq!(sent.len(), 1);
        assert_eq!(bits(&sent[0].1), bits(&expected()));
    }
    let metres = [1.0_f32, f32::NAN, 0.0, f32::INFINITY, -1.0, 0.5];
    let data: Vec<u8> = metres.iter().flat_map(|m| m.to_le_bytes()).collect();
    let sent =
        clouds("100 ms", "file: r.mcap, topic: /d/image", &of(IMAGE, image(2, "32FC1", false, 12, &data)));
    let points = &sent.unwrap()[0].1;
    assert_eq!((points[0], points[5]), ([-1.0 / 500.0, -0.5 / 400.0, 1.0], [0.5 / 500.0, 0.25 / 400.0, 0.5]));
    assert_eq!(bits(&points[1..5]), bits(&[INVALID_POINT; 4]));
}

#[test]
fn metres_that_were_quantised_by_their_inverse_come_back() {
    // As compressed_depth_image_transport has it, for 10 m at 100 counts per metre: a = 100 * 101, b = 1 - a / 10.
    let (a, b) = (10_100.0_f32, -1009.0_f32);
    let head = [&[0; 4][..], &a.to_le_bytes(), &b.to_le_bytes()].concat();
    let counts = [0.5, 1.0, 2.0, 4.0, 8.0].map(|depth: f32| (a / depth + b).round() as u16);
    let counts = [&[0][..], &counts].concat();
    let bytes = compressed("32FC1; compressedDepth png", &[head, png(&counts)].concat());
    let camera = CameraInfo::parse(&pinhole(), Image::Raw).unwrap();
    let mut points = [[0.0; 3]; 6];
    let message = DepthMessage::parse_compressed(&bytes, None).unwrap();
    message.points_into([3, 2], &camera.rays().unwrap(), &mut points).unwrap();
    assert_eq!(bits(&points[..1]), bits(&[INVALID_POINT]));
    for (point, depth) in points[1..].iter().zip([0.5, 1.0, 2.0, 4.0, 8.0]) {
        assert!((point[2] - depth).abs() < depth * depth / a, "{point:?}");
    }
}

#[test]
fn images_that_are_no_depth_are_refused_with_what_they_are() {
    let description = |schema, bytes| {
        let files = files(&[(
            "r.mcap",
            recording(&[("/d/camera_info", CAMERA, 1, pinhole()), ("/d/image", schema, 2, bytes)]),
        )]);
        refused("file: r.mcap, topic: /d/image", &files)
    };
    let colour = description(IMAGE, image(2, "rgb8", false, 9, &[0; 18]));
    assert!(colour.contains("message 1 by time: its pixels are `rgb8`; a depth image has 16UC1"), "{colour}");
    let jpeg = description(COMPRESSED, compressed("bgr8; jpeg compressed bgr8", &[0xff, 0xd8]));
    assert!(jpeg.contains("its format is `bgr8; jpeg compressed bgr8`, and its bytes are not PNG"), "{jpeg}");
    let short = description(IMAGE, image(2, "16UC1", false, 6, &[0; 11]));
    assert!(short.contains("3 x 2 pixels of 2 bytes in rows of 6 do not fit 11 bytes"), "{short}");
}

#[test]
fn a_camera_is_looked_for_beside_its_images_or_named() {
    let file = |topics: [&str; 2]| {
        files(&[(
            "r.mcap",
            recording(&[(topics[0], IMAGE, 2, millimetres(2)), (topics[1], CAMERA, 3, pinhole())]),
        )])
    };
    for topics in [
        ["/c/depth/image_raw", "/c/depth/camera_info"],
        ["/cam/image", "/cam/image/camera_info"],
        ["/c/depth/image/compressedDepth", "/c/depth/camera_info"],
    ] {
        let sent = clouds("100 ms", &format!("file: r.mcap, topic: {}", topics[0]), &file(topics)).unwrap();
        assert_eq!(bits(&sent[0].1), bits(&expected()), "{topics:?}");
    }
    let apart = file(["/a/image", "/b/info"]);
    let none = refused("file: r.mcap, topic: /a/image", &apart);
    assert!(
        none.contains(
            "it has no sensor_msgs/msg/CameraInfo on /a/camera_info or /a/image/camera_info, but on /b/info"
        ),
        "{none}"
    );
    assert_eq!(
        clouds("100 ms", "file: r.mcap, topic: /a/image, camera_info: /b/info", &apart).unwrap().len(),
        1
    );
    let size = files(&[(
        "r.mcap",
        recording(&[
            ("/d/image", IMAGE, 2, millimetres(2)),
            ("/d/camera_info", CAMERA, 3, camera(4, "", &[], 0)),
        ]),
    )]);
    let error = refused("file: r.mcap, topic: /d/image", &size);
    assert!(error.contains("it has 3 x 2 pixels, its CameraInfo [4, 2]"), "{error}");
}

/// The Brown-Conrady model, written down once more.
fn distorted([x, y]: [f64; 2], d: &[f64]) -> [f64; 2] {
    let k = |place: usize| d.get(place).copied().unwrap_or(0.0);
    let r2 = x * x + y * y;
    let radial = (1.0 + k(0) * r2 + k(1) * r2.powi(2) + k(4) * r2.powi(3))
        / (1.0 + k(5) * r2 + k(6) * r2.powi(2) + k(7) * r2.powi(3));
    [
        x * radial + 2.0 * k(2) * x * y + k(3) * (r2 + 2.0 * x * x),
        y * radial + k(2) * (r2 + 2.0 * y * y) + 2.0 * k(3) * x * y,
    ]
}

#[test]
fn distortion_is_undone_and_what_cannot_be_is_refused() {
    let kinect = [0.09, -0.27, 5e-4, -8e-4, 0.1, 0.02, -0.01, 0.003];
    for (model, d) in [("plumb_bob", &kinect[..5]), ("rational_polynomial", &kinect[..])] {
        let rays = CameraInfo::parse(&camera(3, model, d, 0), Image::Raw).unwrap().rays().unwrap();
        for (number, ray) in rays.into_iter().enumerate() {
            let [u, v] = distorted(ray, d);
            let [fx, fy, cx, cy] = MATRIX;
            let off = [u * fx + cx - (number % 3) as f64, v * fy + cy - (number / 3) as f64];
            assert!(off.iter().all(|pixels| pixels.abs() < 1e-3), "{off:?}");
        }
    }
    // Rectified images have the projection, twice the focal length here.
    let rays = CameraInfo::parse(&camera(3, "plumb_bob", &kinect[..5], 0), Image::Rectified)
        .unwrap()
        .rays()
        .unwrap();
    assert_eq!(rays[2], [1.0 / 1000.0, -0.5 / 800.0]);
    let description = |bytes: &[u8]| {
        CameraInfo::parse(bytes, Image::Raw).and_then(|info| info.rays().map(|_| ())).unwrap_err().to_string()
    };
    let fish = description(&camera(3, "equidistant", &[0.1; 4], 0));
    assert!(fish.contains("`equidistant` with 4 numbers is not known"), "{fish}");
    let folded = description(&camera(3, "plumb_bob", &[-1e6, 0.0, 0.0, 0.0, 0.0], 0));
    assert!(folded.contains("the distortion cannot be undone at column 0, row 0"), "{folded}");
    // Half of the pixels in a row, and half of the focal length.
    let binned = CameraInfo::parse(&camera(3, "plumb_bob", &[], 2), Image::Raw).unwrap();
    assert_eq!(([binned.width, binned.height], binned.matrix), ([1, 1], [250.0, 200.0, 0.5, 0.25]));
}

#[test]
fn a_recording_at_its_own_pace_has_its_own_times_of_acquisition() {
    let stamps = [1_000, 1_033, 1_066, 1_100];
    let mut messages = vec![("/d/camera_info", CAMERA, 0, pinhole())];
    // Recorded later than they were taken, and not as regularly.
    let late = [1_050, 1_060, 1_120, 1_121];
    messages
        .extend(stamps.iter().zip(late).map(|(ms, log)| ("/d/image", IMAGE, log * MS, millimetres(ms * MS))));
    let files = files(&[("r.mcap", recording(&messages))]);
    let sent = clouds("10 ms", "file: r.mcap, topic: /d/image, pace: recorded", &files).unwrap();
    let origins: Vec<u64> = sent.iter().map(|(origin, _)| *origin / MS).collect();
    assert_eq!(origins, [0, 33, 66, 100]);
    let slow = clouds("100 ms", "file: r.mcap, topic: /d/image, pace: recorded", &files).unwrap_err();
    assert!(slow.contains("its messages come every 33.3 ms, and a tick sends one: lower `every`"), "{slow}");
    let ticks = clouds("100 ms", "file: r.mcap, topic: /d/image", &files).unwrap();
    let origins: Vec<u64> = ticks.iter().map(|(origin, _)| *origin / MS).collect();
    assert_eq!(origins, [0, 100, 200, 300]);
}

#[test]
fn messages_without_stamps_have_their_log_times() {
    let mut messages = vec![("/d/camera_info", CAMERA, 0, pinhole())];
    messages.extend([10, 40].map(|log| ("/d/image", IMAGE, log * MS, millimetres(0))));
    let files = files(&[("r.mcap", recording(&messages))]);
    let sent = clouds("10 ms", "file: r.mcap, topic: /d/image, pace: recorded", &files).unwrap();
    assert_eq!(sent.iter().map(|(origin, _)| *origin / MS).collect::<Vec<_>>(), [0, 30]);
}

const METADATA: &str = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  relative_file_paths:\n    \
                        - b_0.mcap\n    - b_1.mcap\n";

fn two_files(metadata: &str) -> MemoryFiles {
    files(&[
        ("bag/metadata.yaml", metadata.as_bytes().to_vec()),
        (
            "bag/b_0.mcap",
            recording(&[("/d/camera_info", CAMERA, 1, pinhole()), ("/d/image", IMAGE, 20, millimetres(20))]),
        ),
        (
            "bag/b_1.mcap",
            recording(&[("/d/image", IMAGE, 10, millimetres(10)), ("/d/image", IMAGE, 30, millimetres(30))]),
        ),
        ("bag/notes.txt", vec![1]),
    ])
}

#[test]
fn a_folder_of_rosbag2_is_one_recording() {
    let sent = clouds("10 ms", "file: bag, topic: /d/image", &two_files(METADATA)).unwrap();
    assert_eq!(sent.len(), 3);
    let one = METADATA.replace("    - b_1.mcap\n", "");
    assert_eq!(clouds("10 ms", "file: bag, topic: /d/image", &two_files(&one)).unwrap().len(), 1);
    let more = format!("{METADATA}    - b_2.mcap\n");
    let error = refused("file: bag, topic: /d/image", &two_files(&more));
    assert!(error.contains("it lists b_2.mcap, which is not there"), "{error}");
    let database =
        refused("file: bag, topic: /d/image", &two_files(&METADATA.replace(": mcap", ": sqlite3")));
    assert!(
        database
            .contains("its storage is sqlite3, which is not read: convert it to MCAP with `rosbags-convert"),
        "{database}"
    );
    let lone = refused("file: bag/b_0.db3, topic: /d/image", &files(&[("bag/b_0.db3", vec![0; 9])]));
    assert!(lone.contains("its storage is sqlite3"), "{lone}");
}

#[test]
fn the_checker_says_that_a_topic_is_missing_or_of_another_type_and_where() {
    let files = files(&[(
        "r.mcap",
        recording(&[("/d/image", IMAGE, 2, millimetres(2)), ("/d/camera_info", CAMERA, 3, pinhole())]),
    )]);
    let missing = refused("file: r.mcap, topic: /points", &files);
    assert!(missing.contains("r.mcap: it has no messages on /points, but on /d/image"), "{missing}");
    assert!(missing.contains("test.yaml:5:"), "the place: {missing}");
    let other = refused("file: r.mcap, topic: /d/camera_info", &files);
    assert!(
        other.contains("the topic /d/camera_info has sensor_msgs/msg/CameraInfo in cdr, not one of"),
        "{other}"
    );
}

fn params(file: &str, skip: u32, frames: Option<u32>) -> McapParams {
    McapParams {
        file: file.into(),
        topic: "/d/image".into(),
        camera_info: None,
        depth_unit: None,
        unit: Unit::M,
        image: None,
        pace: Pace::Ticks,
        max_gap: 60_000_000_000,
        strict: false,
        skip,
        frames,
        at_end: AtEnd::Stop,
        max_points: 100,
    }
}

/// A session keeps the part, and its replay reads the part.
#[test]
fn of_a_recording_that_part_is_kept_that_is_read_and_it_reads_alike() {
    let noise: Vec<u8> = (0..60_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let mut messages = vec![("/d/camera_info", CAMERA, 0, pinhole())];
    messages.extend((1..9).map(|ms| ("/d/image", IMAGE, ms * MS, millimetres(ms * MS))));
    messages.extend((1..9).map(|ms| ("/colour", IMAGE, ms * MS, image(ms * MS, "rgb8", false, 9, &noise))));
    let whole = files(&[("r.mcap", recording(&messages)), ("bag/metadata.yaml", METADATA.into())]);
    let of = [params("r.mcap", 2, Some(2)), params("r.mcap", 5, Some(1))];
    let cut = IngestMcap::cut_files(&of.iter().collect::<Vec<_>>(), &whole).unwrap();
    assert_eq!(cut.keys().collect::<Vec<_>>(), ["r.mcap"]);
    let (before, after) = (whole.files["r.mcap"].len(), cut["r.mcap"].len());
    assert!(after * 5 < before, "{after} of {before} bytes");
    let checked = MemoryFiles { files: cut };
    for part in ["skip: 2, frames: 2", "skip: 5, frames: 1"] {
        let it = format!("file: r.mcap, topic: /d/image, pace: recorded, {part}");
        let read = |files| {
            clouds("1 ms", &it, files).unwrap().into_iter().map(|(o, p)| (o, bits(&p))).collect::<Vec<_>>()
        };
        assert_eq!(read(&checked), read(&whole), "{part}");
    }
    let bag = cut_of_folder();
    assert!(bag.files.keys().all(|name| name.ends_with(".mcap")), "{:?}", bag.files.keys());
}

/// The parts of a folder, which read as the folder does.
fn cut_of_folder() -> MemoryFiles {
    let whole = two_files(METADATA);
    let of = params("bag/*", 1, Some(1));
    let cut = MemoryFiles { files: IngestMcap::cut_files(&[&of], &whole).unwrap() };
    let mut checked = whole.clone();
    checked.files.extend(cut.files.clone());
    let it = "file: bag, topic: /d/image, skip: 1, frames: 1";
    let read =
        |files| clouds("10 ms", it, files).unwrap().into_iter().map(|(_, p)| bits(&p)).collect::<Vec<_>>();
    assert_eq!(read(&checked), read(&whole));
    cut
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn broken_messages_are_refused_without_a_panic(
        which in 0..5_usize, cuts in 0..400_usize, at in 0..400_usize, byte in any::<u8>(),
    ) {
        let mut bytes = match which {
            0 => millimetres(1),
            1 => compressed("16UC1; compressedDepth", &[&[0; 12][..], &png(&COUNTS)].concat()),
            2 => compressed("32FC1; compressedDepth", &[&[1; 12][..], &png(&COUNTS)].concat()),
            3 => pinhole(),
            _ => camera(3, "plumb_bob", &[0.1, 0.0, 0.0, 0.0, 0.0], 0),
        };
        bytes.truncate(bytes.len().saturating_sub(cuts / 8));
        if let Some(place) = bytes.get_mut(at) {
            *place = byte;
        }
        if let Ok(info) = CameraInfo::parse(&bytes, Image::Raw)
            && u64::from(info.width) * u64::from(info.height) < 1_000
        {
            let _ = info.rays();
        }
        let rays = [[0.0; 2]; 6];
        for message in [DepthMessage::parse(&bytes, None), DepthMessage::parse_compressed(&bytes, None)].into_iter().flatten() {
            let _ = message.points_into([3, 2], &rays, &mut [[0.0; 3]; 6]);
        }
    }

    #[test]
    fn broken_recordings_are_refused_without_a_panic(at in 0..2_000_usize, byte in any::<u8>(), keep in 0..3_000_usize) {
        let mut files = two_files(METADATA);
        for name in ["bag/b_0.mcap", "bag/metadata.yaml"] {
            let bytes = files.files.get_mut(name).unwrap();
            let place = at % bytes.len();
            bytes[place] = byte;
            bytes.truncate(keep.max(20));
        }
        if let Ok(bag) = Bag::open(&files, "bag") {
            let selected = Selected { topic: "/d/image", camera_info: None, skip: 0, frames: None };
            if let Ok(selection) = bag::select(&bag, &selected) {
                let _ = bag::cut(&bag, &[selection]);
            }
        }
    }
}
