//! What is written comes back bit for bit, in every form.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use fixture::{cloud, depth, grey, header, opening, pieces, pipeline, sample, samples, topic};
use proptest::collection::vec;
use proptest::prelude::*;
use stillpoint_recorder::{Closing, Compression, PartWriter, Role};
use stillpoint_samples::{AlignedBytes, DepthImage, GreyImage, Header, PointCloud, Pose, Sample, SampleKind};

fn heads() -> impl Strategy<Value = Header> {
    let times = prop_oneof![any::<u64>(), 0..i32::MAX as u64 * 1_000_000_000];
    let sequences = prop_oneof![any::<u64>(), 0..1000_u64, Just(u64::from(u32::MAX)), Just(1 << 32)];
    (times, any::<u64>(), sequences, any::<u32>(), 0..40_u32).prop_map(
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
