//! Where a process runs: its core and its scheduling class, and what is said where the machine does not allow them.

use std::os::unix::process::CommandExt;

use crate::bench::{Bench, Done, text};

const PIPELINE: &str = "
stillpoint: 1
name: seat
operators:
  source: { use: kit.outside, every: 5 ms }
  sink: { use: kit.mixer, inputs: { queue: source.value } }
processes:
  seated: { operators: [sink], ";

/// A pipeline whose process `seated` has this key.
fn pipeline(bench: &Bench, key: &str) -> std::path::PathBuf {
    let path = bench.path("seat.yaml");
    std::fs::write(&path, format!("{}{key} }}\n", PIPELINE.trim_start())).unwrap();
    path
}

/// What `/proc` says of a thread: a line of its `status`.
fn status(process: u32, thread: &str, key: &str) -> String {
    let path = format!("/proc/{process}/task/{thread}/status");
    let status = std::fs::read_to_string(path).unwrap();
    let line = status.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix(':'));
    line.unwrap().trim().to_owned()
}

/// Scheduling class and real-time priority of a process's first thread.
fn scheduling(process: u32) -> (u32, u32) {
    let stat = std::fs::read_to_string(format!("/proc/{process}/task/{process}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    // Fields 40 and 41 of proc(5); the first one here is number 3.
    (fields[41 - 3].parse().unwrap(), fields[40 - 3].parse().unwrap())
}

/// The last core that this process may use.
fn last_core() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let list = status.lines().find_map(|l| l.strip_prefix("Cpus_allowed_list:")).unwrap().trim();
    list.rsplit([',', '-']).next().unwrap().to_owned()
}

#[test]
fn a_process_runs_on_the_core_that_it_is_bound_to_and_no_other_process_does() {
    let bench = Bench::new();
    let core = last_core();
    let run = bench.run(&pipeline(&bench, &format!("core: {core}")));
    bench.wait_for_samples("sink.sum", 5);
    let seated = run.child("seated", 0);
    assert_eq!(status(seated, &seated.to_string(), "Cpus_allowed_list"), core);
    let free = run.child("source", 0);
    let here = std::process::id();
    assert_eq!(
        status(free, &free.to_string(), "Cpus_allowed_list"),
        status(here, &here.to_string(), "Cpus_allowed_list")
    );
    run.stop().good();
}

fn is_refused_with_the_limit(done: &Done) {
    assert_eq!(done.code(), 1, "{}", done.err);
    assert!(done.err.contains("ulimit -l") || done.err.contains("ulimit -r"), "{}", done.err);
    assert!(done.err.contains("remove `priority`"), "{}", done.err);
}

#[test]
fn a_real_time_priority_is_given_or_refused_with_the_limit_that_forbids_it() {
    let bench = Bench::new();
    let file = pipeline(&bench, "priority: fifo 7");
    let run = bench.run(&file);
    let begun = crate::bench::wait_for("samples or a refusal", || {
        let done = bench.call(&["echo", "--json", "sink.sum", "--count", "3"]);
        (done.code() == 0 || !run.errors().is_empty()).then_some(done.code() == 0)
    });
    if begun {
        const FIFO: u32 = 1;
        assert_eq!(scheduling(run.child("seated", 0)), (FIFO, 7));
        assert_eq!(scheduling(run.child("source", 0)).0, 0);
        run.stop().good();
        // What is granted is granted to who only asks for it, too.
        let run = bench.run(&pipeline(&bench, "priority: fifo 7 if allowed"));
        bench.wait_for_samples("sink.sum", 3);
        assert_eq!(scheduling(run.child("seated", 0)), (FIFO, 7));
        run.stop().good();
    } else {
        is_refused_with_the_limit(&run.finish());
    }
}

#[test]
fn a_user_without_rights_is_told_which_limit_forbids_the_priority() {
    if !rustix::process::getuid().is_root() {
        println!("skipped: only root can become a user without rights");
        return;
    }
    const NOBODY: u32 = 65534;
    let bench = Bench::new();
    let file = pipeline(&bench, "priority: fifo 7");
    for path in [bench.path(""), bench.runs()] {
        std::os::unix::fs::chown(path, Some(NOBODY), Some(NOBODY)).unwrap();
    }
    let mut command = bench.command(&["run", text(&file), "--no-record"]);
    command.uid(NOBODY).gid(NOBODY);
    if command.get_program().to_str().is_some_and(|p| p.starts_with("/root/")) {
        println!("skipped: the command lies where only root can read");
        return;
    }
    is_refused_with_the_limit(&bench.begin(command).finish());
}

#[test]
fn a_user_without_rights_runs_with_normal_priority_where_the_file_lets_him_and_the_log_says_why() {
    if !rustix::process::getuid().is_root() {
        println!("skipped: only root can become a user without rights");
        return;
    }
    const NOBODY: u32 = 65534;
    let bench = Bench::new();
    let file = pipeline(&bench, "priority: fifo 7 if allowed");
    for path in [bench.path(""), bench.runs()] {
        std::os::unix::fs::chown(path, Some(NOBODY), Some(NOBODY)).unwrap();
    }
    let mut command = bench.command(&["run", text(&file), "--for", "300 ms", "--record", "s"]);
    command.uid(NOBODY).gid(NOBODY);
    if command.get_program().to_str().is_some_and(|p| p.starts_with("/root/")) {
        println!("skipped: the command lies where only root can read");
        return;
    }
    let done = bench.begin(command).finish();
    assert_eq!(done.code(), 0, "{}", done.err);
    let session = std::fs::read_dir(bench.path("s")).unwrap().next().unwrap().unwrap().path();
    let log = std::fs::read_to_string(session.join("log.jsonl")).unwrap();
    assert!(log.contains("seated runs with normal priority"), "{log}");
    assert!(log.contains("ulimit -l") || log.contains("ulimit -r"), "{log}");
}

#[test]
fn a_core_that_is_not_there_is_found_before_anything_starts() {
    let bench = Bench::new();
    let file = pipeline(&bench, "core: 4095");
    for command in ["check", "run"] {
        let done = bench.call(&[command, text(&file)]);
        assert_eq!(done.code(), 2, "{}", done.err);
        assert!(done.err.contains("seat.yaml:7:38: there is no core 4095"), "{}", done.err);
        assert!(done.err.contains(&format!("write for example `core: {}`", last_core())), "{}", done.err);
    }
    // In one process nothing is bound, and a session is replayed on any machine.
    let report = bench
        .call(&["run", text(&file), "--clock", "simulated", "--for", "1 s", "--json", "--record", "s"])
        .good();
    bench.call(&["replay", report["session"].as_str().unwrap(), "--json"]).good();
}
