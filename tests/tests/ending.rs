//! How runs end: by signals, in order; and what is left when the supervisor itself is killed.

use rustix::process::Signal;
use serde_json::json;

use crate::bench::{Bench, Running, figures, line, lives, pipeline, shared_objects, signal, text, wait_for};

/// Signals to the whole group end a run in order.
fn ends_in_order(signal: impl Fn(&Running)) {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 10);
    let id = bench.run_ids().pop().unwrap();
    let children = run.children();
    assert_eq!(children.len(), 4, "{children:?}");

    signal(&run);
    let report = run.finish().good();

    assert_eq!(report["ended_early"], "stopped");
    assert_eq!(report["balanced"], true);
    // Queues drained: what was sent was taken.
    for consumer in ["middle.queue", "sink.queue"] {
        assert_eq!(line(&report, consumer)["left"], 0, "{}", report["ledger"]);
    }
    assert_eq!(report["faults"], json!([]));
    assert!(children.iter().all(|(_, number)| !lives(*number)));
    assert!(bench.run_ids().is_empty());
    assert_eq!(shared_objects(&id), 0);
    let session = report["session"].as_str().unwrap();
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!((&info["ended"], &info["complete"]), (&json!("in order"), &json!(true)));
    assert_eq!(info["ledger"], report["ledger"], "the recorded ledger is the printed one");
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!((&replay["identical_all"], &replay["differences"]), (&json!(true), &json!(0)));
}

/// Samples that were sent on both outputs of `finishing.yaml` that have an end, and the last run's length, s.
fn finishes(bench: &Bench, file: &str, how: &[&str]) -> (u64, u64, f64) {
    let done = bench.call(&[&["run", file, "--json", "--record", "s"], how].concat());
    let report = done.good();
    assert_eq!(
        (&report["ended_early"], &report["balanced"]),
        (&json!(null), &json!(true)),
        "{}",
        report["ledger"]
    );
    // To have no more to send is no fault.
    assert_eq!(report["faults"], json!([]));
    let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
    assert_eq!((&replay["identical_all"], &replay["differences"]), (&json!(true), &json!(0)));
    let info = bench.call(&["info", report["session"].as_str().unwrap(), "--json"]).good();
    assert_eq!((&info["ended"], &info["complete"]), (&json!("in order"), &json!(true)), "{}", info["gaps"]);
    let sent = |operator: &str| figures(&report, operator)["sent"].as_u64().unwrap();
    (sent("source"), sent("later"), report["seconds"].as_f64().unwrap())
}

#[test]
fn a_run_ends_by_itself_when_all_that_feeds_it_has_finished() {
    let bench = Bench::new();
    let file = pipeline("finishing.yaml");
    // The last is the tick of `later` at 500 ms.
    for placement in [&["--clock", "simulated"][..], &["--lock-step=threads"], &["--lock-step=processes"]] {
        let (source, later, seconds) =
            finishes(&bench, text(&file), &[placement, &["--for", "1 h"]].concat());
        assert_eq!((source, later), (60, 50));
        assert!((seconds - 0.5).abs() < 1e-6, "{seconds}");
    }
    // However busy the machine is, nobody finishes before it has sent all that it has.
    let (source, later, _) = finishes(&bench, text(&file), &[]);
    assert_eq!((source, later), (60, 50));
}

#[test]
fn a_run_goes_on_as_long_as_one_source_has_more() {
    let bench = Bench::new();
    let yaml = std::fs::read_to_string(pipeline("finishing.yaml")).unwrap();
    let camera = "operators:\n  camera: { use: kit.outside, every: 50 ms }\n";
    std::fs::write(bench.path("camera.yaml"), yaml.replace("operators:\n", camera)).unwrap();
    let (source, later, seconds) = finishes(&bench, "camera.yaml", &["--clock", "simulated", "--for", "2 s"]);
    assert_eq!((source, later, seconds), (60, 50, 2.0));
}

#[test]
fn an_operator_that_has_finished_begins_anew_in_a_new_incarnation() {
    const PIPELINE: &str = "stillpoint: 1\nname: again\noperators:\n  \
        camera: { use: kit.outside, every: 50 ms }\n  \
        later: { use: kit.counter, every: 10 ms, params: { habit: finish, at: 50 } }\n  \
        once: { use: kit.outside, every: 10 ms, params: { habit: finish, at: 1 } }\n  \
        late: { use: kit.mixer, inputs: { queue: { from: once.value, delay: 600 ms } }, latency: 30 ms, deadline: 20 ms }\n\
        processes: { pair: { operators: [later, late], restart: { limit: 2, backoff: 100 ms } } }\n";
    let bench = Bench::new();
    std::fs::write(bench.path("again.yaml"), PIPELINE).unwrap();
    let run = ["run", "again.yaml", "--clock", "simulated", "--for", "2 s", "--json", "--no-record"];
    let report = bench.call(&run).good();
    // Its process dies after it has finished.
    let later = figures(&report, "later");
    assert_eq!(
        (&later["incarnations"], &later["sent"], &later["activations"]),
        (&json!(2), &json!(100), &json!(102))
    );
}

#[test]
fn ctrl_c_ends_a_run_in_order() {
    ends_in_order(|run| run.signal_group(Signal::INT));
}

#[test]
fn sigterm_ends_a_run_in_order() {
    ends_in_order(|run| run.signal_group(Signal::TERM));
}

#[test]
fn a_hang_up_ends_a_run_in_order() {
    ends_in_order(|run| run.signal_group(Signal::HUP));
}

#[test]
fn hang_ups_that_come_at_once_end_a_run_in_order() {
    ends_in_order(Running::hang_up_repeatedly);
}

/// Each may come while a process asks whether there is an order: it must not wait for one then.
#[test]
fn signals_that_are_taken_and_have_no_effect_keep_no_process_from_its_work() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 1);

    for (_, number) in run.children() {
        (0..200_000).for_each(|_| signal(number, Signal::INT));
    }
    bench.wait_for_samples("sink.sum", 20);
    let report = run.stop().good();

    assert_eq!(report["ended_early"], "stopped", "nobody was killed for not answering");
    assert_eq!(report["faults"], json!([]));
}

#[test]
fn ctrl_c_during_start_up_leaves_nothing() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    wait_for("a child", || (!run.children().is_empty()).then_some(()));
    let id = bench.run_ids().pop().unwrap();

    run.signal_group(Signal::INT);
    let done = run.finish();

    // Where start-up was nearly over the run ends like any other.
    if done.code() == 0 {
        assert_eq!(
            (&done.json()["ended_early"], &done.json()["balanced"]),
            (&json!("stopped"), &json!(true))
        );
    } else {
        assert!(done.err.contains("stopped while it was starting"), "{}", done.err);
    }
    assert!(bench.run_ids().is_empty());
    assert_eq!(shared_objects(&id), 0);
}

#[test]
fn ctrl_c_ends_a_start_up_that_hangs() {
    let bench = Bench::new();
    let run = bench.start(&["run", text(&pipeline("fragile.yaml")), "--set", "fragile.interruption=hang"]);
    let id = wait_for("the run's folder", || bench.run_ids().pop());
    let child = run.child("fragile", 0);

    run.signal_group(Signal::INT);
    let done = run.finish();

    assert_eq!(done.code(), 1);
    assert!(done.err.contains("stopped while it was starting"), "{}", done.err);
    assert!(!lives(child));
    assert!(!bench.path("sessions/fragile-0001").exists(), "nothing was recorded");
    assert!(bench.run_ids().is_empty());
    assert_eq!(shared_objects(&id), 0);
}

#[test]
fn ctrl_c_ends_a_run_whose_step_never_comes_back() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("stuck.yaml"));
    bench.wait_for_samples("beat.value", 50);
    let done = run.stop();
    assert_eq!(done.code(), 1, "{}", done.err);
    let report = done.json();
    assert_eq!(report["ended_early"], "stuck did not stop on request, and was killed");
    assert_eq!(report["balanced"], true);
    bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
}

#[test]
fn who_hastens_the_end_of_a_worker_that_hangs_leaves_the_recorder_its_time() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("stuck.yaml"));
    bench.wait_for_samples("beat.value", 50);
    let stuck = run.child("stuck", 0);
    wait_for("its end", || {
        run.signal_group(Signal::INT);
        (!lives(stuck)).then_some(())
    });
    let report = run.finish().json();
    assert_eq!(report["ended_early"], "stuck did not stop on request, and was killed");
    assert_eq!((&report["recording_failed"], &report["balanced"]), (&json!(null), &json!(true)));
    let session = report["session"].as_str().unwrap();
    let info = bench.call(&["info", session, "--json"]).good();
    assert_eq!(info["ended"], "early: stuck did not stop on request, and was killed");
    bench.call(&["replay", session, "--json"]).good();
}

/// Kills the supervisor of a run, and waits until its children have ended by themselves.
fn bereave(run: Running) {
    let children = run.children();
    assert!(children.len() > 1);
    run.signal(Signal::KILL);
    run.finish();
    wait_for("the children's ends", || children.iter().all(|(_, n)| !lives(*n)).then_some(()));
}

#[test]
fn children_end_when_the_supervisor_is_killed_and_the_next_run_sweeps() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 20);
    let id = bench.run_ids().pop().unwrap();
    bereave(run);
    assert!(shared_objects(&id) > 0, "a killed supervisor cannot clean up");

    let next =
        bench.call(&["run", text(&pipeline("sources.yaml")), "--for", "300 ms", "--json", "--no-record"]);

    assert_eq!(next.good()["swept"], json!([id]));
    assert_eq!(shared_objects(&id), 0);
    assert!(bench.run_ids().is_empty());
    // What was recorded is whole, and says why it is not complete.
    let session = bench.path("s/chain-0001");
    let info = bench.call(&["info", text(&session), "--json"]).good();
    assert!(info["gaps"].as_array().unwrap().contains(&json!("the supervisor died")), "{}", info["gaps"]);
    assert_eq!(info["ended"], "early: the supervisor died");
    let replay = bench.call(&["replay", text(&session), "--json"]);
    assert_eq!(replay.json()["differences"], 0);
    assert!(replay.json()["identical"]["sink.sum"].as_u64().unwrap() >= 20);
}

#[test]
fn a_dead_run_is_swept_when_its_last_process_has_ended() {
    let bench = Bench::new();
    let yaml = std::fs::read_to_string(pipeline("chain.yaml")).unwrap();
    let lasting = yaml.replace("operators: [sink],", "operators: [sink], outlives: 10 s,");
    std::fs::write(bench.path("chain.yaml"), lasting).unwrap();
    let run = bench.run(&bench.path("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let (id, children) = (bench.run_ids().pop().unwrap(), run.children());
    run.signal(Signal::KILL);
    run.finish();
    // The recorder waits for the sink.
    let (stay, go): (Vec<_>, Vec<_>) =
        children.into_iter().partition(|(name, _)| ["sink", "recorder"].contains(&name.as_str()));
    // Not before: who is stopped when its supervisor dies is hung up and continued by the system.
    stay.iter().for_each(|(_, number)| signal(*number, Signal::STOP));
    wait_for("the others' ends", || go.iter().all(|(_, n)| !lives(*n)).then_some(()));
    let file = pipeline("sources.yaml");
    let next = ["run", text(&file), "--for", "100 ms", "--json", "--no-record"];

    assert_eq!(bench.call(&next).good()["swept"], json!([]));
    // What stands between two processes goes with the first of them; all of it goes with a sweep.
    assert!(shared_objects(&id) > 0 && bench.run_ids() == [id.clone()]);

    stay.iter().for_each(|(_, number)| signal(*number, Signal::KILL));
    wait_for("their ends", || stay.iter().all(|(_, n)| !lives(*n)).then_some(()));
    assert_eq!(bench.call(&next).good()["swept"], json!([id]));
    assert_eq!(shared_objects(&id), 0);
}

#[test]
fn a_child_whose_step_never_comes_back_ends_with_its_supervisor() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("stuck.yaml"));
    bench.wait_for_samples("beat.value", 50);
    bereave(run);
}

#[test]
fn a_sweep_leaves_runs_that_go_on_alone() {
    let bench = Bench::new();
    let run = bench.run(&pipeline("chain.yaml"));
    bench.wait_for_samples("sink.sum", 5);
    let other =
        bench.call(&["run", text(&pipeline("sources.yaml")), "--for", "200 ms", "--json", "--no-record"]);
    assert_eq!(other.good()["swept"], json!([]));
    bench.wait_for_samples("sink.sum", 5);
    run.stop().good();
}

#[test]
fn what_an_operator_prints_harms_neither_the_run_nor_its_report() {
    let bench = Bench::new();
    let file = pipeline("printing.yaml");
    for placement in [&[][..], &["--clock", "simulated"], &["--lock-step=processes"]] {
        let arguments =
            [&["run", text(&file), "--for", "500 ms", "--json", "--record", "s"], placement].concat();
        let done = bench.call(&arguments);
        assert!(done.err.contains("here I am: made") && done.err.contains("here I am: 20"), "{}", done.err);
        let report = done.good();
        assert_eq!(report["faults"], serde_json::json!([]));
        assert!(figures(&report, "sink")["activations"].as_u64().unwrap() > 20);
        let replay = bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]);
        assert!(replay.err.contains("here I am: 20"));
        assert_eq!(replay.good()["identical_all"], true);
    }
}

#[test]
fn a_simulated_run_reports_what_failed_and_says_so_where_it_ended_by_it() {
    let bench = Bench::new();
    let crash = pipeline("crash.yaml");
    let simulated = ["--clock", "simulated", "--for", "500 ms"];
    let report = bench.call(&[&["run", text(&crash), "--json"], &simulated[..]].concat()).good();
    let faults = report["faults"].as_array().unwrap();
    let panics = faults.iter().filter(|f| f["operator"] == "first").count() as u64;
    assert_eq!(panics, figures(&report, "first")["panics"].as_u64().unwrap());
    assert!(faults.iter().any(|f| f["reason"] == "the kit fails at activation 5"));
    let output_text = bench.call(&[&["run", text(&crash)], &simulated[..]].concat());
    assert!(
        output_text.out.contains("failed: first: the mixer panics at activation 7"),
        "{}",
        output_text.out
    );

    let done = bench.call(&[&["run", text(&pipeline("never.yaml")), "--json"], &simulated[..]].concat());
    assert_eq!(done.code(), 1);
    let seconds = done.json()["seconds"].as_f64().unwrap();
    assert!(seconds > 0.0 && seconds < 0.5, "it ended before its time: {seconds}");
    let session = done.json()["session"].as_str().unwrap().to_owned();
    let info = bench.call(&["info", &session, "--json"]).good();
    let end = &info["metadata"]["stillpoint.end"];
    assert_eq!(end["fact.in_order"], "false");
    assert!(info["ended"].as_str().unwrap().starts_with("early: "), "{}", info["ended"]);
    assert!(end["fact.ended_early"].as_str().unwrap().contains("the mixer panics at activation 20"), "{end}");
}

#[test]
fn a_folder_of_runs_that_others_could_use_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::new();
    let open = bench.runs();
    std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o770)).unwrap();
    let file = pipeline("chain.yaml");
    for arguments in [&["run", text(&file), "--for", "1 s"][..], &["echo", "sink.sum"]] {
        let done = bench.call(arguments);
        assert_eq!(done.code(), 1);
        assert!(done.err.contains("other users have rights in it (mode 770)"), "{}", done.err);
        assert!(done.err.contains(&format!("chmod 700 {}", open.display())), "{}", done.err);
    }
    // A link is not followed: who made it chooses where it leads.
    let real = bench.path("real");
    std::fs::rename(&open, &real).unwrap();
    std::os::unix::fs::symlink(&real, &open).unwrap();
    let done = bench.call(&["run", text(&file), "--for", "1 s"]);
    assert!(done.err.contains("it is not a folder; remove it"), "{}", done.err);
    std::fs::remove_file(&open).unwrap();
    std::fs::rename(&real, &open).unwrap();
    if rustix::process::getuid().is_root() {
        std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o700)).unwrap();
        std::os::unix::fs::chown(&open, Some(65534), Some(65534)).unwrap();
        let done = bench.call(&["run", text(&file), "--for", "1 s"]);
        assert!(done.err.contains("it belongs to user 65534, not to you (user 0)"), "{}", done.err);
        assert!(done.err.contains("STILLPOINT_RUNS"), "{}", done.err);
    }
}
