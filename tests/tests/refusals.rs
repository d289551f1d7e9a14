//! What `run` refuses before it begins, and what it says where the machine refuses.

use std::os::unix::fs::DirBuilderExt;
use std::os::unix::process::CommandExt;

use crate::bench::{Bench, pipeline, text};

#[test]
fn what_contradicts_itself_is_refused() {
    let bench = Bench::new();
    let file = pipeline("chain.yaml");
    for (both, output_text) in [
        (&["--clock", "live", "--lock-step", "threads"][..], "remove --clock live or --lock-step"),
        (&["--no-record", "--record", "s"], "cannot be used with"),
    ] {
        let done = bench.call(&[&["run", text(&file), "--for", "100 ms"], both].concat());
        assert_eq!(done.code(), 2, "{both:?}: {}", done.err);
        assert!(done.err.contains(output_text), "{}", done.err);
    }
    assert!(!bench.path("s").exists());
}

#[test]
fn a_path_of_runs_that_sockets_cannot_have_is_named_alone() {
    let bench = Bench::new();
    let long = bench.path(&"x".repeat(100));
    std::fs::DirBuilder::new().mode(0o700).create(&long).unwrap();
    let file = pipeline("chain.yaml");
    let mut command = bench.command(&["run", text(&file), "--for", "100 ms", "--no-record"]);
    command.env("STILLPOINT_RUNS", &long);
    let done = bench.begin(command).finish();
    assert_eq!((done.code(), done.err.lines().count()), (1, 1), "{}", done.err);
    assert!(done.err.contains("name a folder with a shorter path in STILLPOINT_RUNS"), "{}", done.err);
    assert_eq!(std::fs::read_dir(&long).unwrap().count(), 0);
}

#[test]
fn few_files_at_once_are_named_as_what_lacks() {
    let bench = Bench::new();
    let file = pipeline("chain.yaml");
    let kit = bench.command(&[]).get_program().to_owned();
    let with_limit = |limit: &str| {
        let mut command = std::process::Command::new("sh");
        let script = format!("ulimit {limit}; exec \"$@\"");
        command.args(["-c", &script, "sh"]).arg(&kit);
        command.args(["run", text(&file), "--for", "100 ms", "--no-record"]);
        command.env("STILLPOINT_RUNS", bench.runs()).current_dir(bench.path("."));
        bench.begin(command).finish()
    };
    for files in ["30", "40", "60"] {
        let done = with_limit(&format!("-n {files}"));
        assert_eq!((done.code(), done.err.lines().count()), (1, 1), "{files}: {}", done.err);
        assert!(done.err.contains(&format!("and {files} are allowed: say `ulimit -n 1024`")), "{}", done.err);
    }
    // What a process may raise itself is raised.
    let done = with_limit("-S -n 60");
    assert_eq!(done.code(), 0, "{}", done.err);
}

/// The end of a run under a limit of the shell, as a user whom limits bind: root is exempt from that of processes.
fn run_with_limit(bench: &Bench, limit: &str, options: &[&str]) -> Option<crate::bench::Done> {
    const NOBODY: u32 = 65534;
    let kit = bench.command(&[]).get_program().to_owned();
    let mut command = std::process::Command::new("bash");
    command.args(["-c", &format!("ulimit {limit}; exec \"$@\""), "bash"]).arg(&kit);
    command.args(["run", text(&pipeline("chain.yaml"))]).args(options);
    command.env("STILLPOINT_RUNS", bench.runs()).current_dir(bench.path("."));
    if rustix::process::getuid().is_root() {
        if kit.to_str().is_some_and(|p| p.starts_with("/root/")) {
            eprintln!("skipped: the command lies where only root can read");
            return None;
        }
        for path in [bench.path(""), bench.runs()] {
            std::os::unix::fs::chown(path, Some(NOBODY), Some(NOBODY)).unwrap();
        }
        command.uid(NOBODY).gid(NOBODY);
    }
    Some(bench.begin(command).finish())
}

#[test]
fn too_few_processes_are_named_as_what_lacks() {
    // The first thread of the command, a process of the run, a thread of such a process.
    for count in ["1", "3", "5"] {
        let bench = Bench::new();
        let limit = format!("-u {count}");
        let Some(done) = run_with_limit(&bench, &limit, &["--for", "100 ms"]) else { return };
        assert_eq!(done.code(), 1, "{count}: {}", done.err);
        let output_text =
            format!("this user may have {count} processes and threads at once: raise `ulimit -u`");
        assert!(done.err.contains(&output_text) && !done.err.contains("panicked"), "{count}: {}", done.err);
        assert!(bench.run_ids().is_empty());
    }
    let bench = Bench::new();
    let options = ["--lock-step", "threads", "--for", "100 ms", "--no-record"];
    let Some(done) = run_with_limit(&bench, "-u 2", &options) else { return };
    assert_eq!(done.code(), 1, "{}", done.err);
    assert!(done.err.contains("cannot be started: ") && done.err.contains("`ulimit -u`"), "{}", done.err);
}

#[test]
fn a_file_size_that_is_too_small_is_named_as_what_lacks() {
    let bench = Bench::new();
    let Some(done) = run_with_limit(&bench, "-f 100", &["--for", "100 ms"]) else { return };
    assert_eq!((done.code(), done.err.lines().count()), (1, 1), "{}", done.err);
    assert!(done.err.contains("a file may have at most ") && done.err.contains("`ulimit -f"), "{}", done.err);
    // The recording is larger than one file may be. A live run goes on, in the next part.
    for (clock, seconds) in [("simulated", "20 s"), ("live", "6 s")] {
        let bench = Bench::new();
        let options = ["--clock", clock, "--for", seconds, "--record", "s"];
        let Some(done) = run_with_limit(&bench, "-f 800", &options) else { return };
        assert!(clock == "live" || done.code() == 1, "{}", done.err);
        let output_text = ["File too large", "a file may have at most ", "raise `ulimit -f`"];
        assert!(
            output_text.iter().all(|output_text| done.err.contains(output_text)),
            "{clock}: {}",
            done.err
        );
    }
}
