//! A head followed live against a reference that a person captures, recorded and replayed; and by two cameras, on any number
//! of threads.

use std::os::unix::fs::PermissionsExt;

use serde_json::Value;

use crate::bench::{Bench, Done, pipeline, text};
use crate::conformance::placements_agree;

fn samples(bench: &Bench, topic: &str, session: &str) -> Vec<Value> {
    let done = bench.call(&["echo", "--json", topic, "--session", session]);
    assert_eq!(done.code(), 0, "{}", done.err);
    done.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The status of each report: 0 no reference, 1 captured, 2 tracked.
fn statuses(reports: &[Value]) -> Vec<u64> {
    reports.iter().map(|r| r["elements"][0]["status"].as_u64().unwrap()).collect()
}

#[test]
fn a_live_capture_makes_the_reference_and_the_session_replays_bit_for_bit() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("seeing.yaml"));
    // A capture takes a face that was seen in four frames.
    bench.wait_for_samples("head.report", 4);
    assert_eq!(bench.call(&["send", "console.capture"]).code(), 0);
    bench.wait_for_samples("filter.state", 5);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();

    let reports = samples(&bench, "head.report", session);
    let statuses = statuses(&reports);
    let captured = statuses.iter().position(|s| *s == 1).expect("a face became the reference");
    assert!(captured >= 4 && statuses[..captured].iter().all(|s| *s == 0), "{statuses:?}");
    assert!(statuses[captured + 1..].iter().all(|s| *s == 2), "{statuses:?}");
    assert_eq!(samples(&bench, "head.reference", session).len(), 1);
    assert_eq!(samples(&bench, "head.pose", session).len(), statuses.len() - captured);

    let accuracy = &report["accuracy"];
    assert!(accuracy["worst_mm"].as_f64().unwrap() < 1.0, "{accuracy}");
    assert!(accuracy["turns"]["worst_deg"].as_f64().unwrap() < 1.0, "{accuracy}");

    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    for topic in ["head.pose", "head.report", "head.reference", "filter.state"] {
        assert!(replay["identical"].get(topic).is_some(), "{topic}: {replay}");
    }
}

#[test]
fn a_capture_is_proposed_with_its_numbers_and_its_picture_and_a_person_confirms_it() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("seeing.yaml"));
    bench.wait_for_samples("head.report", 4);
    let early = bench.call(&["send", "console.confirm"]);
    assert!(early.code() == 1 && early.out.contains("no reference to confirm: capture one"), "{}", early.out);
    let proposed = bench.call(&["send", "console.capture"]);
    assert_eq!(proposed.code(), 0, "{}{}", proposed.out, proposed.err);
    let output_text = [
        "head.report: proposed as reference 1: a face of ",
        " points, ",
        "confidence ",
        "(size 1.00",
        "picture: ",
    ];
    assert!(output_text.iter().all(|words| proposed.out.contains(words)), "{}", proposed.out);
    let confirmed = bench.call(&["send", "console.confirm"]);
    assert!(
        confirmed.code() == 0 && confirmed.out.contains("head.report: reference 1 is confirmed"),
        "{}",
        confirmed.out
    );
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let picture = std::fs::read(bench.path(&format!("{session}.head-reference-1.png"))).unwrap();
    assert!(picture.starts_with(b"\x89PNG"));
    let mode = std::fs::metadata(bench.path(&format!("{session}.head-reference-1.png")))
        .unwrap()
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o600, "it shows a patient");
    let path = proposed.out.split("picture: ").nth(1).unwrap().trim();
    assert_eq!(std::fs::read(path).unwrap(), picture, "the path that was printed");
    assert_eq!(bench.call(&["report", session]).code(), 0);
    let page = std::fs::read_to_string(bench.path(&format!("{session}.html"))).unwrap();
    assert!(page.contains("captured as reference 1: is it the head"), "the page shows the proposal");
}

#[test]
fn a_capture_without_a_face_says_why_and_fails() {
    let bench = Bench::new();
    let file = pipeline("seeing.yaml");
    let run = bench.start(&["run", text(&file), "--set", "face.head_radius=300 mm", "--json"]);
    bench.wait_for_samples("head.report", 2);
    let none = bench.call(&["send", "console.capture"]);
    assert_eq!(none.code(), 1, "{}{}", none.out, none.err);
    assert!(none.out.contains("nothing was captured: no face was found in enough frames: "), "{}", none.out);
    run.stop().good();
}

/// Runs a command where libraries may take so many threads.
fn on_threads(bench: &Bench, threads: &str, arguments: &[&str]) -> Done {
    let mut command = bench.command(arguments);
    for variable in ["RAYON_NUM_THREADS", "OMP_NUM_THREADS", "KIT_THREADS"] {
        command.env(variable, threads);
    }
    bench.begin(command).finish()
}

/// One thread for all operators, one for each, a process for each group of them.
#[test]
fn two_cameras_one_track_is_the_same_on_every_placement() {
    placements_agree("eyes.yaml");
}

#[test]
fn two_cameras_one_track_replays_bit_for_bit_with_other_threads() {
    let bench = Bench::new();
    let file = pipeline("eyes.yaml");
    let run = |clock: &[&str], threads: &str| {
        let arguments = [&["run", text(&file), "--for", "2 s", "--json", "--record", "s"], clock].concat();
        on_threads(&bench, threads, &arguments).good()["session"].as_str().unwrap().to_owned()
    };
    let bytes = |session: &str| std::fs::read(bench.path(session).join("part-000.mcap")).unwrap();
    let simulated = ["1", "5"].map(|threads| run(&["--clock", "simulated"], threads));
    assert!(bytes(&simulated[0]) == bytes(&simulated[1]), "other threads make another session");
    // All of the chain took part, or this shows nothing.
    let both = |health: &Value| (0..2).all(|side| health["elements"][side]["reason"] == "used");
    let used = samples(&bench, "fused.health", &simulated[0]).iter().filter(|h| both(h)).count();
    assert!(used > 50, "{used}");
    for session in [&simulated[0], &run(&[], "3")] {
        for threads in ["1", "7"] {
            let replay = on_threads(&bench, threads, &["replay", session, "--json"]).good();
            assert_eq!(replay["identical_all"], true, "{threads} threads: {replay}");
            for topic in ["fast_face.face", "slow_head.pose", "fast_filter.state", "fused.state"] {
                assert!(replay["identical"][topic].as_u64().unwrap() > 3, "{topic}: {replay}");
            }
        }
    }
}
