//! Bytes of anybody: no panic, and no memory beyond what arrives.

use proptest::prelude::*;
use stillpoint_plan::fluence::Goals;
use stillpoint_pool::{
    Call, Client, ClientSettings, Hash, Inside, Message, Store, Worker, WorkerSettings, answer, goals,
};

use crate::simulated::build;
use crate::water::Water;

/// A process without contents that takes every answer.
pub struct Nothing;

impl Inside for Nothing {
    fn content(&self, _: &Hash) -> Option<&[u8]> {
        None
    }

    fn check(&self, _: &Hash, _: &[u8]) -> Result<(), String> {
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
    let again: Goals = goals::from_bytes(&bytes, water.goals.rows()).unwrap();
    assert_eq!((again.structures(), again.voxels()), (water.goals.structures(), water.goals.voxels()));
    assert!(goals::from_bytes(&bytes, water.goals.rows() + 1).is_err());
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
        worker.hear(*now, from, &bytes);
        worker.tick(*now);
        while let Some(job) = worker.next_job() {
            let result = job.ready.compute();
            worker.finish(job.key, result);
        }
        client.hear(*now, from, &bytes, &Nothing);
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
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300), kind in 0..15_u8) {
        let mut bytes = bytes;
        let _ = Message::from_bytes(&bytes);
        let magics: [&[u8]; 5] = [b"SPM2", b"SPCALL01", b"SPGOAL01", b"SPPLAN01", b"SPPRIC01"];
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
