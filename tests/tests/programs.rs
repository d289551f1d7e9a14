//! Operators in programs of their own: they are the operators that they are in this program.

use std::path::PathBuf;

use crate::bench::{Bench, pipeline, text};

/// A program with the kit's operators and the control laws.
const PROGRAM: &str = env!("CARGO_BIN_EXE_kit-program");

/// The pipeline of a name, in which these kinds are those of the program.
fn in_program(bench: &Bench, name: &str, kinds: &[&str]) -> PathBuf {
    let mut own = std::fs::read_to_string(pipeline(name)).unwrap();
    for kind in kinds {
        let before = own.clone();
        own = own.replace(&format!("use: {kind},"), &format!("use: {{ program: {PROGRAM}, kind: {kind} }},"));
        assert_ne!(own, before, "{name} has no {kind}");
    }
    let file = bench.path(name);
    std::fs::write(&file, own).unwrap();
    file
}

fn session(bench: &Bench, file: &str, arguments: &[&str]) -> String {
    let run = ["run", file, "--json", "--record", "s"];
    let report = bench.call(&[&run, arguments].concat()).good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    report["session"].as_str().unwrap().to_owned()
}

#[test]
fn a_law_in_a_program_sends_the_bytes_of_the_law_in_the_command() {
    let bench = Bench::new();
    let own = in_program(&bench, "settings.yaml", &["control.pi"]);
    let script = "console.script=[{ at: 300 ms, say: set, parameter: law.proportional, value: 3 1/s }]";
    let simulated = ["--clock", "simulated", "--for", "1 s", "--set", script];
    let native = session(&bench, text(&pipeline("settings.yaml")), &simulated);
    let program = session(&bench, text(&own), &simulated);
    let diff = bench.call(&["diff", &native, &program, "--json"]).good();
    assert_eq!(diff["identical_all"], true, "{diff}");
    let processes = session(&bench, text(&own), &["--lock-step=processes", "--for", "1 s", "--set", script]);
    let part = |session: &str| std::fs::read(bench.path(session).join("part-000.mcap")).unwrap();
    assert!(part(&program) == part(&processes), "processes differ from the simulation");
}

#[test]
fn a_live_run_with_a_program_replays_where_its_session_is_trusted() {
    let bench = Bench::new();
    let own = in_program(&bench, "settings.yaml", &["control.pi"]);
    let run = bench.start(&["run", text(&own), "--json", "--record", "s"]);
    bench.wait_for_samples("law.duties", 2);
    let taken = bench.call(&["set", "law.proportional", "3 1/s", "--json"]);
    assert_eq!(taken.code(), 0, "{}{}", taken.out, taken.err);
    let report = run.stop().good();
    let session = report["session"].as_str().unwrap();

    let refused = bench.call(&["replay", session]);
    assert_eq!(refused.code(), 2, "{}{}", refused.out, refused.err);
    assert!(
        refused.err.contains("it is not started unasked") && refused.err.contains("--trust"),
        "{}",
        refused.err
    );
    let replay = bench.call(&["--trust", "replay", session, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
    assert_eq!(replay["identical"]["law.settings"], 1, "{replay}");
    let changed = bench.call(&["--trust", "replay", session, "--set", "law.rise=4 s", "--json"]).good();
    assert_eq!(changed["changes"][0]["what"], "rise", "{changed}");
    assert!(changed["computed"].as_array().unwrap().contains(&"law".into()), "{changed}");
}

#[test]
fn an_operator_in_a_program_that_panics_or_ends_or_hangs_begins_anew() {
    for (habit, reason, deadline) in [
        ("panic", "the kit panics at activation 10", ""),
        ("exit", "the program ended (exit status: 3)", ""),
        ("hang", "deadline", "deadline: 300 ms, "),
    ] {
        let bench = Bench::new();
        let file = bench.path("own.yaml");
        std::fs::write(
            &file,
            format!(
                "stillpoint: 1\nname: own\noperators:\n  own: {{ use: {{ program: {PROGRAM}, kind: kit.counter }}, every: 20 ms, \
                 {deadline}params: {{ habit: {habit} }} }}\nprocesses:\n  own_process: {{ operators: [own], restart: {{ limit: 2, \
                 backoff: 10 ms }} }}\nrecord: {{ topics: [own.value] }}\n"
            ),
        )
        .unwrap();
        let report = bench.call(&["run", text(&file), "--for", "60 s", "--json", "--record", "s"]);
        let report = report.json();
        assert!(report["ended_early"].is_string(), "{habit}: {report}");
        let faults = report["faults"].as_array().unwrap();
        assert!(
            !faults.is_empty() && faults.iter().any(|f| f.to_string().contains(reason)),
            "{habit}: {report}"
        );
        assert_eq!(report["balanced"], true, "{habit}: {report}");
        let session = report["session"].as_str().unwrap();
        let begun = crate::live::journal(&bench, session, "own").iter().filter(|e| e["cause"] == 0).count();
        assert_eq!(begun, 3, "{habit}: {report}");
        let replay = bench.call(&["--trust", "replay", session, "--json"]);
        assert_eq!(replay.json()["identical_all"], true, "{habit}: {}{}", replay.out, replay.err);
    }
}

#[test]
fn what_is_wrong_with_a_program_or_its_parameters_is_a_fault_of_the_file() {
    let bench = Bench::new();
    std::fs::write(bench.path("nothing.txt"), "no program").unwrap();
    for (use_of, params, place, message) in [
        (format!("{{ program: {PROGRAM}, kind: kit.conuter }}"), "", 8, "did you mean `kit.counter`?"),
        (format!("{{ program: {PROGRAM}, kind: kit.counter }}"), "habbit: none", 0, "did you mean `habit`?"),
        (
            format!("{{ program: {PROGRAM}, kind: kit.counter }}"),
            "at: 0",
            0,
            "the nearest allowed value is `1`",
        ),
        (format!("{{ program: {PROGRAM} }}"), "", 8, "needs the key `kind`"),
        ("{ program: ./gone, kind: my.op }".into(), "", 8, "the program `./gone` cannot be read"),
        ("{ program: nothing.txt, kind: my.op }".into(), "", 8, "`nothing.txt` describes no operators: "),
        ("{ program: /bin/true, kind: my.op }".into(), "", 8, "the program ended (exit status: 0)"),
        ("{ program: /bin/echo, kind: my.op }".into(), "", 8, "the program ended (exit status: 0)"),
    ] {
        let file = bench.path("own.yaml");
        let line = format!("    use: {use_of}\n    every: 20 ms\n    params: {{ {params} }}\n");
        std::fs::write(&file, format!("stillpoint: 1\nname: own\noperators:\n  own:\n{line}")).unwrap();
        let check = bench.call(&["check", "own.yaml"]);
        assert_eq!(check.code(), 2, "{}{}", check.out, check.err);
        let expected = if place > 0 { "own.yaml:5:10: ".to_owned() } else { "own.yaml:7:15: ".to_owned() };
        let expected = if params.starts_with("at") { expected.replace("15", "19") } else { expected };
        assert!(
            check.err.contains(&expected) && check.err.contains(message),
            "{expected}{message}\n{}",
            check.err
        );
    }
    // What the program describes is in the list of all values, with its defaults.
    let file = bench.path("own.yaml");
    let good = format!(
        "stillpoint: 1\nname: own\noperators:\n  own: {{ use: {{ program: {PROGRAM}, kind: kit.counter }}, every: 20 ms }}\n"
    );
    std::fs::write(&file, good).unwrap();
    let all = bench.call(&["check", "own.yaml", "--resolved"]);
    assert!(all.out.contains("      burst: 1  # default\n"), "{}{}", all.out, all.err);
}
