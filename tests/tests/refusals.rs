//! What `run` refuses before it begins, and what it says where the machine refuses.

use std::os::unix::fs::DirBuilderExt;

use crate::bench::{Bench, pipeline, text};

#[test]
fn what_contradicts_itself_is_refused() {
    let bench = Bench::new();
    let file = pipeline("chain.yaml");
    for (both, said) in [
        (&["--clock", "live", "--lock-step", "threads"][..], "remove --clock live or --lock-step"),
        (&["--no-record", "--record", "s"], "cannot be used with"),
    ] {
        let done = bench.call(&[&["run", text(&file), "--for", "100 ms"], both].concat());
        assert_eq!(done.code(), 2, "{both:?}: {}", done.err);
        assert!(done.err.contains(said), "{}", done.err);
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
