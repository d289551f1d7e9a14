//! Simulations of records whose outcome is known.

use super::*;
use crate::record::{Attempt, Handled, RecordedCall, Round};

const FAST: Network = Network { bits_per_s: 1e12, delay: 1000 };

/// A solve of one second of these contents, without an answer of any size.
fn solve(inputs: &[usize], answer: usize) -> RecordedCall {
    let attempt = Attempt {
        worker: Some("w".to_owned()),
        asked_s: 0.0,
        answered_s: Some(1.0),
        received_s: 0.0,
        opened_s: 0.0,
        computed_s: Some(1.0),
    };
    RecordedCall {
        kind: "solve".to_owned(),
        bytes: 100,
        inputs: inputs.to_vec(),
        answer: Some(answer),
        after: None,
        submitted_s: 0.0,
        taken_s: 0.0,
        attempts: vec![attempt],
    }
}

/// Rounds of so many solves, with so much time of the client between them; each solve has two contents of this many bytes.
fn record(rounds: usize, solves: usize, between_s: f64, bytes: u64) -> Record {
    let round = |round: usize| {
        let begun_s = round as f64 * (1.0 + between_s);
        let calls: Vec<usize> = (round * solves..(round + 1) * solves).collect();
        Round { begun_s, ended_s: begun_s + 1.0, needs: calls.clone(), calls }
    };
    let calls = 0..rounds * solves;
    let contents = std::iter::once(bytes).chain(calls.clone().flat_map(|_| [bytes, 64])).collect();
    Record {
        build: "a build".to_owned(),
        contents,
        calls: calls.map(|call| solve(&[0, 1 + 2 * call], 2 + 2 * call)).collect(),
        rounds: (0..rounds).map(round).collect(),
        handled: Handled::default(),
    }
}

fn run(record: &Record, workers: usize, network: Network) -> Outcome {
    Simulation { workers, network }.run(&[record]).unwrap()
}

#[test]
fn many_calls_of_one_round_take_their_share_on_each_worker() {
    let record = record(1, 64, 0.0, 1000);
    for workers in [2, 4, 8] {
        let outcome = run(&record, workers, FAST);
        assert_eq!(outcome.work_s, 64.0);
        // The first answer of each worker is compared, and one call in 32; the last call may begin after another one.
        let repeated = workers as f64 + 4.0;
        let least = 64.0 / workers as f64;
        assert!(
            (least..least + 1.1 + repeated / workers as f64).contains(&outcome.seconds),
            "{workers} workers: {outcome:?}"
        );
        assert!((1.0..=repeated).contains(&outcome.spent.repeated_s), "{outcome:?}");
        assert_eq!(outcome.spent.computed_s, 64.0);
        assert_eq!(outcome.tally.local, 0);
    }
}

#[test]
fn no_number_of_workers_is_faster_than_the_rounds_and_the_client_between_them() {
    let record = record(5, 4, 0.5, 1000);
    let outcome = run(&record, 32, FAST);
    assert!((outcome.between_s - 2.0).abs() < 1e-9);
    assert!((7.0..9.5).contains(&outcome.seconds), "{outcome:?}");
}

#[test]
fn contents_take_their_time_on_the_link_of_the_client() {
    // 16 contents of 10 MB go to one worker or another, and the one of all calls to each: 100 MB/s.
    let record = record(1, 16, 0.0, 10_000_000);
    let network = Network { bits_per_s: 8e8, delay: 100_000 };
    let (slow, fast) = (run(&record, 16, network), run(&record, 16, FAST));
    assert!(fast.seconds < 3.5, "{fast:?}");
    assert!(slow.seconds > 1.0 + 1.7, "{slow:?}");
    assert!(slow.sent >= 170_000_000, "{slow:?}");
    assert!(slow.spent.starved_s > fast.spent.starved_s);
}

#[test]
fn messages_of_those_who_fetch_from_a_worker_do_not_lengthen_what_it_fetches() {
    let mut record = record(1, 2, 0.0, 10_000_000);
    record.calls[1].inputs = record.calls[0].inputs.clone();
    // Before its second call the recorded worker fetched nothing.
    record.calls[1].attempts[0].received_s = 5.0;
    let outcome = run(&record, 1, FAST);
    assert!(outcome.seconds < 4.0, "{outcome:?}");
    record.calls[0].attempts[0].received_s = 5.0;
    let outcome = run(&record, 1, FAST);
    assert!(outcome.seconds > 7.0, "{outcome:?}");
}

#[test]
fn clients_that_ask_at_the_same_time_fill_the_pauses_of_each_other() {
    let record = record(6, 2, 1.0, 1000);
    let one = run(&record, 4, FAST);
    let four = Simulation { workers: 4, network: FAST }.run(&[&record; 4]).unwrap();
    assert_eq!(four.work_s, 4.0 * one.work_s);
    assert!(four.efficiency() > 1.8 * one.efficiency(), "{one:?} {four:?}");
}

#[test]
fn the_same_simulation_has_the_same_outcome() {
    let record = record(3, 8, 0.1, 300_000);
    let network = Network { bits_per_s: 1e9, delay: 1_000_000 };
    assert_eq!(run(&record, 3, network), run(&record, 3, network));
}

#[test]
fn a_record_that_cannot_be_simulated_is_refused() {
    let simulation = Simulation { workers: 2, network: FAST };
    assert_eq!(simulation.run(&[&Record::default()]), Err(SimulationError::Empty));
    let mut games = record(1, 1, 0.0, 10);
    games.calls[0].kind = "game".to_owned();
    assert_eq!(simulation.run(&[&games]), Err(SimulationError::Kind("game".to_owned())));
    let mut silent = record(1, 1, 0.0, 10);
    silent.calls[0].attempts[0].computed_s = None;
    assert_eq!(simulation.run(&[&silent]), Err(SimulationError::NoTimes));
}
