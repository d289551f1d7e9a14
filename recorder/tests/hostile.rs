//! Broken input: no panic, no hang, no memory beyond what the input justifies.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use std::sync::{Arc, OnceLock};

use proptest::collection::vec;
use proptest::prelude::*;
use stillpoint_recorder::{Compression, Session, Source, recover};
use stillpoint_samples::{
    Actuation, AlignedBytes, ClusterTable, ConsoleCommand, Contacts, Datagram, DepthImage, Diagnostics,
    Duties, FaceBoxes, FarEnd, Gate, GreyImage, Health, Hull, Journal, Pieces, PlanRequest, PlanUpdate,
    Plane, PointCloud, PoolMessage, Pose, PoseReport, Rejection, RigState, Sample, Setting, SettingAnswer,
    SurfacePieces, Target, Track,
};

/// Looks at the pieces as a sample of each kind.
macro_rules! view_as_each {
    ($($kind:ty),*) => {
        const KINDS: &[&str] = &[$(<$kind as Sample>::KIND.name),*];
        fn view_as_each(pieces: Pieces<'_>) {
            $(let _ = pieces.view::<$kind>();)*
        }
    };
}

view_as_each!(
    Actuation,
    ClusterTable,
    ConsoleCommand,
    Contacts,
    Datagram,
    DepthImage,
    Diagnostics,
    Duties,
    FaceBoxes,
    FarEnd,
    Gate,
    GreyImage,
    Health,
    Hull,
    Journal,
    PlanRequest,
    PlanUpdate,
    Plane,
    PointCloud,
    PoolMessage,
    Pose,
    PoseReport,
    Rejection,
    RigState,
    Setting,
    SettingAnswer,
    SurfacePieces,
    Target,
    Track
);

#[test]
fn broken_samples_are_looked_at_as_every_kind() {
    assert_eq!(KINDS, stillpoint_samples::all().iter().map(|kind| kind.name).collect::<Vec<_>>());
}

/// Address space that the process has taken at most so far, bytes: promised memory counts, touched or not.
fn peak() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmPeak:")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<usize>().unwrap() * 1024
}

/// What may be taken beyond what reading whole files took. No input here is larger than 100 kB.
const SLACK: usize = 96 << 20;

/// The most that may be taken in this process: threads and decoders have taken theirs when it is first asked for.
fn allowed() -> usize {
    static ALLOWED: OnceLock<usize> = OnceLock::new();
    *ALLOWED.get_or_init(|| {
        (0..3).for_each(|file| read_everything(whole(file)));
        peak() + SLACK
    })
}

/// Fails where `work` takes memory that its input does not justify.
fn within_bounds(work: impl FnOnce()) {
    let allowed = allowed();
    work();
    let peak = peak();
    assert!(peak <= allowed, "{peak} bytes taken, {allowed} allowed");
}

fn whole(number: usize) -> &'static [u8] {
    static FILES: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    let kinds = [Compression::None, Compression::Lz4, Compression::Zstd];
    &FILES.get_or_init(|| kinds.into_iter().map(|c| fixture::pipeline(c, 8).0).collect())[number]
}

/// One way to break a file.
#[derive(Clone, Debug)]
enum Break {
    Set(prop::sample::Index, u8),
    Number(prop::sample::Index, u64),
    Cut(prop::sample::Index),
    Remove(prop::sample::Index, usize),
    Insert(prop::sample::Index, Vec<u8>),
    Repeat(prop::sample::Index, usize),
}

fn breaks() -> impl Strategy<Value = Break> {
    let at = any::<prop::sample::Index>;
    let number = prop_oneof![any::<u64>(), Just(u64::MAX), Just(1 << 31), 0..300_u64];
    prop_oneof![
        4 => (at(), any::<u8>()).prop_map(|(i, b)| Break::Set(i, b)),
        2 => (at(), number).prop_map(|(i, n)| Break::Number(i, n)),
        1 => at().prop_map(Break::Cut),
        1 => (at(), 1..200_usize).prop_map(|(i, n)| Break::Remove(i, n)),
        1 => (at(), vec(any::<u8>(), 1..40)).prop_map(|(i, b)| Break::Insert(i, b)),
        1 => (at(), 1..600_usize).prop_map(|(i, n)| Break::Repeat(i, n)),
    ]
}

fn broken(bytes: &[u8], breaks: &[Break]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for b in breaks {
        if bytes.len() < 16 {
            break;
        }
        // The magic bytes stay: without them nothing else is read.
        let at = |i: &prop::sample::Index| 8 + i.index(bytes.len() - 8);
        match b {
            Break::Set(i, byte) => {
                let at = at(i);
                bytes[at] = *byte;
            }
            Break::Number(i, n) => {
                let at = at(i).min(bytes.len() - 8);
                bytes[at..at + 8].copy_from_slice(&n.to_le_bytes());
            }
            Break::Cut(i) => bytes.truncate(at(i)),
            Break::Remove(i, n) => {
                let at = at(i);
                let end = (at + n).min(bytes.len());
                bytes.drain(at..end);
            }
            Break::Insert(i, new) => {
                let at = at(i);
                bytes.splice(at..at, new.iter().copied());
            }
            Break::Repeat(i, n) => {
                let at = at(i);
                let new = bytes[at..(at + n).min(bytes.len())].to_vec();
                bytes.splice(at..at, new);
            }
        }
    }
    bytes
}

fn read_everything(bytes: &[u8]) {
    let bytes: Arc<[u8]> = Arc::from(bytes);
    let named = vec![("broken.mcap".into(), Source::Bytes(Arc::clone(&bytes)))];
    if let Ok(session) = Session::from_sources(named) {
        let _ = session.check_layouts();
        let _ = session.completeness();
        let given = session.samples().filter(|s| s.is_ok()).count() as u64;
        assert!(given <= session.topics().iter().map(|t| t.samples).sum());
    }
    if let Ok((mended, report)) = recover(Source::Bytes(bytes), Vec::new()) {
        let messages =
            mcap::MessageStream::new(&mended).unwrap().inspect(|m| assert!(m.is_ok())).count() as u64;
        assert_eq!(messages, report.messages);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 200, ..ProptestConfig::default() })]

    #[test]
    fn broken_sessions_do_no_harm(file in 0..3_usize, breaks in vec(breaks(), 1..6)) {
        let bytes = broken(whole(file), &breaks);
        within_bounds(|| read_everything(&bytes));
    }

    #[test]
    fn noise_behind_the_magic_does_no_harm(noise in vec(any::<u8>(), 0..400)) {
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.extend(noise);
        within_bounds(|| read_everything(&bytes));
    }

    #[test]
    fn broken_samples_do_no_harm(bytes in vec(any::<u8>(), 0..700), count in prop_oneof![any::<u32>(), 0..12_u32], cut in any::<prop::sample::Index>()) {
        let mut sample = AlignedBytes::copy_of(&bytes);
        if sample.len() >= 32 {
            sample[28..32].copy_from_slice(&count.to_le_bytes());
        }
        within_bounds(|| for kind in stillpoint_samples::all() {
            let _ = Pieces::split(kind, &sample);
            // As shared memory gives it: header and body apart, more elements than are counted.
            let (meta, payload) = sample.split_at(kind.meta_size().min(sample.len()));
            let p = Pieces { meta, payload };
            if let Ok(checked) = p.check(kind) {
                assert!(checked.payload.len() <= payload.len());
            }
            let odd = Pieces { meta: &sample[..cut.index(sample.len() + 1)], payload };
            for p in [p, odd] {
                view_as_each(p);
            }
        });
    }
}

#[test]
fn a_chunk_that_promises_more_than_it_can_hold_gets_no_memory_for_it() {
    let mut bytes = whole(1).to_vec();
    let mut at = 8;
    while bytes[at] != 6 {
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    bytes[at + 9 + 16..at + 9 + 24].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    within_bounds(|| read_everything(&bytes));
}
