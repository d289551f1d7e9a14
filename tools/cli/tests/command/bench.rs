//! `stillpoint bench` starts `stillpoint-bench` from its own folder, and `stillpoint train` names the program that trains.

use std::path::Path;
use std::process::Command;

use crate::text;

/// A copy of the command in a folder of its own, so that nothing lies beside it.
fn copied(folder: &Path) -> Command {
    let copy = folder.join("stillpoint");
    install(env!("CARGO_BIN_EXE_stillpoint").as_ref(), &copy);
    let mut command = Command::new(copy);
    command.current_dir(folder);
    command
}

/// Copies a program with a process of its own. A copy that this process writes can't be started while a process that
/// another test forks in that moment holds its open file ("Text file busy").
fn install(program: &Path, copy: &Path) {
    assert!(Command::new("install").args(["-m", "700"]).args([program, copy]).status().unwrap().success());
}

#[test]
fn without_the_program_that_measures_the_command_that_builds_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = copied(folder.path()).args(["bench", "hop", "--help"]).output().unwrap();
    assert_eq!(out.status.code(), Some(1));
    let output_text = text(&out.stderr);
    assert!(output_text.contains("`cargo build --release -p stillpoint-bench`"), "{output_text}");
}

#[test]
fn the_program_that_lies_beside_the_command_gets_all_arguments_and_gives_its_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = copied(folder.path());
    let script = folder.path().join("script");
    std::fs::write(&script, "#!/bin/sh\necho \"$@\"\nexit 7\n").unwrap();
    install(&script, &folder.path().join("stillpoint-bench"));
    let out = command.args(["bench", "hop", "--windows", "2", "--help"]).output().unwrap();
    assert_eq!((out.status.code(), text(&out.stdout).as_str()), (Some(7), "hop --windows 2 --help\n"));
}

#[test]
fn train_names_the_one_command_that_trains_and_that_command_exists() {
    let folder = tempfile::tempdir().unwrap();
    let out = copied(folder.path()).args(["train", "planner", "--layers", "2"]).output().unwrap();
    assert_eq!(out.status.code(), Some(1));
    let printed = text(&out.stderr);
    let command = "`cargo run --release --manifest-path tools/research/Cargo.toml --target-dir target -- train planner \
                   --layers 2`";
    assert!(printed.contains(command), "{printed}");
    assert!(crate::root().join("tools/research/Cargo.toml").is_file());
}
