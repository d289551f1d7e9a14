//! Standard tools read a session: the Python packages `mcap-ros2-support` and `rosbags` decode every kind, and their
//! values are those that were written. `STILLPOINT_PYTHON` names a Python that has them. `STILLPOINT_RERUN` names the
//! program `rerun`, whose `mcap check` then has nothing to say; the test of its rules in `round_trip.rs` runs everywhere.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use std::process::Command;

use fixture::{START, cloud, depth, depth_in, entry, grey, header, opening, pieces, sample, topic};
use stillpoint_recorder::{Closing, Compression, PartWriter, Role};
use stillpoint_samples::{
    Cause, DepthImage, Field, GreyImage, HEADER_SIZE, Header, PointCloud, Pose, Primitive, RefKind, Sample,
    Shape,
};

const PROBE: &str = "import mcap_ros2, rosbags";

/// Prints one line per message of both readers: topic, then every number and text of it in the order of the fields.
const PRINT: &str = r#"
import sys
from dataclasses import fields, is_dataclass
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pathlib import Path
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore, get_types_from_msg

def flat(v):
    if isinstance(v, str): return [v]
    if isinstance(v, bool): return [str(int(v))]
    if isinstance(v, int): return [str(v)]
    if isinstance(v, float): return [v.hex()]
    if isinstance(v, bytes): return [str(b) for b in v]
    if hasattr(v, 'tolist'): return flat(v.tolist())
    if isinstance(v, (list, tuple)): return [t for x in v for t in flat(x)]
    names = [f.name for f in fields(v)] if is_dataclass(v) else v.__slots__
    # Constants of a message, in capitals, are not fields.
    slots = [s for s in names if not s.startswith('_') and not s.isupper()]
    return [t for s in slots for t in flat(getattr(v, s))]

def line(reader, topic, message):
    print(reader, topic, ' '.join(flat(message)))

with open(sys.argv[1], 'rb') as file:
    for schema, channel, message, ros in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(log_time_order=False):
        line('mcap', channel.topic, ros)

def bag(name, path):
    store = get_typestore(Stores.EMPTY)
    with Reader(Path(path)) as reader:
        for c in reader.connections:
            store.register(get_types_from_msg(c.msgdef.data, c.msgtype))
        for c, stamp, raw in reader.messages():
            line(name, c.topic, store.deserialize_cdr(raw, c.msgtype))
        return {c.topic: c.msgcount for c in reader.connections}

bag('rosbags', sys.argv[1])
# The folder, by its metadata.yaml.
counts = bag('folder', sys.argv[2])
assert counts['/op/pose'] == 2 and counts['/tf'] == 2, counts

last = {}
with open(sys.argv[1], 'rb') as file:
    for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
        assert message.publish_time >= last.get(channel.topic, 0), channel.topic
        last[channel.topic] = message.publish_time
"#;

fn python() -> String {
    std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned())
}

#[test]
fn python_reads_the_values_that_were_written() {
    let probe = Command::new(python()).args(["-c", PROBE]).output();
    if !probe.is_ok_and(|p| p.status.success()) {
        println!(
            "skipped: {} cannot import mcap_ros2 and rosbags (set STILLPOINT_PYTHON to one that can)",
            python()
        );
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part-000.mcap");
    let expected = write_every_kind(&path);
    let session = stillpoint_recorder::Session::open(folder.path()).unwrap();
    stillpoint_recorder::write_metadata(folder.path(), &session).unwrap();
    let out = Command::new(python()).args(["-c", PRINT]).arg(&path).arg(folder.path()).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let text = String::from_utf8(out.stdout).unwrap();
    for reader in ["mcap", "rosbags", "folder"] {
        let of_reader = || text.lines().filter_map(|l| l.strip_prefix(reader)?.strip_prefix(' '));
        for (topic, values) in &expected {
            let found: Vec<_> =
                of_reader().filter_map(|l| l.strip_prefix(topic.as_str())?.strip_prefix(' ')).collect();
            let values: Vec<String> = values.iter().map(|v| v.join(" ")).collect();
            assert_eq!(found, values, "{reader}, {topic}");
        }
    }
}

/// A number as Python's `float.hex` writes it.
fn hex(v: f64) -> String {
    if v == 0.0 {
        return if v.is_sign_negative() { "-0x0.0p+0" } else { "0x0.0p+0" }.to_owned();
    }
    if !v.is_finite() {
        return v.to_string().to_lowercase();
    }
    let (bits, sign) = (v.to_bits(), if v < 0.0 { "-" } else { "" });
    format!("{sign}0x1.{:013x}p{:+}", bits & ((1 << 52) - 1), (bits >> 52 & 0x7ff) as i64 - 1023)
}

fn f64s(bytes: &[u8]) -> Vec<String> {
    bytes.chunks_exact(8).map(|c| hex(f64::from_le_bytes(c.try_into().unwrap()))).collect()
}

fn u8s(bytes: &[u8]) -> Vec<String> {
    bytes.iter().map(u8::to_string).collect()
}

/// The number as a reader in Python prints it.
fn number(primitive: Primitive, b: &[u8]) -> String {
    macro_rules! read {
        ($t:ty) => {
            <$t>::from_le_bytes(b.try_into().unwrap())
        };
    }
    match primitive {
        Primitive::U8 => read!(u8).to_string(),
        Primitive::I8 => read!(i8).to_string(),
        Primitive::U16 => read!(u16).to_string(),
        Primitive::I16 => read!(i16).to_string(),
        Primitive::U32 => read!(u32).to_string(),
        Primitive::I32 => read!(i32).to_string(),
        Primitive::U64 => read!(u64).to_string(),
        Primitive::I64 => read!(i64).to_string(),
        Primitive::F32 => hex(read!(f32).into()),
        Primitive::F64 => hex(read!(f64)),
    }
}

/// The fields' numbers, one after the other.
fn numbers(fields: &[Field], mut bytes: &[u8]) -> Vec<String> {
    let mut out = Vec::new();
    for field in fields {
        let (own, rest) = bytes.split_at(field.size());
        out.extend(own.chunks_exact(field.primitive.size()).map(|b| number(field.primitive, b)));
        bytes = rest;
    }
    out
}

fn own_header(h: &Header) -> Vec<String> {
    [h.stamp, h.origin, h.sequence, u64::from(h.incarnation)].map(|n| n.to_string()).to_vec()
}

/// The time of a standard message is that of the acquisition.
fn ros_head(h: &Header) -> Vec<String> {
    vec![(h.origin / 1_000_000_000).to_string(), (h.origin % 1_000_000_000).to_string(), "camera".to_owned()]
}

type Expected = Vec<(String, Vec<Vec<String>>)>;

/// Bytes of finite numbers other than zero, whatever they are read as.
fn noise(i: u64) -> Vec<u8> {
    (0..1024_u64).map(|k| if k % 8 == 7 { 0x3f } else { (k * 31 + i * 7 + 1) as u8 }).collect()
}

/// Writes two samples of every kind; what both readers are to print of them.
fn write_every_kind(path: &std::path::Path) -> Expected {
    let file = stillpoint_recorder::create_private(path).unwrap();
    let mut w = PartWriter::new(file, Compression::Lz4, &opening()).unwrap();
    let mut expected = Expected::new();
    for kind in stillpoint_samples::all() {
        let name = format!("op.{}", kind.name.to_lowercase());
        let id = w.add_topic(topic(&name, kind, Role::Computed)).unwrap();
        let mut lines = Vec::new();
        for i in 0..2_u64 {
            let (h, noise) = (Header { count: i as u32 * 3, ..header(i) }, noise(i));
            let bytes = match kind.name {
                "PointCloud" => cloud(h, 3, 2, &noise),
                "DepthImage" => depth(h, 3, 2, 450.5, &noise),
                "GreyImage" => grey(h, 3, 2, &noise),
                "Journal" => entry(h, i, Cause::Timer, &[fixture::reference(RefKind::Output, 1, 0, i)]),
                _ => sample(kind, h, &noise),
            };
            w.write(id, pieces(kind, &bytes), START + i).unwrap();
            lines.push(values(kind.name, &bytes));
        }
        expected.push((format!("/{}", name.replace('.', "/")), lines));
    }
    let fine = w.add_topic(topic("op.fine", DepthImage::KIND, Role::Computed)).unwrap();
    let bytes = depth_in(header(0), [3, 2], 450.5, 1e-4, &[0, 0, 39, 16]);
    w.write(fine, pieces(DepthImage::KIND, &bytes), START).unwrap();
    let mut line = ros_head(&header(0));
    line.extend(["2", "3", "32FC1", "0", "12"].map(str::to_owned));
    // No measurement, and 4135 counts.
    line.extend([f32::NAN, (4135.0_f64 * 1e-4) as f32].repeat(3).iter().flat_map(|m| u8s(&m.to_le_bytes())));
    expected.push(("/op/fine".into(), vec![line]));
    let poses = expected.iter().find(|(name, _)| name == "/op/pose").unwrap().1.clone();
    let stamped = poses.iter().map(|line| line[..10].to_vec()).collect();
    let moved =
        poses.iter().map(|line| [&line[..3], &["op/pose".to_owned()], &line[3..10]].concat()).collect();
    expected.extend([("/op/pose/stamped".to_owned(), stamped), ("/tf".to_owned(), moved)]);
    let late = w.add_topic(topic("late.cloud", PointCloud::KIND, Role::Source)).unwrap();
    w.note_lost(late, 3, 17, 4, START).unwrap();
    expected.push((
        "/stillpoint/lost".into(),
        vec![vec!["17".into(), "4".into(), "3".into(), "late.cloud".into()]],
    ));
    w.finish(&Closing::default()).unwrap();
    let t = &opening().frames[0];
    let [qw, qx, qy, qz] = t.rotation;
    let mut frames = ros_head(&Header { origin: START, ..Header::default() });
    frames.splice(2.., [t.parent.clone(), t.child.clone()]);
    frames.extend(t.translation.into_iter().chain([qx, qy, qz, qw]).map(hex));
    expected.push(("/tf_static".into(), vec![frames]));
    expected
}

/// Every field of a sample in the order of its message.
fn values(kind: &str, bytes: &[u8]) -> Vec<String> {
    let of = |k: &'static stillpoint_samples::SampleKind| pieces(k, bytes);
    let mut out = Vec::new();
    match kind {
        "PointCloud" => {
            let p = of(PointCloud::KIND);
            out.extend(ros_head(&p.header()));
            out.extend(["2", "3"].map(str::to_owned));
            for (name, offset) in [("x", "0"), ("y", "4"), ("z", "8")] {
                out.extend([name, offset, "7", "1"].map(str::to_owned));
            }
            out.extend(["0", "12", "36"].map(str::to_owned));
            out.extend(u8s(p.payload));
            out.push("0".to_owned());
        }
        "DepthImage" => {
            let p = of(DepthImage::KIND);
            out.extend(ros_head(&p.header()));
            out.extend(["2", "3", "16UC1", "0", "6"].map(str::to_owned));
            out.extend(u8s(p.payload));
        }
        "GreyImage" => {
            let p = of(GreyImage::KIND);
            out.extend(ros_head(&p.header()));
            out.extend(["2", "3", "mono8", "0", "3"].map(str::to_owned));
            out.extend(u8s(p.payload));
        }
        "Pose" => {
            let p = of(Pose::KIND);
            out.extend(ros_head(&p.header()));
            let v = f64s(p.payload);
            out.extend_from_slice(&v[..3]);
            out.extend([4, 5, 6, 3].map(|i| v[i].clone()));
            out.extend_from_slice(&v[7..]);
        }
        _ => {
            let kind = stillpoint_samples::by_name(kind).unwrap();
            let p = of(kind);
            out.extend(own_header(&p.header()));
            if kind.shape == Shape::Fixed || !kind.body.is_empty() {
                out.push(p.header().count.to_string());
            }
            let message = kind.body.split_last().map_or(&[][..], |(_, rest)| rest);
            out.extend(numbers(message, &p.meta[HEADER_SIZE..]));
            for element in p.payload.chunks_exact(kind.element_size) {
                match kind.bare {
                    Some(primitive) => out.push(number(primitive, element)),
                    None => out.extend(numbers(kind.element, element)),
                }
            }
        }
    }
    out
}

#[test]
fn rerun_finds_nothing_to_say() {
    let Ok(rerun) = std::env::var("STILLPOINT_RERUN") else {
        eprintln!("skipped: STILLPOINT_RERUN names no program `rerun`");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("part-000.mcap");
    write_every_kind(&path);
    let out = Command::new(rerun).args(["mcap", "check", "--full"]).arg(&path).output().unwrap();
    let table = String::from_utf8_lossy(&out.stdout).into_owned();
    let text = format!("{table}{}", String::from_utf8_lossy(&out.stderr));
    let rows =
        table.lines().skip_while(|line| !line.starts_with("Status")).skip(2).filter(|l| !l.trim().is_empty());
    let rows: Vec<&str> = rows.collect();
    assert!(out.status.success() && rows.len() > 10, "{text}");
    // Rerun cuts each `PointCloud2` into rows of one time, which `--full` takes for unordered in any file.
    let is_well = |row: &&&str| row.starts_with("ok") || row.contains(" /op/pointcloud ");
    let flagged: Vec<&&str> = rows.iter().filter(|row| !is_well(row)).collect();
    assert!(flagged.is_empty(), "{text}");
}
