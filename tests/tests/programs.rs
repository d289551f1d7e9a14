//! Operators in programs of their own: they are the operators that they are in this program.

use std::path::PathBuf;

use crate::bench::{Bench, pipeline, text, wait_for};

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

/// The process numbers of programs that serve a child of this process.
fn served_by(parent: u32) -> Vec<u32> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let serving = |e: std::fs::DirEntry| {
        let number: u32 = e.file_name().to_str()?.parse().ok()?;
        let stat = std::fs::read_to_string(e.path().join("stat")).ok()?;
        let is_child = stat.rsplit_once(')')?.1.split_whitespace().nth(1)? == parent.to_string();
        let line = std::fs::read(e.path().join("cmdline")).ok()?;
        (is_child && line.split(|b| *b == 0).any(|word| word == b"--serve")).then_some(number)
    };
    entries.filter_map(serving).collect()
}

#[test]
fn a_program_that_is_killed_begins_anew_and_the_session_replays_also_alone() {
    let bench = Bench::new();
    let own = in_program(&bench, "settings.yaml", &["control.pi"]);
    let run = bench.start(&["run", text(&own), "--json", "--record", "s"]);
    bench.wait_for_samples("law.duties", 2);
    let lives = |life: u32| {
        wait_for("a sample of the new incarnation", || {
            let line = bench.call(&["echo", "--json", "law.duties", "--count", "1"]).out;
            let sample: serde_json::Value = serde_json::from_str(line.lines().next()?).ok()?;
            (sample["incarnation"] == life).then_some(())
        });
    };
    for life in 0..2 {
        lives(life);
        let law = run.child("law", 0);
        let program = wait_for("the program", || served_by(law).pop());
        crate::bench::signal(program, rustix::process::Signal::KILL);
    }
    lives(2);
    let report = run.stop().json();
    assert_eq!(report["balanced"], true, "{report}");
    let faults = report["faults"].to_string();
    assert!(faults.contains("the program ended (signal: 9"), "{faults}");
    let session = report["session"].as_str().unwrap();
    let begun = crate::live::journal(&bench, session, "law").iter().filter(|e| e["cause"] == 0).count();
    assert_eq!(begun, 3, "{report}");
    for only in [&[][..], &["--only", "law"]] {
        let replay = bench.call(&[&["--trust", "replay", session, "--json"], only].concat());
        assert_eq!(replay.code(), 0, "{only:?}: {}{}", replay.out, replay.err);
        let replay = replay.json();
        assert_eq!(replay["identical_all"], true, "{only:?}: {replay}");
        assert!(replay["identical"]["law.duties"].as_u64().unwrap() > 2, "{only:?}: {replay}");
    }
    let refused = bench.call(&["replay", session, "--only", "law"]);
    assert!(refused.code() == 2 && refused.err.contains("--trust"), "{}{}", refused.out, refused.err);
}

#[test]
fn clouds_of_a_megabyte_and_operators_with_laps_have_the_same_bytes_in_a_program() {
    let bench = Bench::new();
    let write = |name: &str, program: &str| {
        let kind = |kind: &str| match program {
            "" => kind.to_owned(),
            program => format!("{{ program: {program}, kind: {kind} }}"),
        };
        let text = format!(
            "stillpoint: 1\nname: clouds\noperators:\n  bulk: {{ use: {}, every: 50 ms, params: {{ points: 100000 }} }}\n  drain: {{ use: \
             {}, inputs: {{ cloud: bulk.cloud }} }}\n  source: {{ use: kit.outside, every: 20 ms }}\n  laps: {{ use: {}, inputs: {{ from: \
             source.value }} }}\nrecord: {{ topics: [bulk.cloud, laps.same] }}\n",
            kind("kit.bulk"),
            kind("kit.drain"),
            kind("kit.lapping"),
        );
        std::fs::write(bench.path(name), text).unwrap();
    };
    write("native.yaml", "");
    write("program.yaml", PROGRAM);
    let simulated = ["--clock", "simulated", "--for", "300 ms"];
    let native = session(&bench, "native.yaml", &simulated);
    let program = session(&bench, "program.yaml", &simulated);
    let diff = bench.call(&["diff", &native, &program, "--json"]).good();
    assert_eq!(diff["identical_all"], true, "{diff}");
    let info = bench.call(&["info", &program, "--json"]).good();
    let topics = info["topics"].as_array().unwrap();
    let cloud = topics.iter().find(|topic| topic["name"] == "bulk.cloud").unwrap();
    assert!(cloud["bytes"].as_u64().unwrap() >= 5 * 1_200_000, "{cloud}");
    let replay = bench.call(&["--trust", "replay", &program, "--json"]).good();
    assert_eq!(replay["identical_all"], true, "{replay}");
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
