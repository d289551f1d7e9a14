//! Pipelines that are put together: variables in paths, included files, and all values.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use stillpoint_operator::files::DiskFiles;
use stillpoint_pipeline::config::check;
use stillpoint_pipeline::graph::{Graph, OperatorNode};

use crate::first_hour::{blocks, printed_by};
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

/// A folder with `own.yaml`, which includes `parts/rest.yaml`: the default pipeline, with its key next to it.
fn in_two_files() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let parts = folder.path().join("parts");
    std::fs::create_dir(&parts).unwrap();
    let rest = std::fs::read_to_string(root().join("pipeline.yaml"))
        .unwrap()
        .replace("examples/data/rig.key", "rig.key");
    std::fs::write(parts.join("rest.yaml"), rest + "\nparameters: { rise: law.rise }\n").unwrap();
    std::fs::copy(root().join("examples/data/rig.key"), parts.join("rig.key")).unwrap();
    let own = "stillpoint: 1\nname: own\ninclude: { file: parts/rest.yaml, with: { rise: 4 s } }\n";
    std::fs::write(folder.path().join("own.yaml"), own).unwrap();
    folder
}

#[test]
fn a_session_of_included_files_replays_and_runs_changed_without_them() {
    let folder = in_two_files();
    let mut sessions = Vec::new();
    for arguments in [&["--clock", "simulated", "--for", "200ms"][..], &["--for", "500ms"]] {
        let run = [&["run", "own.yaml", "--record", "s", "--json", "--set", "law.integral=2.5"], arguments]
            .concat();
        let out = stillpoint(folder.path(), &run);
        assert!(out.status.success(), "{}{}", text(&out.stdout), text(&out.stderr));
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        sessions.push(report["session"].as_str().unwrap().to_owned());
    }
    std::fs::remove_dir_all(folder.path().join("parts")).unwrap();
    std::fs::remove_file(folder.path().join("own.yaml")).unwrap();
    for session in &sessions {
        let info = text(&stillpoint(folder.path(), &["info", session]).stdout);
        assert!(info.contains("the pipeline included parts/rest.yaml"), "{info}");
        for replay in [&["replay", session][..], &["replay", session, "--set", "law.rise=5 s"]] {
            let out = stillpoint(folder.path(), replay);
            assert!(out.status.success(), "{replay:?}: {}{}", text(&out.stdout), text(&out.stderr));
        }
    }
    // A rise of 4 s was given by `with`: to set it changes nothing.
    let out = stillpoint(folder.path(), &["replay", &sessions[0], "--set", "law.rise=4 s", "--json"]);
    let same: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(same["changes"], serde_json::json!([]), "{same}");
}

#[test]
fn a_fault_of_an_included_file_is_in_that_file() {
    let folder = in_two_files();
    let rest = folder.path().join("parts/rest.yaml");
    let broken = std::fs::read_to_string(&rest)
        .unwrap()
        .replace("rise: 5 s", "rise: 5 mm")
        .replace("law.rise", "law.integral");
    let line = 1 + broken.lines().position(|line| line.contains("rise: 5 mm")).unwrap() as u64;
    std::fs::write(&rest, broken).unwrap();
    let out = stillpoint(folder.path(), &["check", "own.yaml", "--json"]);
    assert_eq!(out.status.code(), Some(2));
    let faults: Value = serde_json::from_slice(&out.stdout).unwrap();
    let faults: Vec<_> = faults["faults"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| (f["file"].as_str().unwrap(), f["line"].as_u64().unwrap()))
        .collect();
    assert_eq!(faults, [("own.yaml", 3), ("parts/rest.yaml", line)]);
}

/// Compares two pipelines in all that a run takes from them.
fn is_same(a: &Graph, b: &Graph, name: &str) {
    assert_eq!((&a.name, a.seed, &a.frames), (&b.name, b.seed, &b.frames), "{name}");
    assert_eq!(
        (&a.record, &a.contracts, &a.hosts, &a.ros2),
        (&b.record, &b.contracts, &b.hosts, &b.ros2),
        "{name}"
    );
    assert_eq!((&a.pools, a.operators.len()), (&b.pools, b.operators.len()), "{name}");
    assert_eq!(format!("{:?}", a.processes), format!("{:?}", b.processes), "{name}");
    for (a, b) in a.operators.iter().zip(&b.operators) {
        assert_eq!((&a.name, a.stage.kind.name), (&b.name, b.stage.kind.name), "{name}");
        assert_eq!(a.params.resolved, b.params.resolved, "{name}: {}", a.name);
        let times = |o: &OperatorNode| (o.every, o.latency, o.deadline, o.start_within, o.process, o.far_end);
        assert_eq!(times(a), times(b), "{name}: {}", a.name);
        assert_eq!(
            format!("{:?}{:?}", a.inputs, a.outputs),
            format!("{:?}{:?}", b.inputs, b.outputs),
            "{name}: {}",
            a.name
        );
        assert_eq!(a.files, b.files, "{name}: {}", a.name);
    }
}

#[test]
fn all_values_of_every_example_are_the_same_pipeline() {
    let mut files: Vec<_> =
        std::fs::read_dir(root().join("examples")).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "yaml"));
    files.push(root().join("pipeline.yaml"));
    let registry = stillpoint::registry(&[]);
    let folder = in_two_files();
    files.push(folder.path().join("own.yaml"));
    assert!(files.len() > 10, "{}", files.len());
    for file in files {
        let name = file.display().to_string();
        let out = stillpoint(
            file.parent().unwrap(),
            &["check", file.file_name().unwrap().to_str().unwrap(), "--resolved"],
        );
        assert!(out.status.success(), "{name}: {}", text(&out.stderr));
        let disk = DiskFiles::next_to(&file);
        let graph = |pipeline: &str| {
            check(pipeline, &name, &[], &registry, &disk).unwrap_or_else(|faults| panic!("{faults}"))
        };
        let all = text(&out.stdout);
        is_same(&graph(&std::fs::read_to_string(&file).unwrap()), &graph(&all), &name);
        assert!(all.contains("  # default\n") && all.contains(".yaml:"), "{all}");
    }
}

#[test]
fn values_say_where_they_came_from() {
    let folder = in_two_files();
    let arguments = ["check", "own.yaml", "--resolved", "--json", "--set", "law.integral=2.5"];
    let out = stillpoint(folder.path(), &arguments);
    let all: Value = serde_json::from_slice(&out.stdout).unwrap();
    let of = |param: &str| {
        let path = serde_json::json!(["operators", "law", "params", param]);
        let found = all["values"].as_array().unwrap().iter().find(|value| value["path"] == path);
        found.map(|value| (value["value"].clone(), value["from"].clone(), value["file"].clone())).unwrap()
    };
    assert_eq!(of("rise"), ("4 s".into(), "file".into(), "own.yaml".into()));
    assert_eq!(of("proportional"), ("2.37 1/s".into(), "file".into(), "parts/rest.yaml".into()));
    assert_eq!(of("integral"), ("2.5".into(), "argument".into(), Value::Null));
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("broken.yaml"), "stillpoint: 1\n").unwrap();
    let out = stillpoint(folder.path(), &["check", "broken.yaml", "--resolved"]);
    assert_eq!((out.status.code(), text(&out.stdout).as_str()), (Some(2), ""));
}

/// `docs/guide/compose.md`: its files, and its commands in their order.
#[test]
fn the_commands_of_the_guide_run_in_their_order() {
    let page = include_str!("../../../../docs/guide/compose.md");
    let folder = tempfile::tempdir().unwrap();
    let out = stillpoint(folder.path(), &["new", "mine"]);
    assert!(out.status.success(), "{}", text(&out.stderr));
    let mine = folder.path().join("mine");
    let files = blocks(page, "yaml");
    let [added, variant] = &files[..] else { panic!("{files:?}") };
    let own = std::fs::read_to_string(mine.join("pipeline.yaml")).unwrap();
    std::fs::write(mine.join("pipeline.yaml"), own + added).unwrap();
    std::fs::write(mine.join("variant.yaml"), variant).unwrap();
    let printed = printed_by(&blocks(page, "sh").concat(), &mine);
    for expected in [
        "variant: 14 operators in 5 processes, no faults",
        "rise: 3 s  # variant.yaml:3\n",
        "\"argument\": \"law.integral=2.5\"",
        "identical: ",
        "change: law.rise: 3.0 -> 4.0",
    ] {
        assert!(printed.contains(expected), "{expected} is missing in\n{printed}");
    }
}
