//! What clouds and images take from the heap, from frame to frame.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::io::Cursor;

use allocation_counter::{AllocationInfo, measure};
use stillpoint_ingest::pcd::{write_ascii, write_binary};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{DepthImage, GreyImage, Header, Intrinsics, Pieces, PointCloud, Sample};
use stillpoint_testing::Quiet;
use stillpoint_testing::sample::bytes_of;

const SIZE: [usize; 2] = [320, 240];
const PIXELS: usize = SIZE[0] * SIZE[1];

/// A pipeline with one operator, `it`.
fn quiet(operator: &str, files: &[(&str, Vec<u8>)]) -> Quiet {
    let text = format!(
        "stillpoint: 1\nname: steady\nframes: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}\noperators:\n  f: {{ use: feed.image, frame: camera }}\n  it: {operator}\n"
    );
    let files = MemoryFiles { files: files.iter().map(|(n, b)| ((*n).to_string(), b.clone())).collect() };
    Quiet::new(&text, "it", stillpoint_ingest::STAGES, &files).unwrap()
}

fn counts() -> Vec<u16> {
    (0..PIXELS as u32).map(|i| 6000 + (i.wrapping_mul(1_103_515_245) >> 22) as u16).collect()
}

fn points() -> Vec<[f32; 3]> {
    counts().iter().enumerate().map(|(i, z)| [i as f32 * 1e-4, 0.1, f32::from(*z) * 1e-4]).collect()
}

fn png(depth: png::BitDepth, bytes: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, SIZE[0] as u32, SIZE[1] as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(bytes).unwrap();
    file
}

/// What each of twelve ticks takes, the first two left out; each sends `S`.
fn of_ticks<S: Sample>(mut it: Quiet) -> Vec<AllocationInfo> {
    let taken = (1..=12_u64).map(|k| {
        let info = it.tick(k * 100_000_000, |step| measure(step)).unwrap();
        assert_eq!(it.sent::<S>(0).unwrap().elements.len(), PIXELS);
        info
    });
    taken.skip(2).collect()
}

/// Every tick takes the same few pieces, so many bytes at most, and gives all of them back.
fn are_bounded(name: &str, taken: &[AllocationInfo], pieces: u64, bytes: u64) {
    let most = taken.iter().max_by_key(|t| t.bytes_max).unwrap();
    eprintln!("{name}: {} pieces, {} bytes at once", most.count_total, most.bytes_max);
    for t in taken {
        assert!(t.count_total <= pieces && t.bytes_max <= bytes, "{name}: {t:?}");
        assert_eq!((t.count_current, t.bytes_current), (0, 0), "{name} keeps what it took: {t:?}");
    }
}

#[test]
fn an_image_from_a_camera_takes_no_memory() {
    let mut it = quiet("{ use: ingest.depth, frame: camera, inputs: { image: f.out } }", &[]);
    let [width, height] = SIZE.map(|n| n as u32);
    let body = Intrinsics {
        fx: 283.0,
        fy: 283.0,
        cx: 160.0,
        cy: 120.0,
        depth_unit: 1e-4,
        width,
        height,
        reserved: 0,
        length: 0,
    };
    for k in 1..=5_u64 {
        let head = Header { stamp: k, origin: k, sequence: k, incarnation: 0, count: PIXELS as u32 };
        let image = bytes_of::<DepthImage>(&head, &body, &counts());
        let pieces = Pieces::split(DepthImage::KIND, &image).unwrap();
        let taken = it.feed(0, k, pieces, |step| measure(step)).unwrap();
        assert_eq!(taken.count_total, 0, "{taken:?}");
        assert_eq!(it.sent::<PointCloud>(0).unwrap().elements.len(), PIXELS);
    }
}

#[test]
fn a_cloud_of_a_recording_takes_no_memory() {
    let mut words = vec![1, 2, 1, 0, SIZE[1] as u32, SIZE[0] as u32, 3];
    for (name, offset) in [(b'x', 0), (b'y', 4), (b'z', 8)] {
        words.extend([2, u32::from(name), offset, 7, 1]);
    }
    words.extend([0, 12, 12 * SIZE[0] as u32, 12 * PIXELS as u32]);
    let mut message = vec![0, 1, 0, 0];
    message.extend(words.iter().flat_map(|w| w.to_le_bytes()));
    message.extend(points().iter().flatten().flat_map(|c| c.to_le_bytes()));
    message.push(0);
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("sensor_msgs/msg/PointCloud2", "ros2msg", b"").unwrap();
    let channel_id = writer.add_channel(schema, "/cam", "cdr", &BTreeMap::new()).unwrap();
    for number in 0..3 {
        let time = u64::from(number);
        let header =
            mcap::records::MessageHeader { channel_id, sequence: number, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &message).unwrap();
    }
    writer.finish().unwrap();
    let files = [("r.mcap", writer.into_inner().into_inner())];
    let it = "{ use: ingest.mcap, every: 100 ms, frame: camera, params: { file: r.mcap, topic: /cam, at_end: repeat } }";
    are_bounded("ingest.mcap", &of_ticks::<PointCloud>(quiet(it, &files)), 0, 0);
}

/// A file is unpacked anew each time: a long recording would not fit into memory.
#[test]
fn a_file_takes_little_more_than_what_is_in_it_and_keeps_nothing() {
    let at = |kind: &str, more: &str| {
        format!(
            "{{ use: ingest.{kind}, every: 100 ms, frame: camera, params: {{ files: c, at_end: repeat{more} }} }}"
        )
    };
    let camera = ", camera: { fx: 283 px, fy: 283 px, cx: 160 px, cy: 120 px, depth_unit: 0.1 mm }";
    let two = |name: &str, bytes: Vec<u8>| -> [(String, Vec<u8>); 2] {
        [0, 1].map(|i| (format!("c/{i}.{name}"), bytes.clone()))
    };
    let ticks = |operator: &str, files: &[(String, Vec<u8>)]| {
        let files: Vec<_> = files.iter().map(|(n, b)| (n.as_str(), b.clone())).collect();
        quiet(operator, &files)
    };
    let wide: Vec<u8> = counts().iter().flat_map(|c| c.to_be_bytes()).collect();
    let narrow: Vec<u8> = counts().iter().map(|c| *c as u8).collect();
    // What the decoder of PNG needs for itself: its window, and rows.
    let decoder = 300_000;
    let depth = two("png", png(png::BitDepth::Sixteen, &wide));
    let taken = of_ticks::<PointCloud>(ticks(&at("depth", camera), &depth));
    are_bounded("ingest.depth", &taken, 12, 4 * PIXELS as u64 + decoder);
    let grey = two("png", png(png::BitDepth::Eight, &narrow));
    let taken = of_ticks::<GreyImage>(ticks(&at("grey", ""), &grey));
    are_bounded("ingest.grey", &taken, 12, PIXELS as u64 + decoder);
    for (encoding, bytes) in [
        ("ascii", write_ascii(&points(), SIZE[0]).into_bytes()),
        ("binary", write_binary(&points(), SIZE[0])),
    ] {
        let taken = of_ticks::<PointCloud>(ticks(&at("pcd", ""), &two("pcd", bytes)));
        are_bounded(&format!("ingest.pcd, {encoding}"), &taken, 24, 12 * PIXELS as u64 + 4096);
    }
}
