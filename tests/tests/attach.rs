//! People at a running pipeline: those who look in, and those who send.

use std::os::unix::process::CommandExt;

use serde_json::Value;

use crate::bench::{Bench, pipeline, text};

#[test]
fn a_command_arrives_is_recorded_and_replays() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("console.yaml"));
    bench.wait_for_samples("after.sum", 2);
    let sent = bench.call(&["send", "console.arm"]);
    assert_eq!(sent.code(), 0, "{}", sent.err);
    let target = bench.call(&["send", "console.target", "0.01", "-0.02", "0.5"]);
    assert_eq!(target.code(), 0, "{}", target.err);
    for (console, hint) in [
        ("nope.arm", "`nope` is not a console of this pipeline: write `console.arm`"),
        ("beat.arm", "`beat` is not a console of this pipeline: write `console.arm`"),
    ] {
        let none = bench.call(&["send", console]);
        assert!(none.code() == 2 && none.err.contains(hint), "{}", none.err);
    }
    let vent = bench.call(&["send", "console.vent"]);
    assert!(
        vent.code() == 0 && vent.out.contains("; no operator of this pipeline takes console.vent"),
        "{}",
        vent.out
    );
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();
    let echo = |topic: &str| -> Vec<Value> {
        let done = bench.call(&["echo", "--json", topic, "--session", session]);
        done.out.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
    };
    assert_eq!(echo("console.arm").len(), 1);
    let targets = echo("console.target");
    assert_eq!(targets.len(), 1);
    assert_eq!(targets[0]["elements"][0]["values"], serde_json::json!([0.01, -0.02, 0.5, 0.0, 0.0, 0.0]));
    assert_eq!(targets[0]["elements"][0]["given"], 3);
    bench.call(&["replay", session, "--json"]).good();
}

#[test]
fn a_target_is_said_to_be_taken_or_refused_by_each_who_takes_it() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("targets.yaml"));
    for topic in ["target.reference", "height.reference"] {
        crate::bench::wait_for("a start to count from", || {
            let sample: Value = serde_json::from_str(&bench.wait_for_samples(topic, 1)).unwrap();
            (sample["elements"][0]["status"] == 1).then_some(())
        });
    }
    for (values, code, output_text) in [
        (
            &["0.01", "0", "0"][..],
            1,
            ["target.reference: taken", "height.reference: refused, because it needs one"],
        ),
        (
            &["0.5"],
            1,
            ["target.reference: refused, because it needs one", "because it cannot be reached (z); the"],
        ),
        (&["0.01"], 1, ["target.reference: refused, because it needs one", "height.reference: taken"]),
    ] {
        let sent = bench.call(&[&["send", "console.target"], values].concat());
        assert_eq!(sent.code(), code, "{}{}", sent.out, sent.err);
        assert!(sent.out.starts_with("sent console.target"), "{}", sent.out);
        assert!(!sent.out.contains("nobody"), "{}", sent.out);
        assert!(output_text.iter().all(|line| sent.out.contains(line)), "{output_text:?}: {}", sent.out);
    }
    // Who is stopped says nothing.
    let stopped = rustix::process::Pid::from_raw(run.child("target", 0) as i32).unwrap();
    rustix::process::kill_process(stopped, rustix::process::Signal::STOP).unwrap();
    let sent = bench.call(&["send", "console.target", "0.02"]);
    rustix::process::kill_process(stopped, rustix::process::Signal::CONT).unwrap();
    assert_eq!(sent.code(), 0, "{}{}", sent.out, sent.err);
    let lines = ["target.reference: no answer within 1 s; `stillpoint echo", "height.reference: taken"];
    assert!(lines.iter().all(|line| sent.out.contains(line)), "{}", sent.out);
    run.stop().good();
}

#[test]
fn a_command_to_nobody_fails_with_words() {
    let bench = Bench::new();
    let nobody = bench.call(&["send", "console.arm"]);
    assert_eq!(nobody.code(), 1);
    assert!(nobody.err.contains("no pipeline is running"), "{}", nobody.err);
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 1);
    let none = bench.call(&["send", "console.arm"]);
    assert!(none.err.contains("has no console"), "{}", none.err);
    let verb = bench.call(&["send", "console.amr"]);
    assert!(verb.err.contains("did you mean arm?"), "{}", verb.err);
    run.stop().good();
}

#[test]
fn a_command_that_a_stopped_console_does_not_take_is_not_called_sent() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("console.yaml"));
    bench.wait_for_samples("after.sum", 2);
    let console = rustix::process::Pid::from_raw(run.child("console", 0) as i32).unwrap();
    rustix::process::kill_process(console, rustix::process::Signal::STOP).unwrap();
    let sent = bench.call(&["send", "console.arm"]);
    rustix::process::kill_process(console, rustix::process::Signal::CONT).unwrap();
    assert_eq!(sent.code(), 1, "{}", sent.out);
    assert!(sent.err.contains("console"), "{}", sent.err);
    run.stop().good();
}

#[test]
fn those_who_look_in_come_and_go_without_a_trace() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    for _ in 0..5 {
        bench.wait_for_samples("middle.sum", 3);
        // One that is killed while it looks.
        let looking = bench.start(&["echo", "sink.journal"]);
        bench.wait_for_samples("sink.sum", 1);
        looking.signal(rustix::process::Signal::KILL);
        looking.finish();
    }
    let report = run.stop().good();
    assert_eq!(report["balanced"], true);
    assert_eq!(report["faults"], serde_json::json!([]));
    bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
    let wrong = bench.call(&["echo", "middle.sun", "--session", text(&bench.path("s/chain-0001"))]);
    assert!(wrong.err.contains("did you mean middle.sum"), "{}", wrong.err);
}

#[test]
fn who_looks_in_sees_what_was_sent_until_the_end() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 1);
    let looking = bench.start(&["echo", "--json", "sink.sum"]);
    crate::bench::wait_for("a sample", || looking.output_text().lines().next().map(drop));
    // What is sent from here to the end waits for it.
    looking.signal(rustix::process::Signal::STOP);
    let report = run.stop().good();
    looking.signal(rustix::process::Signal::CONT);
    let done = looking.finish();
    assert_eq!(done.code(), 0, "{}", done.err);
    let last: Value = serde_json::from_str(done.out.lines().last().unwrap()).unwrap();
    let sent = crate::bench::figures(&report, "sink")["sent"].as_u64().unwrap();
    assert_eq!(last["sequence"].as_u64().unwrap(), sent - 1);
}

#[test]
fn an_output_beyond_the_sixty_fourth_wakes_its_consumer() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("wide.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    run.stop().good();
}

#[test]
fn a_tap_too_many_is_told_what_to_do() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 1);
    let taps: Vec<_> = (0..8).map(|_| bench.start(&["echo", "sink.sum"])).collect();
    let refused =
        crate::bench::wait_for("a refusal", || taps.iter().map(|t| t.errors()).find(|e| !e.is_empty()));
    assert!(refused.contains("end an `echo`"), "{refused}");
    run.stop().good();
    for tap in taps {
        tap.finish();
    }
}

#[test]
fn two_runs_that_start_together_do_not_both_take_the_last_room() {
    // Five samples of 600,000 points: 36 MB for each run, in 64 MB.
    const PIPELINE: &str = "stillpoint: 1\nname: bulk\noperators:\n  \
                            bulk: { use: kit.bulk, every: 100 s, params: { points: 600000 } }\n";
    // A mount namespace has a /dev/shm of its own. 77: there can be none here.
    const SCRIPT: &str = r#"
        mount -t tmpfs -o size=64m none /dev/shm || exit 77
        for n in 1 2; do "$KIT" run bulk.yaml --no-record --json --for '60 s' 2> "$n.err" > "$n.out" & done
        wait -n; first=$?
        kill -INT $(jobs -p) 2> /dev/null
        wait -n
        echo "$first $?"
    "#;
    let bench = Bench::new();
    std::fs::write(bench.path("bulk.yaml"), PIPELINE).unwrap();
    let mut command = std::process::Command::new("unshare");
    command.args(["-m", "bash", "-c", SCRIPT]).current_dir(bench.path(""));
    command.env("STILLPOINT_RUNS", bench.runs()).env("KIT", env!("CARGO_BIN_EXE_stillpoint-kit"));
    let done = bench.begin(command).finish();
    // Without the right to a namespace nothing is printed.
    if done.out.is_empty() {
        println!("skipped: a small /dev/shm cannot be mounted here: {}", done.err);
        return;
    }
    let output_text = ["1.err", "2.err"].map(|name| std::fs::read_to_string(bench.path(name)).unwrap());
    assert!(done.out.starts_with("1 "), "one of the two is refused: {} {output_text:?}", done.out);
    let refused: Vec<_> = output_text.iter().filter(|s| s.contains("may still take")).collect();
    assert_eq!(refused.len(), 1, "{output_text:?}");
    assert!(refused[0].contains("end another run, make /dev/shm larger"), "{output_text:?}");
}

#[test]
fn another_user_can_neither_cut_what_a_run_shares_nor_stop_it_or_those_that_send_to_it() {
    if !rustix::process::getuid().is_root() {
        eprintln!("skipped: only root can act as another user");
        return;
    }
    let bench = Bench::new();
    let run = bench.run(&pipeline("console.yaml"));
    bench.wait_for_samples("after.sum", 2);
    let [id] = &bench.run_ids()[..] else { panic!("one run") };
    let all = std::fs::read_dir("/dev/shm").unwrap().flatten();
    let objects = all.filter(|o| o.file_name().to_string_lossy().starts_with(&format!("sp_{id}_")));
    let objects: Vec<_> = objects.map(|o| o.path()).collect();
    assert!(objects.iter().any(|o| text(o).ends_with(".global_mgmt")), "{objects:?}");
    let other = 65_534;
    for object in &objects {
        // A connection of those that looked in may go at any moment: `-c` makes no file in its place,
        // and only one that is still there afterwards was cut.
        let mut cut = std::process::Command::new("sh");
        let cut = cut.args(["-c", "truncate -c -s 0 \"$0\" && test -e \"$0\""]).arg(object);
        let cut = cut.uid(other).gid(other).output().unwrap();
        assert!(!cut.status.success(), "{} was cut by another user", object.display());
    }
    // The vent and a restarted process join the run anew.
    let sent = bench.call(&["send", "console.vent"]);
    assert_eq!(sent.code(), 0, "{}", sent.err);
    let before = run.kill("after", 0);
    run.child("after", before);
    bench.wait_for_samples("after.sum", 2);
    run.stop().good();
    assert_eq!(crate::bench::shared_objects(id), 0);
}

#[test]
fn programs_that_were_killed_while_they_read_do_not_keep_others_from_reading() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 2);
    // More than a topic has room for.
    for _ in 0..7 {
        let reader = bench.start(&["echo", "sink.sum"]);
        crate::bench::wait_for("a sample, or a refusal", || {
            (!reader.output_text().is_empty() || !reader.errors().is_empty()).then_some(())
        });
        reader.signal(rustix::process::Signal::KILL);
        reader.finish();
    }
    let echo = || bench.call(&["echo", "sink.sum", "--count", "1"]);
    crate::bench::wait_for("a place to read", || (echo().code() == 0).then_some(()));
    run.stop().good();
}
