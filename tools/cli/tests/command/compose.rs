//! Pipelines that are put together: variables in paths.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

use crate::{root, stillpoint, text};

/// Runs the command with a variable of the environment.
fn with(folder: &Path, (name, value): (&str, &str), arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stillpoint"));
    command.args(arguments).current_dir(folder).env("STILLPOINT_RUNS", folder.join("runs")).env(name, value);
    command.output().unwrap()
}

#[test]
fn a_session_replays_without_the_variables_that_its_paths_named() {
    let folder = tempfile::tempdir().unwrap();
    let own = std::fs::read_to_string(root().join("pipeline.yaml")).unwrap();
    std::fs::write(
        folder.path().join("own.yaml"),
        own.replace("examples/data/rig.key", "\"${OWN_KEYS}/rig.key\""),
    )
    .unwrap();
    let keys = root().join("examples/data").canonicalize().unwrap().display().to_string();

    let unset = stillpoint(folder.path(), &["check", "own.yaml"]);
    assert_eq!(unset.status.code(), Some(2));
    let message = text(&unset.stderr);
    assert!(
        message.contains("own.yaml:38:118: ")
            && message.contains("the variable `OWN_KEYS` of the environment is not set"),
        "{message}"
    );

    // In this thread, and in the processes of a live run.
    for arguments in [&["--clock", "simulated", "--for", "200ms"][..], &["--for", "500ms"]] {
        let run = [&["run", "own.yaml", "--record", "s", "--json"], arguments].concat();
        let out = with(folder.path(), ("OWN_KEYS", &keys), &run);
        assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        let session = report["session"].as_str().unwrap();
        let info = text(&stillpoint(folder.path(), &["info", session]).stdout);
        assert!(
            info.contains(&format!("paths of the pipeline named ${{OWN_KEYS}}, which was {keys}")),
            "{info}"
        );
        for replay in [&["replay", session][..], &["replay", session, "--set", "law.rise=4 s"]] {
            let out = stillpoint(folder.path(), replay);
            assert!(out.status.success(), "{replay:?}: {}{}", text(&out.stdout), text(&out.stderr));
        }
    }
}
