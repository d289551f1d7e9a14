//! Bytes of anybody: no panic, and no memory beyond what arrives.

use proptest::prelude::*;
use stillpoint_plan::fluence::{Goals, ObjectiveSpec, StructureObjectives};
use stillpoint_pool::{
    Call, CallError, Client, ClientSettings, Hash, Inside, Message, Spent, Store, WireError, Worker,
    WorkerSettings, answer, goals,
};

use crate::simulated::build;
use crate::water::Water;

/// A process without contents that takes every answer.
pub struct Nothing;

impl Inside for Nothing {
    fn content(&self, _: &Hash) -> Option<&[u8]> {
        None
    }

    fn check(&self, _: &Hash, _: &[u8]) -> Result<(), CallError> {
        Ok(())
    }
}

fn call() -> Call {
    let hash = Hash::of(b"dose");
    Call::solve(Hash::of(b"goals"), vec![vec![hash, hash], vec![hash, hash]], Some(vec![1.0, 0.5]), 1e-6)
}

fn messages() -> Vec<Vec<u8>> {
    let key = call().key(&build());
    let folder = tempfile::tempdir().unwrap();
    let hello = worker(folder.path()).hello();
    let all = [
        Message::Hello(hello),
        Message::Ask { key, call: call().to_bytes() },
        Message::Working { key },
        Message::Busy { key },
        Message::Answer { key, bytes: vec![7; 100] },
        Message::Done { key, answer: key },
        Message::Failed { key, reason: "a reason".into() },
        Message::Cancel { key },
        Message::Want { content: key, part: 3, only: true },
        Message::Part { content: Hash::of(b"goals"), part: 0, length: 100, bytes: vec![1; 100] },
        Message::Absent { content: key },
        Message::Elsewhere { content: key, peer: "w1".into() },
        Message::Holds { contents: vec![key, Hash::of(b"goals")] },
        Message::Wrong { content: key, peer: "w1".into() },
        Message::Demand { calls: 17 },
        Message::Spent { key, spent: Spent { received: 1, opened: 2, computed: 3, length: 4 } },
    ];
    all.iter().map(Message::to_bytes).collect()
}

fn worker(folder: &std::path::Path) -> Worker {
    let settings = WorkerSettings { build: build(), incarnation: 1, slots: 2, most_open: 1 << 20 };
    Worker::new(settings, Store::open(folder, 1 << 20).unwrap())
}

fn harmed(whole: &[u8], harms: &[(u8, prop::sample::Index, u64)]) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for (kind, at, word) in harms {
        let at = at.index(bytes.len() + 1);
        match kind {
            0 => bytes.truncate(at),
            1 => bytes.extend(word.to_le_bytes()),
            2 if at + 8 <= bytes.len() => bytes[at..at + 8].copy_from_slice(&word.to_le_bytes()),
            _ if at < bytes.len() => bytes[at] ^= 1 << (word % 8),
            _ => {}
        }
    }
    bytes
}

#[test]
fn messages_are_read_as_they_are_written() {
    for bytes in messages() {
        assert_eq!(Message::from_bytes(&bytes).unwrap().to_bytes(), bytes);
    }
    assert_eq!(Call::from_bytes(&call().to_bytes()).unwrap(), call());
    let water = Water::new();
    let bytes = goals::to_bytes(&water.goals);
    let repeated: Goals = goals::from_bytes(&bytes, water.goals.rows()).unwrap();
    assert_eq!((repeated.structures(), repeated.voxels()), (water.goals.structures(), water.goals.voxels()));
    assert!(goals::from_bytes(&bytes, water.goals.rows() + 1).is_err());
}

#[test]
fn goals_with_every_shape_of_objective_are_read_as_they_are_written() {
    let texts = ObjectiveSpec::EXAMPLES.iter().flat_map(|(_, texts)| *texts);
    let specs = texts.map(|text| serde_json::from_str::<ObjectiveSpec>(text).unwrap());
    let structure = StructureObjectives {
        name: "all".into(),
        voxels: vec![1, 4, 300],
        volumes: vec![1.0, 0.5, 0.25],
        to_target_mm: vec![0.0, 3.0, 12.5],
        objectives: specs.map(|spec| spec.resolve(60.0, 70.0)).collect(),
    };
    assert!(structure.objectives.len() >= ObjectiveSpec::EXAMPLES.len());
    let goals = Goals::new(vec![structure], 301).unwrap();
    let bytes = goals::to_bytes(&goals);
    assert_eq!(goals::from_bytes(&bytes, 301).unwrap().structures(), goals.structures());
}

/// One value has one hash: a number has no longer form, and a float every bit of its own.
#[test]
fn a_call_has_no_other_bytes_than_its_canonical_ones() {
    let bytes = call().to_bytes();
    // Behind the mark of 8 bytes stands the kind, 1 in one byte; the same number in two bytes means the same.
    assert_eq!(bytes[8], 1);
    let longer = [&bytes[..8], &[0x81, 0x00], &bytes[9..]].concat();
    assert_eq!(Call::from_bytes(&longer), Err(WireError::NotCanonical("a call")));
    let behind = [&bytes[..], &[0]].concat();
    assert_eq!(Call::from_bytes(&behind), Err(WireError::Trailing(1)));
    let other = [b"SPCALL02", &bytes[8..]].concat();
    assert_eq!(Call::from_bytes(&other), Err(WireError::Version("a call")));
    for bits in [0x7ff8_dead_beef_0001_u64, 0x8000_0000_0000_0000, 1] {
        let dose = Call::Dose {
            engine: Hash::of(b"engine"),
            gantry_deg: f64::from_bits(bits),
            couch_deg: f64::from_bits(!bits),
        };
        let Call::Dose { gantry_deg, couch_deg, .. } = Call::from_bytes(&dose.to_bytes()).unwrap() else {
            unreachable!()
        };
        assert_eq!((gantry_deg.to_bits(), couch_deg.to_bits()), (bits, !bits));
        assert!(dose.to_bytes().ends_with(&[bits.to_le_bytes(), (!bits).to_le_bytes()].concat()));
    }
}

#[test]
fn a_length_beyond_its_bound_is_refused_before_anything_is_read() {
    let most = stillpoint_pool::MOST_BYTES;
    let long = [b"SPCALL03".as_slice(), &vec![0xff; most]].concat();
    assert!(
        matches!(Call::from_bytes(&long), Err(WireError::Bound { found, .. }) if found == most as u64 + 8)
    );
    let message = [b"SPM3".as_slice(), &vec![0xff; most + 4096]].concat();
    assert!(matches!(Message::from_bytes(&message), Err(WireError::Bound { .. })));
    // Two rows, and a list of 5000 structures of which no byte is there.
    let goals = [b"SPGOAL03".as_slice(), &[2, 0x88, 0x27]].concat();
    assert!(
        goals::from_bytes(&goals, 2)
            .unwrap_err()
            .to_string()
            .contains("the number of structures is 5000; at most 4096")
    );
    let key = Hash::of(b"key");
    let name = "w".repeat(65);
    let named = Message::Elsewhere { content: key, peer: name }.to_bytes();
    assert!(matches!(Message::from_bytes(&named), Err(WireError::Bound { found: 65, most: 64, .. })));
    let failed = Message::Failed { key, reason: "\u{e9}".repeat(4000) }.to_bytes();
    let Ok(Message::Failed { reason, .. }) = Message::from_bytes(&failed) else { unreachable!() };
    assert_eq!(reason.len(), 4096, "the beginning of a long reason");
}

#[test]
fn a_part_of_a_content_with_a_changed_bit_is_refused() {
    let part = Message::Part { content: Hash::of(b"goals"), part: 0, length: 100, bytes: vec![1; 100] };
    let whole = part.to_bytes();
    assert_eq!(Message::from_bytes(&whole), Ok(part));
    for at in whole.len() - 100..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= 4;
        assert!(matches!(Message::from_bytes(&bytes), Err(WireError::Broken { what: "a message", .. })));
    }
}

#[test]
fn broken_messages_harm_neither_side() {
    let whole = messages();
    let folder = tempfile::tempdir().unwrap();
    let mut worker = worker(folder.path());
    let mut client = Client::new(0, ClientSettings::new(build()));
    client.submit(0, &call());
    let harm = (0..4_u8, any::<prop::sample::Index>(), any::<u64>());
    let strategy = (any::<prop::sample::Index>(), prop::collection::vec(harm, 0..3), 0..3_usize);
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::default()
    });
    let state = std::cell::RefCell::new((&mut worker, &mut client, 0_u64));
    let outcome = runner.run(&strategy, |(which, harms, from)| {
        let (worker, client, now) = &mut *state.borrow_mut();
        let bytes = harmed(&whole[which.index(whole.len())], &harms);
        let from = ["w0", "w1", "client"][from];
        *now += 30_000_000;
        worker.handle(*now, from, &bytes);
        worker.tick(*now);
        while let Some(job) = worker.next_job() {
            let key = job.key;
            let result = job.open().and_then(|ready| ready.compute());
            worker.finish(key, result, Spent::default());
        }
        client.handle(*now, from, &bytes, &Nothing);
        client.tick(*now);
        prop_assert!(worker.take_messages().len() < 100 && client.take_messages().len() < 100);
        prop_assert!(worker.hello().waiting <= 256);
        Ok(())
    });
    assert!(outcome.is_ok(), "{outcome:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300), kind in 0..16_u8) {
        let mut bytes = bytes;
        let _ = Message::from_bytes(&bytes);
        let magics: [&[u8]; 5] = [b"SPM3", b"SPCALL03", b"SPGOAL03", b"SPPLAN02", b"SPPRIC02"];
        for magic in magics {
            let mut named = magic.to_vec();
            named.push(kind);
            named.append(&mut bytes.clone());
            let _ = (Message::from_bytes(&named), Call::from_bytes(&named));
            let _ = (goals::from_bytes(&named, 1000), answer::plan(&named, None, 3), answer::prices(&named, 2));
        }
        bytes.clear();
    }
}
