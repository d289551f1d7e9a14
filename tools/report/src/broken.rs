//! Reports of sessions whose bytes nobody vouches for: garbage in samples, and in the file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rand::{Rng, RngExt, SeedableRng};
use stillpoint_operator::Registry;
use stillpoint_recorder::{
    Closing, Compression, Opening, PartWriter, Role, Session, Source as Bytes, TopicInfo,
};
use stillpoint_samples::{
    Actuation, AlignedBytes, ConsoleCommand, DepthImage, Diagnostics, Duties, Gate, HEADER_SIZE, Header,
    Health, Hull, Intrinsics, Journal, Pieces, Plane, PointCloud, Pose, PoseReport, Rejection, RigState,
    Sample, SampleKind, Shape, Target, Track,
};
use zerocopy::IntoBytes;

use super::{html, sections_of};

/// Elements of the samples of kinds that have any number of them.
const ELEMENTS: u32 = 12;

/// Topics with their operators: a rig, a segmenter, a tracker, a filter and a fusion.
const TOPICS: [(&str, &SampleKind); 18] = [
    ("rig.depth", DepthImage::KIND),
    ("rig.truth", Pose::KIND),
    ("face.face", PointCloud::KIND),
    ("face.plane", Plane::KIND),
    ("face.hull", Hull::KIND),
    ("face.rejection", Rejection::KIND),
    ("head.pose", Pose::KIND),
    ("head.report", PoseReport::KIND),
    ("filter.state", Track::KIND),
    ("filter.diagnostics", Diagnostics::KIND),
    ("fused.state", Track::KIND),
    ("fused.health", Health::KIND),
    ("target.reference", Target::KIND),
    ("law.duties", Duties::KIND),
    ("rig.state", RigState::KIND),
    ("valves.state", Actuation::KIND),
    ("beam.state", Gate::KIND),
    ("console.arm", ConsoleCommand::KIND),
];

/// Operators with their inputs.
const OPERATORS: [(&str, &[&str]); 10] = [
    ("rig", &[]),
    ("face", &["rig.depth"]),
    ("head", &["face.face"]),
    ("filter", &["head.pose"]),
    ("fused", &["filter.state", "filter.state"]),
    ("target", &[]),
    ("law", &["fused.state", "target.reference", "beam.state"]),
    ("valves", &["law.duties"]),
    ("beam", &["fused.state", "valves.state"]),
    ("console", &[]),
];

fn outputs(operator: &str) -> Vec<String> {
    let own = TOPICS.iter().filter(|(t, _)| t.split('.').next() == Some(operator));
    own.map(|(t, _)| t.to_string()).collect()
}

/// How much of a sample is garbage.
#[derive(Clone, Copy)]
enum Garbage {
    None,
    Some,
}

/// A sample of a kind whose numbers are small, or partly garbage.
fn sample(kind: &SampleKind, sequence: u64, random: &mut impl Rng, garbage: Garbage) -> AlignedBytes {
    let count = if kind.shape == Shape::Fixed { 1 } else { ELEMENTS };
    let time = 1_000_000 * sequence;
    let wild = |random: &mut dyn Rng| -> u64 {
        [
            0,
            1,
            u64::MAX,
            u64::MAX / 2,
            f64::NAN.to_bits(),
            f64::INFINITY.to_bits(),
            1e300f64.to_bits(),
            random.next_u64(),
        ][(random.next_u32() % 8) as usize]
    };
    let is_wild =
        |random: &mut dyn Rng| matches!(garbage, Garbage::Some) && random.next_u32().is_multiple_of(6);
    let mut head = Header { stamp: time, origin: time, sequence, incarnation: 0, count };
    if is_wild(random) {
        (head.stamp, head.origin) = (wild(random), wild(random));
    }
    let rest = kind.meta_size() - HEADER_SIZE + count as usize * kind.element_size;
    let mut words: Vec<u64> =
        (0..rest.div_ceil(8)).map(|i| (1e-3 * (i % 7) as f64 + 0.1).to_bits()).collect();
    if *kind == *DepthImage::KIND {
        let [fx, fy, cx, cy, depth_unit] = [4.0, 4.0, 1.5, 1.0, 1e-3];
        let (width, height, length) = (4, 3, ELEMENTS);
        let body = Intrinsics { fx, fy, cx, cy, depth_unit, width, height, reserved: 0, length };
        words[..size_of::<Intrinsics>() / 8].copy_from_slice(&zerocopy::transmute!(body) as &[u64; 7]);
    }
    for word in &mut words {
        if is_wild(random) {
            *word = wild(random);
        }
    }
    let mut bytes = AlignedBytes::joined(head.as_bytes(), &words.as_bytes()[..rest]);
    if kind.body_size > 0 {
        let at = kind.meta_size() - 4;
        bytes[at..at + 4].copy_from_slice(&count.to_le_bytes());
    }
    bytes
}

/// An entry of a journal that says that one sample was sent on each output.
fn entry(sequence: u64, outputs: usize, random: &mut impl Rng, garbage: Garbage) -> AlignedBytes {
    use stillpoint_samples::{JournalBody, JournalRef, RefKind};
    let time = 1_000_000 * sequence;
    let count = outputs as u32;
    let cause = if sequence == 0 { 0 } else { 1 };
    let mut body =
        JournalBody { index: sequence, nominal: time, cause, length: count, ..JournalBody::default() };
    let mut head = Header { stamp: time, origin: time, sequence, incarnation: 0, count };
    let mut refs: Vec<JournalRef> = (0..count)
        .map(|port| JournalRef {
            first: sequence,
            total: sequence + 1,
            count: 1,
            port,
            kind: RefKind::Output as u32,
            ..JournalRef::default()
        })
        .collect();
    if matches!(garbage, Garbage::Some) && random.next_u32().is_multiple_of(4) {
        (head.stamp, head.origin) = (random.next_u64(), random.next_u64());
        (body.sent_before, body.outcome, body.cause) =
            (random.next_u64(), random.next_u32() % 4, random.next_u32() % 6);
        for r in &mut refs {
            (r.first, r.total, r.count) = (random.next_u64(), random.next_u64(), random.next_u32());
            (r.port, r.lost, r.passed) = (random.next_u32() % 4, random.next_u64(), random.next_u64());
        }
    }
    AlignedBytes::joined(&[head.as_bytes(), body.as_bytes()].concat(), refs.as_bytes())
}

fn session(random: &mut impl Rng, garbage: Garbage) -> Vec<u8> {
    let mut part = PartWriter::new(Vec::new(), Compression::None, &Opening::default()).unwrap();
    let frame = Some("couch".to_owned());
    let journals: Vec<_> = OPERATORS
        .iter()
        .map(|(operator, inputs)| {
            let inputs = inputs.iter().map(ToString::to_string).collect();
            let role = Role::Journal { inputs, outputs: outputs(operator) };
            let name = format!("{operator}.journal");
            let info =
                TopicInfo { name, operator: operator.to_string(), kind: Journal::KIND, frame: None, role };
            (part.add_topic(info).unwrap(), outputs(operator).len())
        })
        .collect();
    let topics: Vec<_> = TOPICS
        .iter()
        .map(|(name, kind)| {
            let operator = name.split('.').next().unwrap_or_default().to_owned();
            let role = Role::Computed;
            let info = TopicInfo { name: name.to_string(), operator, kind, frame: frame.clone(), role };
            (part.add_topic(info).unwrap(), *kind)
        })
        .collect();
    for sequence in 0..6 {
        for (topic, outputs) in &journals {
            let bytes = entry(sequence, *outputs, random, garbage);
            part.write(*topic, Pieces::split(Journal::KIND, &bytes).unwrap(), sequence).unwrap();
        }
        for (topic, kind) in &topics {
            let bytes = sample(kind, sequence, random, garbage);
            // A sample that is none is not written; the recorder would not, either.
            if let Ok(pieces) = Pieces::split(kind, &bytes) {
                let _ = part.write(*topic, pieces, sequence);
            }
        }
    }
    part.finish(&Closing::default()).unwrap()
}

/// The page of a session of these bytes, if it is one.
fn page(bytes: Vec<u8>) -> Option<String> {
    let bytes: Arc<[u8]> = bytes.into();
    let session = Session::from_sources(vec![(PathBuf::from("part-000.mcap"), Bytes::Bytes(bytes))]).ok()?;
    let sections = sections_of(&session, Path::new("nowhere"), &Registry::new(&[]), 2).unwrap();
    for section in &sections {
        serde_json::to_string(&section.to_json()).unwrap();
    }
    Some(html::page("broken", "", &sections))
}

#[test]
fn a_small_session_of_every_kind_has_a_page() {
    let mut random = chacha20::ChaCha8Rng::seed_from_u64(1);
    let page = page(session(&mut random, Garbage::None)).unwrap();
    for word in [
        "head.report",
        "fused.state",
        "filter.diagnostics",
        "rig.truth",
        "face on rig.depth",
        "target.reference",
    ] {
        assert!(page.contains(word), "{word}");
    }
}

#[test]
fn garbage_in_samples_and_journals_makes_a_page_and_nothing_else() {
    let mut random = chacha20::ChaCha8Rng::seed_from_u64(2);
    for _ in 0..150 {
        let page = page(session(&mut random, Garbage::Some)).unwrap();
        assert!(!page.contains("NaN") && page.len() < 4_000_000, "{}", page.len());
    }
}

#[test]
fn garbage_in_the_file_is_refused_or_makes_a_page() {
    let mut random = chacha20::ChaCha8Rng::seed_from_u64(3);
    let whole = session(&mut random, Garbage::None);
    let mut pages = 0;
    for round in 0..500 {
        let mut bytes = whole.clone();
        for _ in 0..1 + round % 4 {
            let at = random.random_range(0..bytes.len());
            bytes[at] = random.random();
        }
        if round % 5 == 0 {
            bytes.truncate(random.random_range(0..whole.len()));
        }
        pages += u32::from(page(bytes).is_some());
    }
    assert!(pages > 250, "{pages}");
}
