//! What is written comes back bit for bit, in every form.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use fixture::{cloud, depth, depth_in, grey, header, opening, pieces, pipeline, sample, samples, topic};
use proptest::collection::vec;
use proptest::prelude::*;
use stillpoint_recorder::{Closing, Compression, PartWriter, Role};
use stillpoint_samples::{AlignedBytes, DepthImage, GreyImage, Header, PointCloud, Pose, Sample, SampleKind};

fn heads() -> impl Strategy<Value = Header> {
    let times = || prop_oneof![any::<u64>(), 0..i32::MAX as u64 * 1_000_000_000];
    let sequences = prop_oneof![any::<u64>(), 0..1000_u64, Just(u64::from(u32::MAX)), Just(1 << 32)];
    (times(), times(), sequences, any::<u32>(), 0..40_u32).prop_map(
        |(stamp, origin, sequence, incarnation, count)| Header {
            stamp,
            origin,
            sequence,
            incarnation,
            count,
        },
    )
}

/// Writes samples of distinct numbers and reads them back.
fn there_and_back(kind: &'static SampleKind, written: &[AlignedBytes]) -> Vec<AlignedBytes> {
    let mut w = PartWriter::new(Vec::new(), Compression::Lz4, &opening()).unwrap();
    let id = w.add_topic(topic("op.port", kind, Role::Computed)).unwrap();
    for (i, s) in written.iter().enumerate() {
        w.write(id, pieces(kind, s), i as u64).unwrap();
    }
    let bytes = w.finish(&Closing::default()).unwrap();
    samples(&bytes).into_iter().map(|(_, s)| s).collect()
}

fn distinct(mut samples: Vec<AlignedBytes>) -> Vec<AlignedBytes> {
    let mut seen = std::collections::BTreeSet::new();
    samples.retain(|s| seen.insert(s[16..28].to_vec()));
    samples
}

proptest! {

    #[test]
    fn any_bytes_of_any_kind_come_back(heads in vec(heads(), 1..5), noise in vec(any::<u8>(), 1..200)) {
        for kind in stillpoint_samples::all() {
            let written = distinct(heads.iter().map(|h| sample(kind, *h, &noise)).collect());
            prop_assert_eq!(there_and_back(kind, &written), written, "{}", kind.name);
        }
    }

    #[test]
    fn clouds_come_back(heads in vec(heads(), 1..5), w in 0..9_u32, h in 0..9_u32, noise in vec(any::<u8>(), 1..99)) {
        let written = distinct(heads.iter().map(|header| cloud(*header, w, h, &noise)).collect());
        prop_assert_eq!(there_and_back(PointCloud::KIND, &written), written);
    }

    #[test]
    fn depth_images_come_back(heads in vec((heads(), any::<f64>()), 1..5), w in 0..9_u32, noise in vec(any::<u8>(), 1..99)) {
        let written = distinct(heads.iter().map(|(header, fx)| depth(*header, w, 3, *fx, &noise)).collect());
        prop_assert_eq!(there_and_back(DepthImage::KIND, &written), written);
    }

    #[test]
    fn depth_images_of_any_count_come_back(
        head in heads(), unit in prop_oneof![Just(1e-4), Just(2.5e-4), 1e-9..1e3_f64, any::<f64>()], noise in vec(any::<u8>(), 1..400),
    ) {
        let written = vec![depth_in(head, [9, 11], 500.0, unit, &noise)];
        prop_assert_eq!(there_and_back(DepthImage::KIND, &written), written);
    }

    #[test]
    fn grey_images_come_back(heads in vec(heads(), 1..5), w in 0..9_u32, noise in vec(any::<u8>(), 1..99)) {
        let written = distinct(heads.iter().map(|header| grey(*header, w, 5, &noise)).collect());
        prop_assert_eq!(there_and_back(GreyImage::KIND, &written), written);
    }

    #[test]
    fn poses_come_back(heads in vec(heads(), 1..5), noise in vec(any::<u8>(), 1..400)) {
        let written = distinct(heads.iter().map(|header| sample(Pose::KIND, *header, &noise)).collect());
        prop_assert_eq!(there_and_back(Pose::KIND, &written), written);
    }
}

#[test]
fn every_sample_comes_back_in_order_under_each_compression() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let (bytes, written) = pipeline(compression, 25);
        assert_eq!(samples(&bytes), written, "{compression:?}");
    }
}

#[test]
fn two_writes_of_the_same_give_the_same_file() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        assert!(pipeline(compression, 25).0 == pipeline(compression, 25).0, "{compression:?}");
    }
}

#[test]
fn changed_intrinsics_beyond_the_channel_limit_fall_back_and_come_back() {
    let written: Vec<_> = (0..100).map(|i| depth(header(i), 4, 3, 500.0 + i as f64, &[1, 2, 3])).collect();
    assert_eq!(there_and_back(DepthImage::KIND, &written), written);
}

#[test]
fn samples_are_found_by_number() {
    let (bytes, written) = pipeline(Compression::Lz4, 25);
    let session = stillpoint_recorder::Session::from_bytes([bytes.into()]).unwrap();
    let topic = session.topic_number("seg.cloud").unwrap();
    let clouds: Vec<_> = written.iter().filter(|(name, _)| name == "seg.cloud").collect();
    for (i, (_, expected)) in clouds.into_iter().enumerate() {
        let found = session.sample(topic, 0, i as u64).unwrap().unwrap();
        assert_eq!(&found.sample, expected);
    }
    assert_eq!(session.sample(topic, 0, 25).unwrap(), None);
    assert_eq!(session.sample(topic, 1, 0).unwrap(), None);
}

#[test]
fn a_sample_is_held_with_exactly_its_bytes() {
    let (bytes, written) = pipeline(Compression::Lz4, 3);
    let session = stillpoint_recorder::Session::from_bytes([bytes.into()]).unwrap();
    let mut last = std::collections::BTreeMap::new();
    for (name, sample) in &written {
        let number = last.entry(name).and_modify(|n| *n += 1).or_insert(0_u64);
        let topic = session.topic_number(name).unwrap();
        assert_eq!(session.holds(topic, 0, *number, sample).unwrap(), Some(true), "{name} {number}");
        for at in [0, 20, sample.len() - 1] {
            let mut other = sample.clone();
            other[at] ^= 1;
            assert_eq!(session.holds(topic, 0, *number, &other).unwrap(), Some(false), "{name} {number}");
        }
        let shorter = &sample[..sample.len() - 1];
        assert_eq!(session.holds(topic, 0, *number, shorter).unwrap(), Some(false));
        assert_eq!(session.holds(topic, 9, *number, sample).unwrap(), None);
    }
}

/// What older builds wrote has its stamp inside and its origin as MCAP's publish time, and topics with dots.
#[test]
fn a_recording_of_an_older_build_is_read_as_it_was_meant() {
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/data/clouds.mcap")).unwrap();
    let mut times = Vec::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.topic == "coarse.cloud" {
            let word = |at: usize| u32::from_le_bytes(message.data[at..at + 4].try_into().unwrap());
            times.push((u64::from(word(4)) * 1_000_000_000 + u64::from(word(8)), message.publish_time));
        }
    }
    assert!(times.len() > 1);
    let session = stillpoint_recorder::Session::from_bytes([bytes.into()]).unwrap();
    let found: Vec<(u64, u64)> = session
        .samples_where(|t| t.name == "coarse.cloud")
        .map(|r| pieces(PointCloud::KIND, &r.unwrap().sample).header())
        .map(|header| (header.stamp, header.origin))
        .collect();
    assert_eq!(found, times);
}

#[test]
fn messages_have_the_origin_inside_and_publish_times_that_never_go_back() {
    let (bytes, written) = pipeline(Compression::Lz4, 25);
    let mut last = std::collections::BTreeMap::new();
    let mut seen = 0;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let before = last.insert(message.channel.topic.clone(), message.publish_time);
        assert!(before.is_none_or(|before| before <= message.publish_time), "{}", message.channel.topic);
        if message.channel.topic == "/seg/cloud" {
            let word = |at: usize| u32::from_le_bytes(message.data[at..at + 4].try_into().unwrap());
            let head = header(u64::from(message.sequence));
            let inside = u64::from(word(4)) * 1_000_000_000 + u64::from(word(8));
            assert_eq!((inside, message.publish_time), (head.origin, head.stamp));
            seen += 1;
        }
    }
    assert_eq!(seen, written.iter().filter(|(name, _)| name == "seg.cloud").count());
    let names: Vec<&str> = last.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "/cam/image",
            "/cam/image/camera_info",
            "/cam/journal",
            "/seg/cloud",
            "/seg/journal",
            "/stillpoint/clock",
            "/tf_static"
        ]
    );
}

/// What viewers check of a file: within a topic of ROS 2, times never go back and all messages have one type.
fn check_as_viewers_do(bytes: &[u8]) {
    let mut last = std::collections::BTreeMap::new();
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let message = message.unwrap();
        let topic = &message.channel.topic;
        let schema = message.channel.schema.as_ref().unwrap();
        assert!(topic.starts_with('/') && !topic.contains("//") && !topic.ends_with('/'), "{topic}");
        assert!(topic.chars().all(|c| c.is_ascii_alphanumeric() || "/_".contains(c)), "{topic}");
        assert!(!topic.split('/').any(|token| token.starts_with(|c: char| c.is_ascii_digit())), "{topic}");
        assert_eq!((&*schema.encoding, &*message.channel.message_encoding), ("ros2msg", "cdr"));
        let now = (schema.name.clone(), message.publish_time, message.log_time);
        if let Some((name, published, logged)) = last.insert(topic.clone(), now.clone()) {
            assert!((name, true, true) == (now.0, published <= now.1, logged <= now.2), "{topic}");
        }
    }
}

/// A recorder takes what waits topic by topic, so that the stamps of two topics do not come in their order.
#[test]
fn transforms_of_two_topics_are_published_in_their_order() {
    let mut w = PartWriter::new(Vec::new(), Compression::Lz4, &opening()).unwrap();
    let ids = ["head.pose", "3rd.pose-raw"]
        .map(|name| w.add_topic(topic(name, Pose::KIND, Role::Computed)).unwrap());
    for (log, (id, sequence)) in [(0, 0), (0, 1), (1, 0), (1, 1), (0, 2)].into_iter().enumerate() {
        let bytes = sample(Pose::KIND, header(sequence), &[1, 2, 3]);
        w.write(ids[id], pieces(Pose::KIND, &bytes), log as u64).unwrap();
    }
    let bytes = w.finish(&Closing::default()).unwrap();
    check_as_viewers_do(&bytes);
    let topics: std::collections::BTreeSet<String> =
        mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap().channel.topic.clone()).collect();
    let of_poses: Vec<&str> =
        topics.iter().map(String::as_str).filter(|t| t.contains("pose") || *t == "/tf").collect();
    assert_eq!(
        of_poses,
        ["/_3rd/pose_raw", "/_3rd/pose_raw/stamped", "/head/pose", "/head/pose/stamped", "/tf"]
    );
    // Rerun takes the messages of two channels of one name for unordered.
    let channels: std::collections::BTreeSet<u16> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
        .filter(|m| m.channel.topic == "/tf")
        .map(|m| m.channel.id)
        .collect();
    assert_eq!(channels.len(), 1);
    let session = stillpoint_recorder::Session::from_bytes([bytes.into()]).unwrap();
    let found =
        session.samples_where(|t| t.name == "3rd.pose-raw").map(|r| r.unwrap().sample).collect::<Vec<_>>();
    assert_eq!(found.len(), 2);
}

#[test]
fn a_pipeline_passes_the_checks_of_viewers() {
    check_as_viewers_do(&pipeline(Compression::Zstd, 25).0);
}

#[test]
fn metadata_says_what_is_in_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("part-000.mcap"), pipeline(Compression::Lz4, 25).0).unwrap();
    let session = stillpoint_recorder::Session::open(folder.path()).unwrap();
    stillpoint_recorder::write_metadata(folder.path(), &session).unwrap();
    // Once more, as after a repair.
    stillpoint_recorder::write_metadata(folder.path(), &session).unwrap();
    let path = folder.path().join(stillpoint_recorder::METADATA_FILE);
    let text = std::fs::read_to_string(&path).unwrap();
    let count = |line: &str| text.matches(line).count();
    assert_eq!(count("\n    - 'part-000.mcap'\n"), 1, "{text}");
    assert_eq!(count("name: '/seg/cloud'\n        type: 'sensor_msgs/msg/PointCloud2'"), 1, "{text}");
    assert_eq!(count("\n      message_count: 25\n"), 3, "{text}");
    let mode = std::os::unix::fs::PermissionsExt::mode(&std::fs::metadata(path).unwrap().permissions());
    assert_eq!(mode & 0o777, 0o600);
}
