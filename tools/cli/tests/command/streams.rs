//! Streams that nobody reads, disks that are full, words that are no text, files without an end.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::{stillpoint, text};

/// The end of a pipe whose other end is closed.
fn closed() -> Stdio {
    std::io::pipe().unwrap().1.into()
}

/// A disk that is full.
fn full() -> Stdio {
    std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap().into()
}

/// Runs the command with these streams; what is not given is read.
fn with(folder: &Path, arguments: &[&str], out: Option<Stdio>, err: Option<Stdio>) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stillpoint"));
    command.args(arguments).current_dir(folder).env("STILLPOINT_RUNS", folder.join("runs"));
    command.stdout(out.unwrap_or_else(Stdio::piped)).stderr(err.unwrap_or_else(Stdio::piped));
    command.spawn().unwrap().wait_with_output().unwrap()
}

#[test]
fn an_exit_code_is_what_it_is_whoever_listens() {
    let folder = tempfile::tempdir().unwrap();
    let good = "stillpoint: 1\nname: x\noperators:\n  console: { use: console, every: 20 ms }\n";
    std::fs::write(folder.path().join("good.yaml"), good).unwrap();
    std::fs::write(folder.path().join("wrong.yaml"), "stillpoint: 1\nname: x\n").unwrap();
    let simulated = ["run", "good.yaml", "--clock", "simulated", "--for", "1s", "--no-record"];
    for (arguments, code, on_a_full_disk) in [
        (&["check", "good.yaml"][..], 0, 1),
        (&["check", "wrong.yaml", "--json"], 2, 2),
        (&["operators", "--all"], 0, 1),
        (&["--help"], 0, 1),
        (&simulated, 0, 1),
    ] {
        let unread = with(folder.path(), arguments, Some(closed()), None);
        assert_eq!(
            (unread.status.code(), text(&unread.stderr)),
            (Some(code), String::new()),
            "{arguments:?}"
        );
        let unwritten = with(folder.path(), arguments, Some(full()), None);
        let output_text = text(&unwritten.stderr);
        assert_eq!(unwritten.status.code(), Some(on_a_full_disk), "{arguments:?}: {output_text}");
        assert!(
            output_text.contains("standard output cannot be written: No space left"),
            "{arguments:?}: {output_text}"
        );
    }
    for (arguments, code) in [
        (&["check", "wrong.yaml"][..], 2),
        (&["check", "nothing.yaml"], 2),
        (&["info", "nothing"], 1),
        (&["nothing"], 2),
    ] {
        for err in [closed(), full()] {
            let unheard = with(folder.path(), arguments, None, Some(err));
            assert_eq!(unheard.status.code(), Some(code), "{arguments:?}");
        }
    }
}

#[test]
fn an_argument_that_is_no_text_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [&[&b"\xff"[..]][..], &[b"check", b"\xff.yaml"], &[b"info", b"\xff"]] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_stillpoint"));
        let out = command.args(arguments.iter().map(|a| OsStr::from_bytes(a))).current_dir(folder.path());
        let out = out.output().unwrap();
        let output_text = text(&out.stderr);
        assert!(matches!(out.status.code(), Some(1 | 2)), "{arguments:?}: {:?} {output_text}", out.status);
        assert!(!output_text.contains("panicked") && !output_text.contains("itself"), "{output_text}");
    }
}

#[test]
fn a_file_without_an_end_is_too_long() {
    let folder = tempfile::tempdir().unwrap();
    // More than any memory has, and nothing on the disk.
    std::fs::File::create(folder.path().join("long.yaml")).unwrap().set_len(1 << 42).unwrap();
    let out = stillpoint(folder.path(), &["check", "long.yaml", "--json"]);
    let output_text: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(
        (out.status.code(), &output_text["faults"][0]["code"]),
        (Some(2), &"too-large".into()),
        "{output_text}"
    );
}

#[test]
fn every_message_begins_with_the_name_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["send", "console.amr"][..],
        &["send", "arm"],
        &["send", "console.arm"],
        &["info", "nothing"],
        &["check", "nothing.yaml"],
        &["run", "--for", "10"],
        &["operators", "segment.fac"],
        &["echo", "imu", "--session", "nothing"],
    ] {
        let output_text = text(&stillpoint(folder.path(), arguments).stderr);
        assert!(
            output_text.starts_with("stillpoint: ") && output_text.matches("stillpoint: ").count() == 1,
            "{output_text}"
        );
    }
}

#[test]
fn a_verb_is_sent_with_as_many_values_as_it_takes() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, words) in [
        (&["console.capture", "1"][..], "`console.capture` takes no values"),
        (&["console.accept"], "`console.accept` takes the number of the request whose plan is accepted"),
        (&["console.target"], "`console.target` takes a value in m or rad for each channel"),
        (&["console.fault", "leak"], "`console.fault leak` takes the number of the valve or bladder"),
        (&["console.fault", "mend", "1"], "`console.fault mend` takes no values"),
        (
            &["console.fault", "weak_supply", "0", "0.8", "1", "1"],
            "`console.fault weak_supply` takes at most",
        ),
        (&[".arm"], "`.arm`: write the console and a verb"),
    ] {
        let out = stillpoint(folder.path(), &[&["send"], arguments].concat());
        assert_eq!(out.status.code(), Some(2));
        assert!(text(&out.stderr).contains(words), "{}", text(&out.stderr));
    }
}
