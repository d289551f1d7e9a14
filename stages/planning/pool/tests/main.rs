//! The plan over a pool is the plan of one process, whatever happens to messages and workers.

#![allow(clippy::unwrap_used, clippy::panic)]

mod broken;
#[path = "../../network/tests/common/mod.rs"]
mod common;
mod games;
mod simulated;
mod water;

use broken::Nothing;
use games::GRID_MM;
use simulated::{CALM, MS, Part, Simulated, Weather, build};
use stillpoint_network::Rules;
use stillpoint_plan::dose::DoseCache;
use stillpoint_pool::{
    Build, Call, Client, ClientSettings, Event, Hash, Message, Network, Pool, PoolDoses, Record,
    RecordedCall, Simulation, Store, Worker, WorkerSettings,
};
use water::{Water, alone, alone_with, angles, pooled, pooled_with};

const STORM: Weather = Weather { delay: (5 * MS, 200 * MS), lost: 60, doubled: 60 };

fn pool(seed: u64, weather: Weather, parts: &[Part]) -> Pool<Simulated> {
    let settings = ClientSettings { checked: 0.1, ..ClientSettings::new(build()) };
    Pool::new(Simulated::new(seed, weather, parts), settings)
}

#[test]
fn the_plan_is_the_same_with_no_worker_one_and_eight() {
    let water = Water::new();
    let expected = alone(&water);
    for workers in [0, 1, 8] {
        let mut pool = pool(1, CALM, &vec![Part::default(); workers]);
        assert!(pooled(&water, &mut pool) == expected, "{workers} workers");
        let tally = pool.tally();
        match workers {
            0 => assert_eq!(tally.remote, 0),
            1 => assert!(tally.remote > tally.local, "{tally:?}"),
            _ => {
                assert_eq!(tally.local, 0, "{tally:?}");
                assert!(pool.courier().jobs().iter().all(|jobs| *jobs > 0));
            }
        }
    }
}

#[test]
fn the_plan_depends_on_the_leaves_in_progress_and_not_on_the_workers_that_solve_them() {
    let water = Water::new();
    let plans = [4, 8].map(|leaves| {
        let expected = alone_with(&water, leaves);
        for workers in [0, 1, 4] {
            let mut pool = pool(1, CALM, &vec![Part::default(); workers]);
            assert!(pooled_with(&water, &mut pool, leaves) == expected, "{leaves} leaves, {workers} workers");
        }
        let dying = Part { dies_after: 2, ..Part::default() };
        let wrong = Part { wrong_from: 8, ..Part::default() };
        let mut pool = pool(2, STORM, &[dying, Part::default(), wrong, Part::default()]);
        assert!(pooled_with(&water, &mut pool, leaves) == expected, "{leaves} leaves in a storm");
        expected
    });
    assert!(plans[0] != plans[1]);
}

#[test]
fn more_leaves_in_progress_keep_more_workers_busy() {
    let water = Water::new();
    let took = |leaves| {
        let mut pool = pool(1, CALM, &vec![Part { job: 1000 * MS, ..Part::default() }; 4]);
        pooled_with(&water, &mut pool, leaves);
        stillpoint_pool::Courier::now(pool.courier())
    };
    assert!(took(8) < took(2), "{} {}", took(8), took(2));
}

#[test]
fn without_a_worker_this_process_computes_after_its_patience_and_says_nothing_wrong() {
    let water = Water::new();
    let mut pool = pool(1, CALM, &[]);
    pooled(&water, &mut pool);
    // Only the first call waits.
    let waited = stillpoint_pool::Courier::now(pool.courier()) / (1000 * MS);
    assert!((60..65).contains(&waited), "{waited} s");
}

#[test]
fn calls_wait_for_a_worker_that_is_busy_longer_than_the_patience_and_a_worker_that_comes_takes_the_rest() {
    let water = Water::new();
    let expected = alone(&water);
    // Eighteen doses and more than 24 solves of 20 s each.
    let mut pool = pool(4, CALM, &[Part { job: 20_000 * MS, ..Part::default() }]);
    assert!(pooled(&water, &mut pool) == expected);
    // Only what is compared is computed here.
    let tally = pool.tally();
    assert!(tally.local <= tally.compared, "{tally:?}");
}

#[test]
fn without_a_worker_this_process_computes_one_call_after_the_other_and_a_worker_that_comes_takes_the_rest() {
    let now = 61_000 * MS;
    let mut client = Client::new(0, ClientSettings::new(build()));
    for seed in 0..3 {
        let (patient, rules) = (common::patient(seed, GRID_MM), Rules::OPENING);
        client.submit(0, &Call::Game { network: None, case: None, patient, seed, rules });
    }
    client.tick(now);
    assert!(matches!(client.next_event(), Some(Event::Compute(_))));
    assert!(client.next_event().is_none());
    let folder = tempfile::tempdir().unwrap();
    let settings = WorkerSettings { build: build(), incarnation: 1, slots: 1, most_open: 1 << 20 };
    let hello = Worker::new(settings, Store::open(folder.path(), 1 << 20).unwrap()).hello();
    client.handle(now, "w0", &Message::Hello(hello).to_bytes(), &Nothing);
    client.tick(now + MS);
    assert!(client.next_event().is_none());
    let asked = client.take_messages();
    assert_eq!(asked.iter().filter(|(_, message)| matches!(message, Message::Ask { .. })).count(), 2);
}

#[test]
fn lost_late_and_doubled_messages_change_nothing() {
    let water = Water::new();
    let expected = alone(&water);
    for seed in 0..2 {
        let mut pool = pool(seed, STORM, &vec![Part::default(); 3]);
        assert!(pooled(&water, &mut pool) == expected, "seed {seed}");
        assert!(pool.workers().values().all(|worker| worker.shut_out.is_none()), "{:?}", pool.take_news());
    }
}

#[test]
fn a_worker_that_drains_finishes_its_calls_and_none_is_computed_twice() {
    let water = Water::new();
    let expected = alone(&water);
    let draining = Part { drains_after: 3, ..Part::default() };
    let parts = [draining.clone(), Part::default(), draining, Part::default()];
    let mut pool = pool(7, CALM, &parts);
    assert!(pooled(&water, &mut pool) == expected);
    let jobs = pool.courier().jobs();
    let tally = pool.tally();
    assert_eq!((jobs[0], jobs[2]), (3, 3));
    assert_eq!((tally.local, tally.hedged), (0, 0));
    // One job for each call, and another one for each that was compared.
    let computed = pool.courier().computed.clone();
    let calls: std::collections::BTreeSet<_> = computed.iter().collect();
    // A comparison has two answers.
    assert_eq!(2 * (computed.len() - calls.len()) as u64, tally.compared);
}

#[test]
fn a_worker_that_is_killed_twenty_times_changes_nothing() {
    let water = Water::new();
    let expected = alone(&water);
    let dying = Part { dies_after: 2, ..Part::default() };
    let mut pool = pool(5, CALM, &[dying, Part { job: 600 * MS, ..Part::default() }]);
    assert!(pooled(&water, &mut pool) == expected);
    assert!(pool.courier().deaths >= 20, "{} deaths", pool.courier().deaths);
}

#[test]
fn a_worker_whose_answers_are_wrong_is_named_and_shut_out() {
    let water = Water::new();
    let expected = alone(&water);
    // From its first answer, and from later ones, when other answers of it are in use.
    for wrong_from in [0, 8] {
        let wrong = Part { wrong_from, ..Part::default() };
        let settings = ClientSettings { checked: 0.4, ..ClientSettings::new(build()) };
        let parts = [Part::default(), wrong, Part::default()];
        let mut pool = Pool::new(Simulated::new(6, CALM, &parts), settings);
        assert!(pooled(&water, &mut pool) == expected, "wrong from answer {wrong_from}");
        let out: Vec<&String> =
            pool.workers().iter().filter(|(_, w)| w.shut_out.is_some()).map(|(name, _)| name).collect();
        assert_eq!(out, ["w1"]);
        let news = pool.take_news();
        assert!(news.iter().any(|text| text.starts_with("worker `w1` is shut out: ")), "{news:?}");
    }
}

#[test]
fn a_record_of_a_plan_gives_the_time_that_it_took_and_that_of_other_workers() {
    let water = Water::new();
    let job = 500 * MS;
    let recorded = |workers: usize| {
        let parts = vec![Part { job, ..Part::default() }; workers];
        let mut pool = Pool::new(Simulated::new(1, CALM, &parts), ClientSettings::new(build()));
        pool.start_record();
        pooled_with(&water, &mut pool, 8);
        pool.take_record().unwrap()
    };
    let (one, four) = (recorded(1), recorded(4));
    assert!(pool(1, CALM, &[]).take_record().is_none());
    assert_eq!(Record::from_text(&one.to_text()).unwrap(), one);
    assert_eq!(one.calls.len(), four.calls.len());
    assert_eq!(one.work_s(), 0.5 * one.calls.len() as f64);
    let network = Network { bits_per_s: 1e10, delay: MS };
    for (from, workers, took) in [(&one, 1, &one), (&one, 4, &four), (&four, 4, &four), (&four, 1, &one)] {
        let outcome = Simulation { workers, network }.run(&[from]).unwrap();
        let ratio = outcome.seconds / took.seconds();
        assert!((0.85..1.15).contains(&ratio), "{workers} workers: {outcome:?}, {} s", took.seconds());
    }
}

#[test]
fn prices_are_asked_as_soon_as_their_solve_is_there_and_computed_before_solves_that_wait() {
    let water = Water::new();
    let settings = ClientSettings { checked: 0.0, ..ClientSettings::new(build()) };
    let part = Part { job: 500 * MS, ..Part::default() };
    let mut pool = Pool::new(Simulated::new(1, CALM, &[part]), settings);
    pool.start_record();
    pooled_with(&water, &mut pool, 8);
    let record = pool.take_record().unwrap();
    let answered = |call: &RecordedCall| call.attempts.iter().find_map(|attempt| attempt.answered_s).unwrap();
    let of_kind = |kind: &'static str| record.calls.iter().filter(move |call| call.kind == kind);
    let solves: Vec<f64> = of_kind("solve").map(answered).collect();
    assert!(of_kind("price").count() > 10);
    for price in of_kind("price") {
        let solve = answered(&record.calls[price.after.unwrap()]);
        assert!((0.0..0.1).contains(&(price.submitted_s - solve)), "{price:?}");
        let meanwhile = solves.iter().filter(|at| (price.submitted_s..answered(price)).contains(*at)).count();
        // The one that was computed when the price was asked.
        assert!(meanwhile <= 1, "{meanwhile} solves before {price:?}");
    }
}

#[test]
fn workers_give_each_other_what_they_hold_and_one_that_gives_something_else_is_no_source_any_more() {
    let water = Water::new();
    let expected = alone(&water);
    let mut pool = pool(9, CALM, &vec![Part::default(); 6]);
    assert!(pooled(&water, &mut pool) == expected);
    assert!(pool.courier().given > 0);

    let parts: Vec<Part> = (0..6).map(|place| Part { gives_wrong: place == 2, ..Part::default() }).collect();
    let mut pool = self::pool(9, CALM, &parts);
    assert!(pooled(&water, &mut pool) == expected);
    let news = pool.take_news();
    let reported =
        news.iter().filter(|text| text.starts_with("worker `w2` is no longer a source of contents: "));
    assert!(reported.count() > 0, "{news:?}");
    // Its answers are right, so it is asked all the same.
    assert!(pool.workers().values().all(|worker| worker.shut_out.is_none()));
}

#[test]
fn doses_of_workers_stay_out_of_the_folder_until_they_are_in_no_doubt() {
    let water = Water::new();
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let is_missing = |cache: &DoseCache| cache.missing(&water.engine, &angles()).len();
    for left in [18, 0] {
        let mut made = PoolDoses::in_folder(folder.path()).unwrap();
        made.fill(
            &mut pool(7, CALM, &[Part::default()]),
            std::slice::from_ref(&water.engine),
            &angles(),
            || (),
        )
        .unwrap();
        assert_eq!((is_missing(made.cache()), is_missing(&cache)), (0, 18));
        if left == 0 {
            made.adopt().unwrap();
        }
        drop(made);
        assert_eq!(is_missing(&cache), left);
    }
}

#[test]
fn a_worker_cannot_speak_ill_of_another_to_which_it_was_not_sent() {
    let mut client = Client::new(0, ClientSettings::new(build()));
    let folder = tempfile::tempdir().unwrap();
    let settings = WorkerSettings { build: build(), incarnation: 1, slots: 1, most_open: 1 << 20 };
    let hello = Message::Hello(Worker::new(settings, Store::open(folder.path(), 1 << 20).unwrap()).hello());
    for name in ["w0", "w1"] {
        client.handle(0, name, &hello.to_bytes(), &Nothing);
    }
    client.take_news();
    let wrong = Message::Wrong { content: Hash::of(b"dose"), peer: "w1".to_owned() };
    client.handle(1, "w0", &wrong.to_bytes(), &Nothing);
    assert!(client.take_news().is_empty());
}

#[test]
fn a_worker_whose_clock_is_set_back_between_its_lives_is_asked_again() {
    let water = Water::new();
    let dying = Part { dies_after: 2, clock_goes_back: true, ..Part::default() };
    let mut pool = pool(5, CALM, &[dying]);
    assert!(pooled(&water, &mut pool) == alone(&water));
    assert!(pool.courier().deaths >= 10, "{} deaths", pool.courier().deaths);
}

#[test]
fn a_worker_of_another_build_is_never_asked() {
    let water = Water::new();
    let expected = alone(&water);
    let other = Part { build: Build::of("another build"), ..Part::default() };
    let mut pool = pool(7, CALM, &[other, Part::default()]);
    assert!(pooled(&water, &mut pool) == expected);
    assert_eq!(pool.courier().jobs()[0], 0);
    let news = pool.take_news();
    assert!(news.iter().any(|text| text.contains("`the build of the tests` here, `another build` there")));
}

#[test]
fn a_worker_that_answers_nothing_and_one_with_too_small_a_cache_only_cost_time() {
    let water = Water::new();
    let expected = alone(&water);
    let mute = Part { mute: true, ..Part::default() };
    let small = Part { cache: 20_000, ..Part::default() };
    let mut pool = pool(8, CALM, &[mute, small, Part::default()]);
    assert!(pooled(&water, &mut pool) == expected);
    assert!(pool.tally().hedged > 0);
    assert!(pool.take_news().iter().any(|text| text.contains("do not fit into the cache")));
}

#[test]
fn a_worker_adds_up_the_calls_that_those_who_ask_said_of_late() {
    let folder = tempfile::tempdir().unwrap();
    let settings = WorkerSettings { build: build(), incarnation: 1, slots: 1, most_open: 1 << 20 };
    let mut worker = Worker::new(settings, Store::open(folder.path(), 1 << 20).unwrap());
    let says = |worker: &mut Worker, ms: u64, from: &str, calls: u32| {
        worker.handle(ms * MS, from, &Message::Demand { calls }.to_bytes());
    };
    says(&mut worker, 0, "plan-a", 7);
    says(&mut worker, 500, "plan-b", 5);
    says(&mut worker, 1_000, "plan-a", 3);
    assert_eq!(worker.demand(1_000 * MS), 8);
    assert_eq!(worker.demand(3_200 * MS), 3, "one who is silent asks for nothing");
    assert_eq!(worker.demand(9_000 * MS), 0);
    // Names do not pile up.
    (0..10_000).for_each(|i| says(&mut worker, 10_000, &format!("plan-{i}"), 1));
    assert!((1..=256).contains(&worker.demand(10_000 * MS)));
}
