//! What iceoryx2 does to samples of the dead, and why ours stay.

use iceoryx2::prelude::*;
use stillpoint_samples::{Diagnostics, HEADER_SIZE, Header, Sample};
use stillpoint_shm::{Contract, Domain, Topic, sweep};
use zerocopy::IntoBytes;

use crate::bench::{Bench, line, pipeline, wait_for};

/// Tells the test's own program to be the publisher that dies.
const DYING: &str = "STILLPOINT_DYING_PUBLISHER";

fn contract() -> Contract {
    Contract { buffer: 8, pool: 16, ..Contract::new("dying.value", Diagnostics::KIND, None, 1) }
}

/// Not a test of its own: sends five samples and dies at once, as by kill -9.
#[test]
fn dying_publisher() {
    let Ok(root) = std::env::var(DYING) else { return };
    let (root, prefix) = root.split_once('|').unwrap();
    let domain = Domain::join(std::path::Path::new(root), prefix, "dying").unwrap();
    let publisher = Topic::open(&domain, &contract()).unwrap().publisher().unwrap();
    publisher.connect().unwrap();
    for sequence in 0..5 {
        let mut loan = publisher.loan(1).unwrap().unwrap();
        let (meta, _) = loan.parts_mut();
        meta.fill(0);
        meta[..HEADER_SIZE].copy_from_slice(Header { sequence, count: 1, ..Header::default() }.as_bytes());
        publisher.send(loan).unwrap();
    }
    let own = rustix::process::getpid();
    rustix::process::kill_process(own, rustix::process::Signal::KILL).unwrap();
}

/// Samples that a consumer still gets of a publisher that was killed, after somebody else joined in between.
fn received_after(join: impl FnOnce(&std::path::Path, &str, u32)) -> usize {
    let bench = Bench::new();
    let root = bench.path("d");
    // The folder's name is its own; objects of a run begin otherwise.
    let prefix = format!("{}_", bench.path("r").parent().unwrap().file_name().unwrap().to_string_lossy());
    let domain = Domain::create(&root, &prefix, "consumer").unwrap();
    let topic = Topic::create(&domain, &contract()).unwrap();
    let subscriber = topic.subscriber(8).unwrap();
    let mut publisher = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "traps::dying_publisher"])
        .env(DYING, format!("{}|{prefix}", root.display()))
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    assert!(!publisher.wait().unwrap().success(), "it was killed");
    join(&root, &prefix, publisher.id());
    let received = std::iter::from_fn(|| subscriber.receive().unwrap()).count();
    drop((subscriber, topic, domain));
    sweep(&root, &prefix);
    received
}

#[test]
fn samples_of_a_killed_publisher_stay_when_somebody_joins() {
    let received = received_after(|root, prefix, _| {
        let other = Domain::join(root, prefix, "other").unwrap();
        let topic = Topic::open(&other, &contract()).unwrap();
        drop((topic, other));
    });
    assert_eq!(received, 5);
}

/// Why foreign participants must be given our settings: the test above can fail.
#[test]
fn samples_of_a_killed_publisher_vanish_when_somebody_joins_with_iceoryx2s_own_settings() {
    let received = received_after(|root, prefix, _| {
        let mut config = Config::default();
        config.global.prefix = FileName::new(prefix.as_bytes()).unwrap();
        config.global.set_root_path(&Path::new(root.display().to_string().as_bytes()).unwrap());
        let other = NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap();
        drop(other);
    });
    assert_eq!(received, 0);
}

#[test]
fn samples_of_a_killed_publisher_stay_when_all_dead_nodes_but_its_own_are_cleaned() {
    for (stays, samples) in [(true, 5), (false, 0)] {
        let received = received_after(|root, prefix, publisher| {
            let cleaner = Domain::join(root, prefix, "cleaner").unwrap();
            cleaner.clean_dead_nodes(&[if stays { publisher } else { 0 }]);
        });
        assert_eq!(received, samples);
    }
}

#[test]
fn an_operator_killed_at_any_moment_after_its_restart_leaves_no_orphans() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let mut last = 0;
    for round in 0..12u32 {
        last = run.kill("middle", last);
        let number = run.child("middle", last);
        // Some die while they make their ports, some at their first activations, some at work.
        let entries = round % 4;
        if entries > 0 {
            let life = round + 1;
            wait_for("its activations", || {
                let line = bench.wait_for_samples("middle.journal", 1);
                let entry: serde_json::Value = serde_json::from_str(line.lines().next()?).ok()?;
                let lives = entry["incarnation"].as_u64()? >= u64::from(life) || !crate::bench::lives(number);
                lives.then_some(())
            });
        }
    }
    run.child("middle", last);
    bench.wait_for_samples("sink.sum", 5);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    assert_eq!(report["unseen_entries"], 0);
    assert_eq!(line(&report, "sink.queue")["unexplained"], 0);
    let session = report["session"].as_str().unwrap();
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["complete"], true, "{}", info["gaps"]);
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}

#[test]
fn a_consumer_that_was_down_while_its_producer_restarted_too_balances() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 20);
    let mut before = [0, 0];
    for _ in 0..3 {
        before = [run.kill("sink", before[0]), run.kill("middle", before[1])];
    }
    run.child("sink", before[0]);
    run.child("middle", before[1]);
    bench.wait_for_samples("sink.sum", 20);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}
