//! The command as a user meets it: generated pages are current, the examples check and run, answers and exit codes hold.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Runs the command in `folder`, with a folder of runs of its own.
fn stillpoint(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_stillpoint"))
        .args(arguments)
        .current_dir(folder)
        .env("STILLPOINT_RUNS", folder.join("runs"))
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Compares a generated page with the one in the repository; `BLESS=1` writes it anew.
fn is_current(page: &str, generated: &str) {
    let path = root().join(page);
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, generated).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(kept, generated, "{page} is not current: run the tests with BLESS=1");
}

#[test]
fn generated_pages_are_current() {
    let folder = tempfile::tempdir().unwrap();
    let reference = stillpoint(folder.path(), &["operators", "--all"]);
    is_current("docs/operators-reference.md", &text(&reference.stdout));
    let schema = stillpoint(folder.path(), &["schema"]);
    is_current("docs/pipeline.schema.json", &text(&schema.stdout));
}

#[test]
fn every_example_checks_and_runs_and_replays() {
    let mut examples: Vec<PathBuf> = std::fs::read_dir(root().join("examples"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "yaml"))
        .collect();
    examples.push(root().join("pipeline.yaml"));
    examples.sort();
    for example in examples {
        let folder = tempfile::tempdir().unwrap();
        let file = example.canonicalize().unwrap().display().to_string();
        let run = ["run", &file, "--clock", "simulated", "--for", "1s", "--record", "s", "--json"];
        let out = stillpoint(folder.path(), &run);
        assert!(out.status.success(), "{file}: {}{}", text(&out.stdout), text(&out.stderr));
        let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let session = report["session"].as_str().unwrap();
        let replay = stillpoint(folder.path(), &["replay", session]);
        assert!(replay.status.success(), "{file}: {}{}", text(&replay.stdout), text(&replay.stderr));
        assert!(text(&replay.stdout).contains("identical"), "{file}");
    }
}

#[test]
fn the_default_pipeline_comes_with_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &["check"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("no faults"));
}

#[test]
fn a_wrong_pipeline_is_refused_with_place_and_exit_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let wrong = "stillpoint: 1\nname: x\noperators:\n  face: { use: segment.fce }\n";
    std::fs::write(folder.path().join("wrong.yaml"), wrong).unwrap();
    for command in [&["check", "wrong.yaml"][..], &["run", "wrong.yaml", "--for", "1s"]] {
        let out = stillpoint(folder.path(), command);
        assert_eq!(out.status.code(), Some(2));
        let said = text(&out.stderr);
        assert!(said.contains("wrong.yaml:4:16") && said.contains("segment.face"), "{said}");
    }
}

#[test]
fn what_is_not_there_is_named_and_nothing_panics() {
    let folder = tempfile::tempdir().unwrap();
    for (command, code, word) in [
        (&["run", "nothing.yaml"][..], 2, "nothing.yaml"),
        (&["replay", "nothing"], 1, "nothing"),
        (&["info", "nothing"], 1, "nothing"),
        (&["recover", "nothing"], 1, "nothing"),
        (&["operators", "segment.fac"], 2, "segment.face"),
        (&["echo", "filter.state"], 1, "no pipeline is running"),
        (&["send", "console.arm"], 1, "no pipeline is running"),
        (&["send", "console.amr"], 2, "arm"),
        (&["run", "--for", "10"], 2, "unit"),
    ] {
        let out = stillpoint(folder.path(), command);
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{command:?}: {said}");
        assert!(said.contains(word), "{command:?}: {said}");
        assert!(!said.contains("panicked") && !said.contains("RUST_BACKTRACE"), "{command:?}: {said}");
    }
}
