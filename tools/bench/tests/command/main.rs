//! The command `stillpoint-bench`: it refuses arguments with which it would measure nothing, and short measurements
//! show that the promises of the design hold.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod failsafe;

use std::path::Path;
use std::process::{Command, Output};

/// Runs the program in `folder`, with its own folder of runs.
fn stillpoint_bench(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_stillpoint-bench"))
        .args(arguments)
        .current_dir(folder)
        .env("STILLPOINT_RUNS", folder.join("runs"))
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The JSON that a measurement prints.
fn reported(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    let out = stillpoint_bench(folder, arguments);
    assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn arguments_with_which_a_bench_measures_nothing_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (bench, option, wrong) in [
        ("hop", "windows", "0"),
        ("hop", "length", "10"),
        ("hop", "payload", "65"),
        ("record", "windows", "0"),
        ("record", "length", "100"),
        ("replay", "seconds", "0"),
        ("replay", "replays", "0"),
        ("ledger", "samples", "0"),
        ("ledger", "kill-every", "9"),
        ("killed", "kills", "0"),
        ("failsafe", "trials", "0"),
        ("failsafe", "threads", "0"),
        ("loop", "seconds", "0"),
        ("loop", "rounds", "0"),
        ("tap", "windows", "0"),
        ("tap", "length", "100"),
        ("tap", "payload", "65"),
        ("scale", "operators", "1"),
        ("scale", "group", "0"),
        ("scale", "seconds", "0"),
    ] {
        let out = stillpoint_bench(folder.path(), &[bench, &format!("--{option}"), wrong]);
        let message = text(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{bench} --{option} {wrong}: {message}");
        assert!(message.contains(&format!("invalid value '{wrong}' for '--{option}")), "{message}");
    }
}

#[test]
fn a_ledger_without_kills_balances() {
    let folder = tempfile::tempdir().unwrap();
    let ledger = ["ledger", "--kill-every", "0", "--samples", "2000", "--json"];
    let reported = reported(folder.path(), &ledger);
    assert_eq!((&reported["kills"], &reported["balanced"]), (&0.into(), &true.into()));
}

#[test]
fn ten_kills_of_the_recorder_at_random_moments_take_at_most_the_last_second() {
    let folder = tempfile::tempdir().unwrap();
    let reported = reported(folder.path(), &["killed", "--kills", "10", "--folder", ".", "--json"]);
    let ten = serde_json::json!(10);
    assert_eq!((&reported["kept"], &reported["whole"], &reported["opens"]), (&ten, &ten, &ten));
}

#[test]
fn the_cost_of_each_attached_command_is_measured_in_one_run() {
    let folder = tempfile::tempdir().unwrap();
    let reported =
        reported(folder.path(), &["tap", "--windows", "1", "--length", "300", "--payload", "64", "--json"]);
    let tools: Vec<&str> = reported.as_array().unwrap().iter().map(|l| l["tool"].as_str().unwrap()).collect();
    assert_eq!(tools, ["none", "echo", "top", "view"]);
    for line in reported.as_array().unwrap() {
        let count = |of: &str| line[of]["count"].as_u64().unwrap();
        assert!(count("without") > 10 && count("with") > 10, "{line}");
        // The same pipeline on both sides: the ratio is that of the two medians.
        let p50 = |of: &str| line[of]["p50"].as_f64().unwrap();
        let ratio = line["ratio"].as_f64().unwrap();
        assert!((ratio - p50("with") / p50("without")).abs() < 1e-9, "{line}");
    }
}

#[test]
fn a_pipeline_of_many_operators_is_measured_with_and_without_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let reported = reported(folder.path(), &["scale", "--operators", "4,12", "--quick", "--json"]);
    for (line, (operators, processes)) in reported.as_array().unwrap().iter().zip([(4, 2), (12, 3)]) {
        assert_eq!(
            (&line["operators"], &line["processes"]),
            (&operators.into(), &processes.into()),
            "{line}"
        );
        for positive in ["start_s", "memory_bytes", "cpu_percent", "top_cpu_s"] {
            assert!(line[positive].as_f64().unwrap() > 0.0, "{positive}: {line}");
        }
        let recorded = &line["recorded"];
        for hop in [&line["hop_us"], &line["hop_with_top_us"], &recorded["hop_us"]] {
            assert!(hop["count"].as_u64().unwrap() > 5 && hop["p50"].as_f64().unwrap() > 0.0, "{line}");
        }
        assert!(recorded["recorder_cpu_percent"].as_f64().unwrap() > 0.0, "{line}");
        assert!(recorded["recorder_memory_bytes"].as_u64().unwrap() > 0, "{line}");
    }
}
