//! `stillpoint bench scale`: start-up, memory and costs of pipelines with many operators.

use std::fmt::Write;
use std::num::NonZeroUsize;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use clap::Args;
use rustix::process::Pid;
use serde::Serialize;
use stillpoint::{Ended, Exit, Failure, Tap, print_json};
use stillpoint_operator::Registry;
use stillpoint_recorder::session_parts;

use super::COMMAND;
use super::figures::Quantiles;
use super::folder::Folder;
use super::processes::{cpu, memory};
use super::program::{Program, ages};

/// Number of payloads per second.
const RATE: u64 = 20;
/// Maximum time until a payload has gone through all operators.
const PATIENCE: Duration = Duration::from_secs(180);
/// Name of the recorder's process.
const RECORDER: &str = "recorder";

/// Measure pipelines with 10, 100 and 300 operators: start-up, memory, and the costs of a hop, of `top` and of the
/// recorder.
///
/// A pipeline is a chain: each operator copies a payload of 64 bytes for the next one, 20 times a second. It runs without
/// a recording, then with one. Start-up is the time from the start of the program to the first payload that has come to
/// the end. Memory is that of all processes, where a shared page counts in parts. Cores are not bound.
#[derive(Args)]
pub struct Scale {
    /// Numbers of operators.
    #[arg(long, value_name = "N", value_delimiter = ',', default_values_t = [10, 100, 300],
        value_parser = super::at_least::<usize>(2))]
    operators: Vec<usize>,
    /// Number of operators in one process.
    #[arg(long, default_value = "10")]
    group: NonZeroUsize,
    /// Length of a window, s.
    #[arg(long, default_value_t = 5, value_parser = super::at_least::<u64>(1))]
    seconds: u64,
    /// A short measurement: windows of 1 s.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The figures of a pipeline.
#[derive(Debug, Serialize)]
struct Line {
    operators: usize,
    /// Number of processes, with supervisor and without recorder.
    processes: usize,
    start_s: f64,
    memory_bytes: u64,
    /// Share of one core of all processes of the run, per cent.
    cpu_percent: f64,
    /// Time of a payload through the whole chain, divided by the number of hops, us.
    hop_us: Quantiles,
    /// The same while `top` watches, us.
    hop_with_top_us: Quantiles,
    /// CPU time that `top --once` takes for its window, and its time beyond the window, s.
    top_cpu_s: f64,
    top_beyond_s: f64,
    /// The same pipeline while it is recorded.
    recorded: Recorded,
}

#[derive(Debug, Serialize)]
struct Recorded {
    start_s: f64,
    hop_us: Quantiles,
    /// Share of one core that the recorder takes, per cent.
    recorder_cpu_percent: f64,
    recorder_memory_bytes: u64,
    /// Bytes on the disk per second, without what the beginning of the session takes.
    bytes_per_second: f64,
}

impl Scale {
    /// Runs the pipelines and prints their figures.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(None)?;
        let length = Duration::from_secs(if self.quick { 1 } else { self.seconds });
        let lines = self.operators.iter().map(|count| self.measure(*count, length, &folder, registry));
        let lines = lines.collect::<Result<Vec<Line>, Failure>>()?;
        if self.json {
            print_json(&lines)?;
        } else {
            out!("{}", table(&lines));
        }
        Ok(Exit::Done)
    }

    fn measure(
        &self,
        count: usize,
        length: Duration,
        folder: &Folder,
        registry: &Registry,
    ) -> Result<Line, Failure> {
        let text = pipeline(count, self.group.get());
        let at = folder.free("plain")?;
        let mut run = Chain::start(&text, &at, &["--no-record"], count - 1, registry)?;
        let processes = run.program.processes();
        let all = |of: fn(Pid) -> u64| processes.iter().map(|(_, pid)| of(*pid)).sum::<u64>();
        let (before, begun) = (all(cpu), Instant::now());
        let hop_us = run.window(length)?;
        let cpu_percent =
            100.0 * all(cpu).saturating_sub(before) as f64 * 1e-9 / begun.elapsed().as_secs_f64();
        let memory_bytes = all(memory);
        let (top, hop_with_top_us) = std::thread::scope(|scope| {
            let pid = run.pid;
            let top = scope.spawn(move || top(pid, length));
            let hop = run.window(length);
            (top.join().unwrap_or_else(|_| Err(Failure::failed("the thread of `top` panicked"))), hop)
        });
        let (top_cpu_s, top_beyond_s) = top?;
        let start_s = run.start_s;
        run.end()?;
        let recorded = recorded(&text, count - 1, length, folder, registry)?;
        Ok(Line {
            operators: count,
            processes: processes.len(),
            start_s,
            memory_bytes,
            cpu_percent,
            hop_us,
            hop_with_top_us: hop_with_top_us?,
            top_cpu_s,
            top_beyond_s,
            recorded,
        })
    }
}

fn recorded(
    text: &str,
    hops: usize,
    length: Duration,
    folder: &Folder,
    registry: &Registry,
) -> Result<Recorded, Failure> {
    let at = folder.free("recorded")?;
    let mut run = Chain::start(text, &at, &[], hops, registry)?;
    let processes = run.program.processes();
    let recorder = processes.iter().find(|(name, _)| name == RECORDER).map(|(_, pid)| *pid);
    let recorder = recorder.ok_or_else(|| Failure::failed("the run has no recorder"))?;
    let written = || {
        let parts = run.session.as_deref().map(session_parts).and_then(Result::ok).unwrap_or_default();
        parts.iter().filter_map(|part| part.metadata().ok()).map(|m| m.len()).sum::<u64>()
    };
    let (cpu_before, bytes_before, begun) = (cpu(recorder), written(), Instant::now());
    let hop_us = run.window(length)?;
    let seconds = begun.elapsed().as_secs_f64();
    let recorded = Recorded {
        start_s: run.start_s,
        hop_us,
        recorder_cpu_percent: 100.0 * cpu(recorder).saturating_sub(cpu_before) as f64 * 1e-9 / seconds,
        recorder_memory_bytes: memory(recorder),
        bytes_per_second: written().saturating_sub(bytes_before) as f64 / seconds,
    };
    run.end()?;
    Ok(recorded)
}

/// A chain that runs.
struct Chain {
    // Ports are closed before the run ends.
    ages: Tap,
    attached: stillpoint::Attached,
    program: Program,
    pid: u32,
    session: Option<std::path::PathBuf>,
    hops: usize,
    start_s: f64,
}

impl Chain {
    /// Starts the chain and waits until a payload has come to its end.
    fn start(
        text: &str,
        folder: &std::path::Path,
        arguments: &[&str],
        hops: usize,
        registry: &Registry,
    ) -> Result<Self, Failure> {
        let begun = Instant::now();
        let mut program = Program::of(text, folder, arguments)?;
        let (attached, ages) = program.tap(registry, "sink.ages")?;
        while ages.next()?.is_none() {
            if begun.elapsed() > PATIENCE {
                return Err(Failure::failed("no payload comes to the end: choose fewer --operators"));
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let start_s = begun.elapsed().as_secs_f64();
        let (pid, session) = (attached.pid, attached.session.clone());
        Ok(Self { ages, attached, program, pid, session, hops, start_s })
    }

    /// The cost of a hop over this time.
    fn window(&self, length: Duration) -> Result<Quantiles, Failure> {
        let hops: Vec<u64> =
            ages(&self.ages, length)?.whole.iter().map(|age| age / self.hops as u64).collect();
        Ok(Quantiles::of(&hops))
    }

    fn end(self) -> Result<(), Failure> {
        let Self { ages, attached, mut program, .. } = self;
        drop((ages, attached));
        program.processes();
        program.end()
    }
}

/// CPU time of `top --once` for a window of this length, and its time beyond the window, s.
fn top(run: u32, length: Duration) -> Result<(f64, f64), Failure> {
    let begun = Instant::now();
    let mut child = Command::new(std::env::current_exe().map_err(Failure::failed)?)
        .args([COMMAND, "top", "--once", "--json", &run.to_string()])
        .args(["--for", &format!("{} s", length.as_secs())])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .map_err(Failure::failed)?;
    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    let mut taken = 0;
    let status = loop {
        taken = pid.map_or(0, cpu).max(taken);
        if let Some(status) = child.try_wait().map_err(Failure::failed)? {
            break status;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    match status.success() {
        true => Ok((taken as f64 * 1e-9, begun.elapsed().saturating_sub(length).as_secs_f64())),
        false => Err(Failure::failed(format!("`top` of a run failed: {status}"))),
    }
}

/// A chain of operators, `group` of them in a process.
fn pipeline(count: usize, group: usize) -> String {
    let every = 1_000_000 / RATE;
    let mut text = String::from("stillpoint: 1\nname: bench-scale\noperators:\n");
    let mut names = vec!["source".to_owned()];
    let _ = writeln!(text, "  source: {{ use: bench.source, every: {every} us, params: {{ words: 8 }} }}");
    for relay in 1..count - 1 {
        let name = format!("relay{relay}");
        let from = &names[relay - 1];
        let _ = writeln!(text, "  {name}: {{ use: bench.relay, inputs: {{ load: {from}.load }} }}");
        names.push(name);
    }
    let from = &names[count - 2];
    let _ = writeln!(
        text,
        "  sink: {{ use: bench.sink, inputs: {{ load: {from}.load }}, params: {{ batch: 1 }} }}"
    );
    names.push("sink".to_owned());
    text += "processes:\n";
    for (number, members) in names.chunks(group).enumerate() {
        let _ = writeln!(text, "  group{number}: {{ operators: [{}] }}", members.join(", "));
    }
    text
}

fn table(lines: &[Line]) -> String {
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:>9} {:>9} {:>7} {:>8} {:>6} {:>7} {:>7} {:>9} {:>9} {:>10}   recorded: {:>7} {:>7} {:>9} {:>8}",
        "operators",
        "processes",
        "start s",
        "MiB",
        "CPU %",
        "hop us",
        "p99",
        "with top",
        "top CPU s",
        "and beyond",
        "start s",
        "hop us",
        "rec CPU %",
        "kB/s"
    );
    for l in lines {
        let _ = writeln!(
            text,
            "{:>9} {:>9} {:>7.2} {:>8.0} {:>6.0} {:>7.1} {:>7.1} {:>9.1} {:>9.2} {:>10.2}             {:>7.2} {:>7.1} {:>9.1} {:>8.0}",
            l.operators,
            l.processes,
            l.start_s,
            mib(l.memory_bytes),
            l.cpu_percent,
            l.hop_us.p50,
            l.hop_us.p99,
            l.hop_with_top_us.p50,
            l.top_cpu_s,
            l.top_beyond_s,
            l.recorded.start_s,
            l.recorded.hop_us.p50,
            l.recorded.recorder_cpu_percent,
            l.recorded.bytes_per_second / 1e3
        );
    }
    text
}
