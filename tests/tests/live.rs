//! Failures in a live run: each is contained, answered by policy, journalled, and seen downstream.

use serde_json::Value;

use crate::bench::{Bench, figures, line, pipeline, text, wait_for};

/// The entries of an operator's journal in a session.
pub fn journal(bench: &Bench, session: &str, operator: &str) -> Vec<Value> {
    let done = bench.call(&["echo", "--json", &format!("{operator}.journal"), "--session", session]);
    assert_eq!(done.code(), 0, "{}", done.err);
    done.out.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
}

/// Entries that mark the beginning of an incarnation.
fn beginnings(journal: &[Value]) -> Vec<&Value> {
    journal.iter().filter(|e| e["cause"] == 0).collect()
}

fn faults(report: &Value) -> Vec<String> {
    let all = report["faults"].as_array().unwrap();
    all.iter()
        .map(|f| format!("{}: {}", f["operator"].as_str().unwrap(), f["reason"].as_str().unwrap()))
        .collect()
}

#[test]
fn a_panic_is_contained_and_journalled_and_downstream_is_told() {
    let bench = Bench::new();
    let report =
        bench.call(&["run", text(&pipeline("crash.yaml")), "--for", "1 s", "--json", "--record", "s"]).good();
    let first = figures(&report, "first");
    assert!(first["panics"].as_u64().unwrap() > 0);
    // The last one may wait for its turn when the run ends.
    let waits = first["panics"].as_u64().unwrap() + 1 - first["incarnations"].as_u64().unwrap();
    assert!(waits <= 1, "{first}");
    assert!(faults(&report).iter().any(|f| f == "first: the mixer panics at activation 7"));
    let session = report["session"].as_str().unwrap();
    let begun = beginnings(&journal(&bench, session, "first")).len() as u64;
    assert_eq!(begun, first["incarnations"].as_u64().unwrap());
    let downstream = journal(&bench, session, "second");
    let lives: std::collections::BTreeSet<u64> = downstream
        .iter()
        .flat_map(|e| e["elements"].as_array().unwrap().clone())
        .filter(|r| r["port"] == 0 && r["kind"] == 0)
        .map(|r| r["incarnation"].as_u64().unwrap())
        .collect();
    assert!(lives.len() > 1, "downstream sees incarnations {lives:?}");
}

#[test]
fn an_error_is_journalled_and_told_and_the_operator_goes_on() {
    let bench = Bench::new();
    let report =
        bench.call(&["run", text(&pipeline("crash.yaml")), "--for", "1 s", "--json", "--record", "s"]).good();
    let failing = figures(&report, "failing");
    assert!(failing["errors"].as_u64().unwrap() > 0);
    assert_eq!(failing["incarnations"], 1);
    assert!(faults(&report).iter().any(|f| f == "failing: the kit fails at activation 5"));
    let activations = failing["activations"].as_u64().unwrap();
    assert_eq!(failing["sent"].as_u64().unwrap(), activations - failing["errors"].as_u64().unwrap());
}

#[test]
fn killed_processes_are_started_again_and_the_session_replays() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 20);
    let mut before = std::collections::BTreeMap::new();
    for name in ["middle", "source", "sink", "middle", "source", "middle", "sink"] {
        let number = run.kill(name, before.get(name).copied().unwrap_or(0));
        before.insert(name, number);
    }
    for name in ["source", "middle", "sink"] {
        run.child(name, before[name]);
    }
    bench.wait_for_samples("sink.sum", 20);

    let report = run.stop().good();

    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    assert_eq!(report["unseen_entries"], 0);
    let killed = faults(&report).iter().filter(|f| f.contains("signal: 9")).count();
    assert_eq!(killed, 7, "{:?}", faults(&report));
    let session = report["session"].as_str().unwrap();
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["complete"], true, "{}", info["gaps"]);
}

#[test]
fn a_killed_process_journals_its_new_incarnation_and_downstream_sees_the_gap() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let before = run.kill("middle", 0);
    run.child("middle", before);
    bench.wait_for_samples("middle.sum", 5);
    bench.wait_for_samples("sink.sum", 5);
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    assert_eq!(beginnings(&journal(&bench, session, "middle")).len(), 2);
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["unended"], serde_json::json!([["middle", 0]]));
    // What the source sent meanwhile is stated as lost while its consumer was down.
    assert!(line(&report, "middle.queue")["down"].as_u64().unwrap() > 0, "{}", report["ledger"]);
    let seen: Vec<u64> = journal(&bench, session, "sink")
        .iter()
        .flat_map(|e| e["elements"].as_array().unwrap().clone())
        .filter(|r| r["port"] == 0 && r["kind"] == 0)
        .map(|r| r["incarnation"].as_u64().unwrap())
        .collect();
    assert!(seen.contains(&0) && seen.contains(&1));
}

#[test]
fn timers_of_a_restarted_process_stay_on_their_grid() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("source.value", 5);
    let before = run.kill("source", 0);
    run.child("source", before);
    bench.wait_for_samples("source.value", 5);
    let report = run.stop().good();
    let entries = journal(&bench, report["session"].as_str().unwrap(), "source");
    let ticks: Vec<(u64, u64)> = entries
        .iter()
        .filter(|e| e["cause"] == 2)
        .map(|e| (e["nominal"].as_u64().unwrap(), e["tick"].as_u64().unwrap()))
        .collect();
    let epoch = ticks[0].0 - ticks[0].1 * 2_000_000;
    assert!(ticks.iter().all(|(nominal, tick)| *nominal == epoch + tick * 2_000_000));
    assert!(ticks.windows(2).all(|w| w[1].1 > w[0].1), "a tick comes once, over incarnations too");
}

#[test]
fn a_step_beyond_its_deadline_is_ended_restarted_later_each_time_and_given_up() {
    let bench = Bench::new();
    let done = bench.run(&pipeline("hang.yaml")).finish();
    assert_eq!(done.code(), 1, "{}", done.err);
    let report = done.json();
    let reason = report["ended_early"].as_str().unwrap();
    assert!(reason.contains("longer than its deadline"), "{reason}");
    assert!(reason.contains("it was restarted 2 times already"), "{reason}");
    assert_eq!(figures(&report, "hung")["incarnations"], 3);
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let journal = journal(&bench, session, "hung");
    let stamp = |e: &Value| e["stamp"].as_u64().unwrap();
    let pauses: Vec<u64> = beginnings(&journal)
        .iter()
        .skip(1)
        .map(|b| {
            let last =
                journal.iter().rfind(|e| e["incarnation"].as_u64() < b["incarnation"].as_u64()).unwrap();
            stamp(b) - stamp(last)
        })
        .collect();
    // The deadline, then the wait: 100 ms at first, twice that next.
    assert!(pauses[0] >= 400_000_000 && pauses[1] >= 500_000_000, "{pauses:?}");
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}

#[test]
fn panics_and_deaths_count_together_and_each_waits_twice_as_long() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("tired.yaml"));
    bench.wait_for_samples("tired.sum", 1);
    run.kill("tired", 0);
    let done = run.finish();
    assert_eq!(done.code(), 1, "{}", done.err);
    let report = done.json();
    let reason = report["ended_early"].as_str().unwrap();
    assert!(reason.ends_with("it was restarted 2 times already"), "{reason}");
    let tired = figures(&report, "tired");
    assert_eq!((&tired["panics"], &tired["incarnations"]), (&2.into(), &3.into()), "{:?}", faults(&report));
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    let journal = journal(&bench, session, "tired");
    let stamp = |e: &Value| e["stamp"].as_u64().unwrap();
    let waits: Vec<u64> = beginnings(&journal)
        .iter()
        .skip(1)
        .map(|b| {
            let before =
                journal.iter().rfind(|e| e["incarnation"].as_u64() < b["incarnation"].as_u64()).unwrap();
            stamp(b) - stamp(before)
        })
        .collect();
    assert!(waits[0] >= 100_000_000 && waits[1] >= 200_000_000, "{waits:?}");
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}

#[test]
fn a_process_that_is_never_restarted_ends_the_run_in_order() {
    let bench = Bench::new();
    let done = bench.run(&pipeline("never.yaml")).finish();
    assert_eq!(done.code(), 1, "{}", done.err);
    let report = done.json();
    let reason = report["ended_early"].as_str().unwrap();
    assert!(reason.contains("the mixer panics at activation 20"), "{reason}");
    assert!(reason.ends_with("its restart policy is never"), "{reason}");
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let info = bench.call(&["info", report["session"].as_str().unwrap(), "--json"]).good();
    assert_eq!(info["ended"], format!("early: {reason}"));
    let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}

#[test]
fn an_operator_that_cannot_be_made_says_why_and_leaves_nothing() {
    for (route, words) in
        [("error", "the kit's model has 3 layers"), ("panic", "the kit panics while it is made")]
    {
        let bench = Bench::new();
        let set = format!("fragile.interruption={route}");
        let run = bench.start(&["run", text(&pipeline("fragile.yaml")), "--set", &set, "--record", "s"]);
        let id = wait_for("the run's folder", || bench.run_ids().pop());
        let done = run.finish();
        assert_eq!(done.code(), 1);
        assert!(done.err.contains(words) && done.err.contains("fragile"), "{}", done.err);
        assert!(bench.run_ids().is_empty());
        assert!(!bench.path("s/fragile-0001").exists(), "a session of a run that did not begin");
        assert_eq!(crate::bench::shared_objects(&id), 0);
    }
}

#[test]
fn several_runs_at_once_do_not_see_each_other() {
    let bench = Bench::new();
    let file = pipeline("chain.yaml");
    let other = pipeline("sources.yaml");
    let runs = [bench.run(&file), bench.start(&["run", text(&other), "--json", "--record", "t"])];
    wait_for("both runs", || {
        let cards =
            bench.run_ids().iter().filter(|id| bench.runs().join(id).join("run.json").exists()).count();
        (cards == 2).then_some(())
    });
    let ambiguous = bench.call(&["echo", "source.value", "--count", "1"]);
    assert!(ambiguous.err.contains("several runs are going on"), "{}", ambiguous.err);
    let chosen = wait_for("the chosen run", || {
        let done = bench.call(&["echo", "--json", "middle.sum", "--count", "3", "--run", "chain"]);
        (done.code() == 0).then_some(done.out)
    });
    assert_eq!(chosen.lines().count(), 3);
    for run in runs {
        let report = run.stop().good();
        assert_eq!(report["balanced"], true);
        assert_eq!(report["swept"], serde_json::json!([]));
        bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
    }
}
