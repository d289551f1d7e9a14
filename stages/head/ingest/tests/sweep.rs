//! Every check over every reader of clouds and images: a reader that lacks one fails here.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::io::Cursor;

use stillpoint_cdr::Writer;
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::PointCloud;
use stillpoint_testing::run;

/// A row of depths, m: the points lie on rays of a camera. NaN and 0 are written as such where a form has them.
type Row = [f32; 3];

const HEAD: Row = [0.5, 0.6, 0.7];
const STAMP: u64 = 1_700_000_000_000_000_000;
const CAMERA: &str = "sensor_msgs/msg/CameraInfo";

/// A reader of one form of files.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Reader {
    PcdText,
    PcdBinary,
    PlyText,
    PlyBinary,
    Png,
    McapCloud,
    McapMetres,
    McapCounts,
    McapPng,
    Ros2Cloud,
    Ros2Metres,
}

use Reader::*;
const ALL: [Reader; 11] = [
    PcdText, PcdBinary, PlyText, PlyBinary, Png, McapCloud, McapMetres, McapCounts, McapPng, Ros2Cloud,
    Ros2Metres,
];
/// Forms of integers, which have no NaN.
const COUNTS: [Reader; 3] = [Png, McapCounts, McapPng];
/// Forms of one file an item, whose order is that of their names.
const FILES: [Reader; 5] = [PcdText, PcdBinary, PlyText, PlyBinary, Png];

/// The depths of clouds, `None` where a point is missing.
type Clouds = Vec<Vec<Option<f32>>>;

impl Reader {
    fn extension(self) -> &'static str {
        match self {
            PcdText | PcdBinary => "pcd",
            PlyText | PlyBinary => "ply",
            _ => "png",
        }
    }

    /// The bytes of an item.
    fn item(self, row: Row) -> Vec<u8> {
        let text = || row.map(|z| format!("0 0 {z}\n")).concat();
        let binary =
            || row.iter().flat_map(|z| [0.0, 0.0, *z]).flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
        let pcd = |data: &str| {
            format!("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA {data}\n")
                .into_bytes()
        };
        let ply = |format: &str| {
            let properties = ["x", "y", "z"].map(|p| format!("property float {p}\n")).concat();
            format!("ply\nformat {format} 1.0\nelement vertex 3\n{properties}end_header\n").into_bytes()
        };
        match self {
            PcdText => [pcd("ascii"), text().into_bytes()].concat(),
            PcdBinary => [pcd("binary"), binary()].concat(),
            PlyText => [ply("ascii"), text().into_bytes()].concat(),
            PlyBinary => [ply("binary_little_endian"), binary()].concat(),
            Png => png(row, self.count()),
            McapCloud | Ros2Cloud => message(|w| {
                [1, 3, 3].into_iter().for_each(|n| w.u32(n));
                for (name, offset) in [("x", 0), ("y", 4), ("z", 8)] {
                    w.text(name);
                    w.u32(offset);
                    w.u8(7);
                    w.u32(1);
                }
                w.u8(0);
                w.u32(12);
                w.u32(36);
                w.bytes(&binary());
                w.u8(0);
            }),
            McapMetres | Ros2Metres => {
                image("32FC1", 4, &row.iter().flat_map(|z| z.to_le_bytes()).collect::<Vec<u8>>())
            }
            McapCounts => image(
                "16UC1",
                2,
                &row.map(|z| (z / self.count()).round() as u16).map(u16::to_le_bytes).concat(),
            ),
            McapPng => message(|w| {
                w.text("16UC1; compressedDepth png");
                w.bytes(&[&[0; 12][..], &png(row, self.count())].concat());
            }),
        }
    }

    /// Depth of a count, m: so coarse that far points fit.
    fn count(self) -> f32 {
        0.1
    }

    fn files(self, items: &[Vec<u8>]) -> MemoryFiles {
        let named = |number: usize| format!("d/frame_{}.{}", 9 + number, self.extension());
        let files: BTreeMap<String, Vec<u8>> = match FILES.contains(&self) {
            true => items.iter().enumerate().map(|(n, bytes)| (named(n), bytes.clone())).collect(),
            false => [("d/a.mcap".to_owned(), self.recording(items))].into(),
        };
        MemoryFiles { files }
    }

    fn recording(self, items: &[Vec<u8>]) -> Vec<u8> {
        let schema = match self {
            McapCloud | Ros2Cloud => "sensor_msgs/msg/PointCloud2",
            McapPng => "sensor_msgs/msg/CompressedImage",
            _ => "sensor_msgs/msg/Image",
        };
        let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
        let all = std::iter::once(("/d/camera_info", CAMERA, camera()))
            .chain(items.iter().map(|bytes| ("/d/image", schema, bytes.clone())));
        for (number, (topic, schema, data)) in all.enumerate() {
            let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
            let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
            let time = STAMP + number as u64 * 10_000_000;
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: number as u32,
                log_time: time,
                publish_time: time,
            };
            writer.write_to_known_channel(&header, &data).unwrap();
        }
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    }

    fn operator(self, extra: &str) -> String {
        let unit = if COUNTS.contains(&self) { ", depth_unit: 100 mm" } else { "" };
        let params = match self {
            PcdText | PcdBinary | PlyText | PlyBinary => "files: d".to_owned(),
            Png => "files: d, camera: { fx: 1000 px, fy: 1000 px, cx: 1 px, cy: 0 px, depth_unit: 100 mm }"
                .to_owned(),
            Ros2Cloud => "topic: /d/image, messages: cloud, recording: d/a.mcap".to_owned(),
            Ros2Metres => "topic: /d/image, messages: image, recording: d/a.mcap".to_owned(),
            _ => format!("file: d/a.mcap, topic: /d/image{unit}"),
        };
        let kind = match self {
            PcdText | PcdBinary => "pcd",
            PlyText | PlyBinary => "ply",
            Png => "depth",
            Ros2Cloud | Ros2Metres => "ros2",
            _ => "mcap",
        };
        format!("{{ use: ingest.{kind}, every: 10 ms, frame: camera, params: {{ {params}{extra} }} }}")
    }

    /// The depths of the clouds of these items, `None` where a point is missing, and what the run says was left out.
    fn read(self, items: &[Vec<u8>], extra: &str) -> Result<(Clouds, Vec<String>), String> {
        let ros2 = "ros2: { connect: tcp/127.0.0.1:7447 }\n";
        let ros2 = if [Ros2Cloud, Ros2Metres].contains(&self) { ros2 } else { "" };
        let text = format!(
            "stillpoint: 1\nname: sweep\nframes: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}\n{ros2}operators:\n  \
             it: {}\n",
            self.operator(extra)
        );
        let files = self.files(items);
        let run = run(&text, &Registry::new(&[stillpoint_ingest::STAGES]), &files, 200)?;
        let depth = |p: &stillpoint_samples::Point| {
            let missing = stillpoint_ingest::INVALID_POINT.map(f32::to_bits);
            (p.xyz.map(f32::to_bits) != missing).then_some(p.xyz[2])
        };
        let clouds = run.samples::<PointCloud>("it.cloud");
        let node = &run.graph.operators[0];
        let remarks = (node.stage.remarks)(&node.params, &files);
        Ok((clouds.iter().map(|c| c.elements.iter().map(depth).collect()).collect(), remarks))
    }
}

fn message(fill: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut w = Writer::new(&mut bytes);
    w.header(STAMP, "camera");
    fill(&mut w);
    bytes
}

fn image(encoding: &str, pixel: u32, data: &[u8]) -> Vec<u8> {
    message(|w| {
        w.u32(1);
        w.u32(3);
        w.text(encoding);
        w.u8(0);
        w.u32(3 * pixel);
        w.bytes(data);
    })
}

fn camera() -> Vec<u8> {
    message(|w| {
        w.u32(1);
        w.u32(3);
        w.text("plumb_bob");
        w.u32(5);
        w.f64s(&[0.0; 5]);
        w.f64s(&[1000.0, 0.0, 1.0, 0.0, 1000.0, 0.0, 0.0, 0.0, 1.0]);
        w.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        w.f64s(&[1000.0, 0.0, 1.0, 0.0, 0.0, 1000.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        (0..6).for_each(|_| w.u32(0));
        w.u8(0);
    })
}

fn png(row: Row, count: f32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 3, 1);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let counts = row.map(|z| (z / count).round() as u16).map(u16::to_be_bytes).concat();
    encoder.write_header().unwrap().write_image_data(&counts).unwrap();
    bytes
}

fn near(found: &[Option<f32>], due: [Option<f32>; 3]) -> bool {
    found.len() == 3
        && found.iter().zip(due).all(|(a, b)| match (a, b) {
            (Some(a), Some(b)) => (a - b).abs() < 1e-5,
            (a, b) => a.is_none() && b.is_none(),
        })
}

#[test]
fn every_reader_marks_points_without_a_measurement() {
    for reader in ALL {
        let mut missing = vec![0.0];
        if !COUNTS.contains(&reader) {
            missing.extend([f32::NAN, f32::INFINITY]);
        }
        for z in missing {
            let (clouds, _) = reader.read(&[reader.item([0.5, z, 0.7])], "").unwrap();
            assert!(near(&clouds[0], [Some(0.5), None, Some(0.7)]), "{reader:?} {z}: {clouds:?}");
        }
    }
}

#[test]
fn every_reader_refuses_points_farther_than_a_depth_camera_measures() {
    for reader in ALL {
        // A point that is missing does not hide it.
        let refused = reader.read(&[reader.item(HEAD), reader.item([0.0, 800.0, 830.0])], "").unwrap_err();
        assert!(refused.contains("its nearest point is 800 m from the origin"), "{reader:?}: {refused}");
        let unit = if refused.contains("depth_unit") { "depth_unit" } else { "unit: mm" };
        assert!(refused.contains(unit), "{reader:?}: {refused}");
    }
}

#[test]
fn every_reader_leaves_a_damaged_item_out_and_counts_it_and_refuses_it_where_it_is_strict() {
    for reader in ALL {
        let [first, mut damaged, last] = [HEAD, HEAD, [0.5; 3]].map(|row| reader.item(row));
        damaged.truncate(damaged.len() - 5);
        let items = [first, damaged.clone(), last];
        let (clouds, remarks) = reader.read(&items, "").unwrap();
        assert_eq!(clouds.len(), 2, "{reader:?}");
        assert!(remarks.len() == 1 && remarks[0].contains("1 of 3 "), "{reader:?}: {remarks:?}");
        assert!(reader.read(&[damaged], "").is_err(), "{reader:?}");
        // The wire has nobody to refuse to: its rehearsal counts.
        if ![Ros2Cloud, Ros2Metres].contains(&reader) {
            let refused = reader.read(&items, ", strict: true").unwrap_err();
            let named = if FILES.contains(&reader) { "frame_10" } else { "message 2" };
            assert!(refused.contains(named), "{reader:?}: {refused}");
        }
    }
}

#[test]
fn every_reader_of_files_has_them_in_the_order_of_their_numbers_and_refuses_surplus_records() {
    for reader in FILES {
        let depths = [0.5, 0.6, 0.7];
        let items = depths.map(|z| reader.item([z; 3]));
        let (clouds, remarks) = reader.read(&items, "").unwrap();
        for (cloud, z) in clouds.iter().zip(depths) {
            assert!(near(cloud, [Some(z); 3]), "{reader:?}: {clouds:?}");
        }
        assert_eq!((clouds.len(), remarks.len()), (3, 0), "{reader:?}");
        if reader == Png {
            // What follows the last chunk of an image is none of its pixels.
            continue;
        }
        let more = match reader {
            PcdText | PlyText => b"0 0 0.5\n".to_vec(),
            _ => [0.1_f32; 3].into_iter().flat_map(f32::to_le_bytes).collect(),
        };
        let surplus = [reader.item(HEAD), more].concat();
        assert!(reader.read(&[surplus], "").is_err(), "{reader:?}");
    }
}

#[test]
fn every_reader_quotes_little_of_what_it_refuses() {
    for reader in ALL {
        let long = vec![b'a'; 60_000];
        let refused = reader.read(&[long], "").unwrap_err();
        assert!(refused.len() < 600, "{reader:?}: {} bytes", refused.len());
    }
}

#[test]
fn every_reader_of_recordings_compares_the_checksums() {
    for reader in ALL.into_iter().filter(|reader| !FILES.contains(reader)) {
        let items = [reader.item(HEAD)];
        let whole = reader.recording(&items);
        let mut files = reader.files(&items);
        // Wherever a bit flips before the summary, nothing of the file is taken.
        let summary = whole.windows(5).rposition(|w| w == b"/d/im").unwrap() / 2;
        for place in (60..summary).step_by(7) {
            let mut bytes = whole.clone();
            bytes[place] ^= 4;
            files.files.insert("d/a.mcap".into(), bytes);
            let bag = stillpoint_ingest::bag::Bag::open(&files, "d/a.mcap").unwrap();
            assert!(bag.messages().any(|m| m.is_err()), "{reader:?}: byte {place} of {}", whole.len());
        }
    }
}

#[test]
fn every_reader_of_recordings_refuses_a_clock_that_was_set_while_it_recorded() {
    let cloud = |stamp: u64| {
        let mut bytes = Vec::new();
        let mut w = Writer::new(&mut bytes);
        w.header(stamp, "camera");
        let body = McapCloud.item(HEAD);
        let start = {
            let mut head = Vec::new();
            Writer::new(&mut head).header(stamp, "camera");
            head.len().next_multiple_of(4)
        };
        bytes.resize(start, 0);
        bytes.extend_from_slice(&body[start..]);
        bytes
    };
    for reader in [McapCloud, Ros2Cloud] {
        let extra = if reader == McapCloud { ", pace: recorded" } else { "" };
        let items = [cloud(1_000_000_000), cloud(STAMP)];
        let refused = reader.read(&items, extra).unwrap_err();
        assert!(refused.contains("message 2 comes 53.9 years after message 1"), "{reader:?}: {refused}");
    }
}
