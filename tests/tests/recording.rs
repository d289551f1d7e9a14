//! The recording: what survives its recorder, and what is said where it cannot be made.

use rustix::process::Signal;
use serde_json::{Value, json};
use stillpoint_recorder::Session;

use crate::bench::{Bench, lives, pipeline, text, wait_for};

#[test]
fn a_killed_recorder_leaves_all_but_the_last_second_in_its_part_and_all_in_the_session() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let part = bench.path("s/chain-0001/part-000.mcap");
    wait_for("a flush", || (part.metadata().ok()?.len() > 100_000).then_some(()));

    let entry = bench.wait_for_samples("source.journal", 1);
    let number = run.kill("recorder", 0);
    wait_for("its end", || (!lives(number)).then_some(()));
    // Nothing is mended yet: this is what the kill left.
    let cut = Session::open(&part).unwrap();
    run.child("recorder", number);
    let second = bench.path("s/chain-0001/part-001.mcap");
    wait_for("the next part", || (second.metadata().ok()?.len() > 50_000).then_some(()));
    let report = run.stop().good();

    let before: serde_json::Value = serde_json::from_str(entry.lines().next().unwrap()).unwrap();
    let last = cut.journals()["source"].last().unwrap().header.stamp;
    assert!(last + 1_000_000_000 >= before["stamp"].as_u64().unwrap(), "the last second at most");
    assert_eq!(report["balanced"], true, "the ledger does not need the recorder");
    assert_eq!(report["recorded"].as_array().unwrap().len(), 1);
    let retained = report["recorded"][0]["samples"].as_u64().unwrap();
    assert!(report["samples"].as_u64().unwrap() >= retained + cut.journals()["source"].len() as u64);
    // Every part ends as readers expect it.
    for part in [&part, &second] {
        let bytes = std::fs::read(part).unwrap();
        assert!(bytes.ends_with(b"\x89MCAP0\r\n"), "{}", part.display());
    }
    assert_whole(&bench, report["session"].as_str().unwrap());
}

/// The session holds each journal entry and each sample of a source once, and replays.
fn assert_whole(bench: &Bench, session: &str) {
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!((&info["complete"], &info["lost"]), (&json!(true), &json!([])), "{info}");
    let whole = Session::open(&bench.path(session)).unwrap();
    for topic in ["source.journal", "source.value", "middle.journal", "sink.journal"] {
        let number = whole.topic_number(topic).unwrap();
        let retained: Vec<u64> = whole.numbers(number).map(|(_, sequence)| sequence).collect();
        assert_eq!(retained, (0..retained.len() as u64).collect::<Vec<_>>(), "{topic}");
    }
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!((&replay["differences"], &replay["open"]), (&json!(0), &json!([])), "{replay}");
}

#[test]
fn a_session_whose_recorder_was_killed_again_and_again_and_at_the_end_is_whole() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let mut last = 0;
    for part in 1..5 {
        last = run.kill("recorder", last);
        let next = bench.path(&format!("s/chain-0001/part-{part:03}.mcap"));
        // Some die before their first flush, some behind it.
        let bytes = [1, 30_000][part % 2];
        wait_for("the next part", || (next.metadata().ok()?.len() >= bytes).then_some(()));
    }
    run.kill("recorder", last);
    let report = run.stop().good();
    assert_whole(&bench, report["session"].as_str().unwrap());
}

#[test]
fn after_a_recorder_was_killed_new_incarnations_are_exact() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let number = run.kill("recorder", 0);
    run.child("recorder", number);
    let second = bench.path("s/chain-0001/part-001.mcap");
    wait_for("the next part", || (second.metadata().ok()?.len() > 20_000).then_some(()));
    for name in ["sink", "middle", "source"] {
        let before = run.kill(name, 0);
        run.child(name, before);
    }
    bench.wait_for_samples("sink.sum", 50);
    let report = run.stop().good();
    let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]);
    assert_eq!(replay.json()["differences"], 0, "{}", replay.out);
    assert!(replay.json()["exact_incarnations"].as_u64().unwrap() >= 2, "{}", replay.out);
    let open = replay.json()["open"].clone();
    assert!(open.as_array().unwrap().iter().all(|o| o["incarnation"] == 0), "{open}");
}

#[test]
fn a_folder_that_cannot_be_written_is_named_and_nothing_is_left() {
    let bench = Bench::new();
    std::fs::write(bench.path("file"), "no folder").unwrap();
    let done = bench.call(&["run", text(&pipeline("chain.yaml")), "--for", "1 s", "--record", "file/s"]);
    assert_eq!(done.code(), 1);
    assert!(done.err.contains("file/s"), "{}", done.err);
    assert!(bench.run_ids().is_empty());
}

#[test]
fn a_full_disk_is_named_and_the_run_goes_on_to_its_end() {
    let bench = Bench::new();
    let Some(disk) = crate::bench::small_disk(&bench, "256k") else { return };
    let file = pipeline("flood.yaml");
    let done = bench.start(&["run", text(&file), "--for", "3 s", "--json", "--record", "disk"]).finish();
    let info = bench.call(&["info", "disk/flood-0001", "--json"]);
    let files = std::fs::read_dir(bench.path("disk/flood-0001")).unwrap().flatten();
    let left: Vec<String> = files.map(|f| f.file_name().to_string_lossy().into_owned()).collect();
    // It may have no room left.
    let neighbour = ["metadata.yaml", "log.jsonl"];
    let left: Vec<String> = left.into_iter().filter(|name| !neighbour.contains(&name.as_str())).collect();
    std::fs::remove_dir_all(bench.path("disk/flood-0001")).unwrap();
    let clock = ["--clock", "simulated", "--for", "3 s", "--record", "disk"];
    let simulated = bench.call(&[&["run", text(&file)], &clock[..]].concat());
    drop(disk);
    // A patient is not let go because of a disk: the run goes on, the fault is told, and the session says what it lacks.
    assert!(done.json()["seconds"].as_f64().unwrap() >= 3.0);
    assert_eq!(done.json()["balanced"], true);
    assert_eq!(done.code(), 1, "a recording was asked for, and there is none");
    assert!(done.err.contains("No space left on device"), "{}", done.err);
    assert!(info.err.is_empty() && info.json()["complete"] == json!(false), "{}", info.out);
    assert!(left.iter().all(|name| name.ends_with(".mcap")), "{left:?}");
    assert_eq!(done.json()["parts"], left.len());
    assert_eq!(done.json()["complete"], false);
    let failed = done.json()["recording_failed"].to_string();
    assert!(failed.contains("No space left on device"), "{failed}");
    assert!(bench.run_ids().is_empty());
    // In one process the first answer of the disk is the one that is told.
    let error = simulated.err.trim();
    assert_eq!(simulated.code(), 1, "{error}");
    assert!(error.contains("disk/flood-0001/part-000.mcap: ") && error.contains("No space left"), "{error}");
}

#[test]
fn a_session_that_is_being_recorded_says_so_and_is_not_mended() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let part = bench.path("s/chain-0001/part-000.mcap");
    wait_for("a flush", || (part.metadata().ok()?.len() > 100_000).then_some(()));
    for session in ["s/chain-0001", "s/chain-0001/part-000.mcap"] {
        let refused = bench.call(&["recover", session]);
        assert_eq!(refused.code(), 1, "{}", refused.out);
        assert!(refused.err.contains("part-000.mcap: it is still being recorded"), "{}", refused.err);
        let info = bench.call(&["info", session, "--json"]).good();
        assert_eq!(info["ended"], json!(format!("not yet: {} is being recorded", name_of(session))));
        assert!(info["gaps"][0].as_str().unwrap().contains("it is being recorded"), "{}", info["gaps"]);
        assert!(!info.to_string().contains("died") && !info.to_string().contains("stillpoint recover"));
    }
    let replay = bench.call(&["replay", "s/chain-0001"]);
    assert_eq!(replay.code(), 4, "{}", replay.err);
    assert!(replay.out.contains("part-000.mcap: it is being recorded"), "{}", replay.out);

    let report = run.stop().good();
    assert_eq!((&report["complete"], &report["parts"]), (&json!(true), &json!(1)), "{}", report["gaps"]);
    assert_eq!(report["samples"], report["recorded"][0]["samples"]);
    assert_eq!(bench.call(&["recover", "s/chain-0001", "--json"]).good(), json!([]));
    let replay = bench.call(&["replay", "s/chain-0001", "--json"]).good();
    assert_eq!(replay["identical_all"], true);
}

/// The part of a session that is named by its folder or by the part.
fn name_of(session: &str) -> String {
    if session.ends_with(".mcap") { session.to_owned() } else { format!("{session}/part-000.mcap") }
}

#[test]
fn a_recorder_that_is_stopped_for_a_while_states_what_it_lost() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let recorder = rustix::process::Pid::from_raw(run.child("recorder", 0) as i32).unwrap();
    rustix::process::kill_process(recorder, Signal::STOP).unwrap();
    let tick = || {
        let line = bench.wait_for_samples("source.journal", 1);
        let entry: serde_json::Value = serde_json::from_str(line.lines().next().unwrap()).unwrap();
        entry["sequence"].as_u64().unwrap()
    };
    // More than its buffers hold, and long before it is given up.
    let stopped = tick();
    wait_for("1100 ticks", || (tick() > stopped + 1100).then_some(()));
    rustix::process::kill_process(recorder, Signal::CONT).unwrap();
    bench.wait_for_samples("sink.sum", 5);
    let report = run.stop().incomplete();
    let lost = &report["recorded"][0]["lost"];
    assert!(lost["source.value"].as_u64().unwrap() > 0, "{lost}");
    assert_eq!(report["balanced"], true);
    let session = report["session"].as_str().unwrap();
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["complete"], json!(false));
    let replay = bench.call(&["replay", session, "--json"]);
    assert_eq!((replay.code(), replay.json()["differences"].as_u64()), (4, Some(0)), "{}", replay.out);
    let missing: u64 = replay.json()["missing"].as_object().unwrap().values().flat_map(Value::as_u64).sum();
    let listed: u64 = lost.as_object().unwrap().values().flat_map(Value::as_u64).sum();
    assert!(missing >= listed, "{missing} {listed}");
    let output_text = bench.call(&["replay", session]);
    let words = format!("; {missing} samples of recorded topics are not in the recording: ");
    assert!(output_text.out.contains(&words), "{}", output_text.out);
}
