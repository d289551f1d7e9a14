//! `ingest.ros2`: what the bridge hands over, on the bench, and a recording in its place.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::io::Cursor;

use proptest::prelude::*;
use stillpoint_cdr::Writer;
use stillpoint_ingest::wire::WireRefusal;
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_operator::outside::{Arrivals, Outside};
use stillpoint_operator::ros2::{Content, Delivery};
use stillpoint_ros2::Attachment;
use stillpoint_samples::{Diagnostics, PointCloud};
use stillpoint_testing::bench::Left;
use stillpoint_testing::{Bench, run};

const MS: u64 = 1_000_000;
/// Session time at which the bench begins, ns.
const START: u64 = stillpoint_testing::run::START;
const IMAGE: &str = "topic: /depth/image, messages: image, max_points: 8";

fn pipeline(params: &str) -> String {
    format!(
        "stillpoint: 1\nname: wire\nframes: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}\nros2: {{ connect: \
         tcp/127.0.0.1:7447 }}\noperators:\n  it: {{ use: ingest.ros2, every: 10 ms, frame: camera, params: {{ {params} }} }}\n"
    )
}

/// A source on the bench, and what hands messages over to it.
fn bench(params: &str) -> (Bench, Arrivals) {
    let arrivals = Arrivals::at_most(64);
    let outside = Outside { arrivals: Some(arrivals.clone()), ..Outside::default() };
    let stages = stillpoint_ingest::STAGES;
    let bench =
        Bench::with_outside(&pipeline(params), "it", stages, &MemoryFiles::default(), outside).unwrap();
    (bench, arrivals)
}

fn message(stamp: u64, frame: &str, fill: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut w = Writer::new(&mut bytes);
    w.header(stamp, frame);
    fill(&mut w);
    bytes
}

/// Three by two pixels of so many bytes each.
fn image(stamp: u64, encoding: &str, data: &[u8]) -> Vec<u8> {
    message(stamp, "optical", |w| {
        w.u32(2);
        w.u32(3);
        w.text(encoding);
        w.u8(0);
        w.u32(data.len() as u32 / 2);
        w.bytes(data);
    })
}

fn millimetres(stamp: u64) -> Vec<u8> {
    image(stamp, "16UC1", &[1000_u16, 0, 1234, 65535, 1, 777].map(u16::to_le_bytes).concat())
}

fn camera(width: u32, fx: f64) -> Vec<u8> {
    message(7, "optical", |w| {
        w.u32(2);
        w.u32(width);
        w.text("plumb_bob");
        w.u32(5);
        w.f64s(&[0.0; 5]);
        w.f64s(&[fx, 0.0, 1.0, 0.0, 400.0, 0.5, 0.0, 0.0, 1.0]);
        w.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        w.f64s(&[fx, 0.0, 1.0, 0.0, 0.0, 400.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0]);
        (0..6).for_each(|_| w.u32(0));
        w.u8(0);
    })
}

/// One message of a sender as the bridge hands it over.
fn delivered(subscription: u32, sender: u8, sequence: u64, message: &[u8]) -> Vec<u8> {
    let neighbour = Attachment { sequence, time: 5, gid: [sender; 16] }.to_bytes();
    let mut bytes = Vec::new();
    let pieces = message.chunks(7);
    Delivery::write(subscription, START + 3 * MS, Ok((&neighbour[..], pieces)), &mut bytes);
    bytes
}

fn put(arrivals: &Arrivals, mut bytes: Vec<u8>) {
    arrivals.put(None, &mut bytes);
}

/// The counts that an activation told.
fn counts(left: &Left) -> BTreeMap<String, u64> {
    assert_eq!(left.fault, None);
    let reported = left.outputs.iter().find(|(port, _)| *port == 1).unwrap();
    let view = reported.1.pieces().view::<Diagnostics>().unwrap();
    view.elements.iter().map(|m| (m.name().to_owned(), m.value as u64)).filter(|(_, n)| *n > 0).collect()
}

/// Origin and points of the cloud of an activation.
fn cloud(left: &Left) -> Option<(u64, Vec<[f32; 3]>)> {
    let (_, sample) = left.outputs.iter().find(|(port, _)| *port == 0)?;
    let view = sample.pieces().view::<PointCloud>().unwrap();
    Some((view.header.origin, view.elements.iter().map(|p| p.xyz).collect()))
}

/// Activates the source with one message after the other.
fn after(bench: &mut Bench, arrivals: &Arrivals, messages: &[Vec<u8>]) -> Left {
    let mut last = None;
    for message in messages {
        put(arrivals, message.clone());
        last = Some(bench.tick());
    }
    last.unwrap()
}

#[test]
fn an_image_becomes_the_cloud_that_a_recording_of_it_gives() {
    let (mut bench, arrivals) = bench(IMAGE);
    // Nothing came: nothing is told.
    assert!(bench.tick().outputs.is_empty());
    let stamp = START + 12 * MS;
    let infos = [delivered(1, 1, 1, &camera(3, 500.0)), delivered(0, 2, 1, &millimetres(stamp))];
    let left = after(&mut bench, &arrivals, &infos);
    let (origin, points) = cloud(&left).unwrap();
    assert_eq!(origin, stamp);
    let recorded = recording(&[
        ("/depth/camera_info", "sensor_msgs/msg/CameraInfo", camera(3, 500.0)),
        ("/depth/image", "sensor_msgs/msg/Image", millimetres(stamp)),
    ]);
    let files = MemoryFiles { files: [("a.mcap".to_string(), recorded)].into() };
    let text = pipeline(&format!("{IMAGE}, recording: a.mcap"));
    let played = run(&text, &Registry::new(&[stillpoint_ingest::STAGES]), &files, 100).unwrap();
    assert_eq!(played.failed(), [] as [&str; 0]);
    let clouds = played.samples::<PointCloud>("it.cloud");
    let bits =
        |points: &mut dyn Iterator<Item = [f32; 3]>| points.map(|p| p.map(f32::to_bits)).collect::<Vec<_>>();
    assert_eq!(clouds.len(), 1);
    assert_eq!(bits(&mut points.into_iter()), bits(&mut clouds[0].elements.iter().map(|p| p.xyz)));
    // The rehearsal counts as the wire does.
    let reported = played.samples::<Diagnostics>("it.diagnostics");
    assert_eq!(reported.len(), 1);
    assert_eq!(reported[0].elements.iter().map(|m| m.value as u64).collect::<Vec<_>>()[..2], [1, 1]);
}

fn recording(messages: &[(&str, &str, Vec<u8>)]) -> Vec<u8> {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    for (number, (topic, schema, data)) in messages.iter().enumerate() {
        let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
        let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
        // It arrives when it was taken.
        let (sequence, time) = (number as u32, START + 12 * MS + number as u64);
        let header =
            mcap::records::MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn every_refusal_is_counted_with_its_reason() {
    let refused = |content| {
        let mut bytes = Vec::new();
        Delivery::write(0, 1, Err::<(&[u8], std::iter::Empty<&[u8]>), _>(content), &mut bytes);
        bytes
    };
    let now = START + 5 * MS;
    let of_camera = delivered(1, 1, 1, &camera(3, 500.0));
    let unattached = {
        let mut bytes = Vec::new();
        Delivery::write(0, 1, Ok((&b"short"[..], std::iter::once(&b"abc"[..]))), &mut bytes);
        bytes
    };
    let cut = millimetres(now)[..40].to_vec();
    let cases = [
        (WireRefusal::TooLong, vec![refused(Content::TooLong)]),
        (WireRefusal::OtherType, vec![refused(Content::OtherType)]),
        (WireRefusal::Attachment, vec![refused(Content::Attachment)]),
        (WireRefusal::Attachment, vec![unattached]),
        (WireRefusal::Damaged, vec![vec![1, 2, 3]]),
        (WireRefusal::Damaged, vec![of_camera.clone(), delivered(0, 2, 1, &cut)]),
        (WireRefusal::NoDepth, vec![of_camera.clone(), delivered(0, 2, 1, &image(now, "rgb8", &[0; 18]))]),
        (WireRefusal::NoStamp, vec![of_camera.clone(), delivered(0, 2, 1, &millimetres(0))]),
        (WireRefusal::Ahead, vec![of_camera.clone(), delivered(0, 2, 1, &millimetres(START + 1000 * MS))]),
        (WireRefusal::NoCameraInfo, vec![delivered(0, 2, 1, &millimetres(now))]),
        (WireRefusal::CameraInfo, vec![delivered(1, 1, 1, &camera(3, 0.0))]),
        (
            WireRefusal::Size,
            vec![delivered(1, 1, 1, &camera(4, 500.0)), delivered(0, 2, 1, &millimetres(now))],
        ),
        (WireRefusal::TooManyPoints, vec![delivered(1, 1, 1, &camera(5, 500.0))]),
    ];
    for (refusal, messages) in cases {
        let (mut bench, arrivals) = bench(IMAGE);
        let left = after(&mut bench, &arrivals, &messages);
        assert_eq!(cloud(&left), None, "{refusal:?}");
        assert_eq!(counts(&left).get(refusal.name()), Some(&1), "{refusal:?}: {:?}", counts(&left));
    }
    let (mut bench, arrivals) = bench("topic: /p, messages: cloud, frame_id: base");
    let cloud = message(now, "optical", |w| w.u32(0));
    let left = after(&mut bench, &arrivals, &[delivered(0, 2, 1, &cloud)]);
    assert_eq!(counts(&left).get("refused_other_frame"), Some(&1));
}

#[test]
fn stamps_of_another_clock_give_way_to_the_time_of_arrival() {
    let (mut bench, arrivals) = bench(&format!("{IMAGE}, stamps: arrival"));
    let messages = [delivered(1, 1, 1, &camera(3, 500.0)), delivered(0, 2, 1, &millimetres(0))];
    assert_eq!(cloud(&after(&mut bench, &arrivals, &messages)).unwrap().0, START + 3 * MS);
}

#[test]
fn what_is_missing_shows_in_the_numbers_of_each_sender() {
    let (mut bench, arrivals) = bench(IMAGE);
    let mut messages = vec![delivered(1, 1, 1, &camera(3, 500.0))];
    // One that begins late, goes on with a gap of three, sends one again, and another one between them.
    for (sender, sequence) in [(2, 40), (2, 41), (3, 7), (2, 45), (2, 45), (3, 8), (2, 46)] {
        messages.push(delivered(0, sender, sequence, &millimetres(START)));
    }
    let reported = counts(&after(&mut bench, &arrivals, &messages));
    assert_eq!((reported["clouds"], reported["lost"], reported["senders"]), (7, 3, 3));
}

#[test]
fn a_run_that_is_not_live_needs_a_recording_of_the_topic() {
    let registry = Registry::new(&[stillpoint_ingest::STAGES]);
    let text = pipeline(IMAGE);
    let error = run(&text, &registry, &MemoryFiles::default(), 100).err().unwrap();
    assert!(error.contains("set `recording`"), "{error}");
    let other = recording(&[("/depth/image", "sensor_msgs/msg/PointCloud2", millimetres(1))]);
    let files = MemoryFiles { files: [("a.mcap".to_string(), other)].into() };
    let error = run(&pipeline(&format!("{IMAGE}, recording: a.mcap")), &registry, &files, 100).err().unwrap();
    assert!(error.contains("its messages on /depth/image are not sensor_msgs/msg/Image"), "{error}");
}

proptest! {
    /// Whatever the bridge hands over: nothing panics, and each message is in exactly one count.
    #[test]
    fn any_message_becomes_a_cloud_or_is_counted(
        kind in 0..3_usize,
        changes in prop::collection::vec((0..4_usize, any::<prop::sample::Index>(), any::<u8>(), any::<prop::sample::Index>(), any::<bool>()), 1..12),
    ) {
        let params = ["topic: /depth/image, messages: image, max_points: 64",
            "topic: /depth/image/compressedDepth, messages: compressed, max_points: 64",
            "topic: /points, messages: cloud, max_points: 64"][kind];
        let (mut bench, arrivals) = bench(params);
        let compressed = message(START, "optical", |w| { w.text("16UC1; compressedDepth png"); w.bytes(b"0123456789ab\x89PNG\r\n\x1a\nabc"); });
        let points = message(START, "optical", |w| {
            w.u32(1); w.u32(2); w.u32(3);
            for (name, offset) in [("x", 0), ("y", 4), ("z", 8)] { w.text(name); w.u32(offset); w.u8(7); w.u32(1); }
            w.u8(0); w.u32(12); w.u32(24); w.bytes(&[0; 24]); w.u8(0);
        });
        let whole = [delivered(1, 1, 1, &camera(3, 500.0)), delivered(0, 2, 1, &millimetres(START)), delivered(0, 3, 1, &compressed), delivered(0, 4, 1, &points)];
        for (given, (which, at, byte, end, cuts)) in (1_u64..).zip(changes) {
            let mut bytes = whole[which].clone();
            let place = at.index(bytes.len());
            bytes[place] = byte;
            if cuts {
                bytes.truncate(end.index(bytes.len()));
            }
            put(&arrivals, bytes);
            let left = bench.tick();
            prop_assert_eq!(left.fault.as_deref(), None);
            let reported = counts(&left);
            let in_counts: u64 = reported.iter().filter(|(name, _)| !["lost", "senders"].contains(&name.as_str())).map(|(_, n)| n).sum();
            prop_assert_eq!(in_counts, given);
        }
    }
}
