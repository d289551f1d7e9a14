//! `stillpoint bench replay`: repeated bit-for-bit replay of a live session, and its speed.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_pipeline::clock::cpu_time;
use stillpoint_pipeline::graph::{Graph, Record};
use stillpoint_pipeline::replay::{ReplayReport, Selection, replay};
use stillpoint_pipeline::session_recorder::SessionRecorder;
use stillpoint_recorder::{Completeness, Compression, Session};

use super::cores;
use super::figures::median;
use super::folder::Folder;
use super::window::Window;
use stillpoint::{Ended, Exit, Failure, print_json};
use stillpoint::{Nobody, opening_of};
use stillpoint_report::pipeline_of;

/// A pipeline with operators of different rates, queues that overflow, inputs that hold the newest sample, and every
/// topic recorded.
const SESSION: &str = "
stillpoint: 1
name: bench-replay
operators:
  cloud: { use: bench.cloud, every: 33 ms, params: { points: 3000 } }
  quick: { use: bench.cloud, every: 1 ms, params: { points: 16 } }
  a:     { use: bench.shift, inputs: { cloud: cloud.cloud, other: quick.cloud }, params: { points: 3000 } }
  b:     { use: bench.shift, inputs: { cloud: { from: quick.cloud, queue: 1 } }, params: { points: 16 } }
  c:     { use: bench.shift, inputs: { cloud: b.cloud, other: a.cloud }, params: { points: 16 } }
  d:     { use: bench.shift, inputs: { cloud: a.cloud, other: c.cloud }, params: { points: 3000 } }
processes: { group: [b, c] }
record: { topics: all }
";
/// A pipeline with three topics of 1.2 MB at 30 Hz. The replay recomputes and compares two of them, and writes all
/// three.
const BULK: &str = "
stillpoint: 1
name: bench-bulk
operators:
  one:   { use: bench.cloud, every: 33333 us, params: { points: 100000 } }
  two:   { use: bench.shift, inputs: { cloud: one.cloud }, params: { points: 100000 } }
  three: { use: bench.shift, inputs: { cloud: two.cloud }, params: { points: 100000 } }
record: { topics: all }
";
/// Number of consecutive replays with output. Their median is reported.
const RUNS: usize = 3;

/// Record a live session, replay it repeatedly, and compare every topic. Then record three topics of 1.2 MB at 30 Hz
/// and replay them with output on one core.
#[derive(Args)]
pub struct Replay {
    /// Length of the session, s.
    #[arg(long, default_value_t = 60, value_parser = super::at_least::<u64>(1))]
    seconds: u64,
    /// Number of replays.
    #[arg(long, default_value_t = 20, value_parser = super::at_least::<usize>(1))]
    replays: usize,
    /// Number of busy threads per core while the session is recorded.
    #[arg(long, default_value_t = 0)]
    load: usize,
    /// A pipeline to record instead of the built-in one.
    #[arg(long, value_name = "FILE")]
    pipeline: Option<PathBuf>,
    /// Folder for the sessions; they are removed when the measurement ends.
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
    /// A short measurement: 3 s, replayed twice.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Result {
    seconds: f64,
    load: usize,
    complete: bool,
    samples: u64,
    replays: usize,
    identical: usize,
    first_difference: Option<String>,
    /// Session time divided by the mean wall time of a replay without output.
    speed: f64,
    bulk: Vec<Bulk>,
}

#[derive(Serialize)]
struct Bulk {
    /// Compression of the session.
    session: Compression,
    /// Compression of the session that the replay writes.
    output: Compression,
    seconds: f64,
    bytes: u64,
    /// Session time divided by the wall time of the first replay, with output, on one core.
    first: f64,
    /// Median of the same over the replays.
    speed: f64,
    /// Median over the replays of session time divided by CPU time.
    cpu_speed: f64,
    identical: bool,
}

impl Replay {
    /// Records and replays the sessions, and prints the comparison. The exit is `Differs` if a replay is not identical.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(self.folder.as_deref())?;
        let (seconds, replays) = if self.quick { (3, 2) } else { (self.seconds, self.replays) };
        let text = match &self.pipeline {
            None => SESSION.to_string(),
            Some(path) => std::fs::read_to_string(path)
                .map_err(|e| Failure::wrong(format!("{}: {e}; name a pipeline", path.display())))?,
        };
        let path = folder.free("session")?;
        under_load(self.load, || record(&text, seconds, (&path, Compression::Lz4), registry))?;
        let (mut identical, mut samples, mut first, mut length) = (0, 0, None, 0.0);
        let begun = Instant::now();
        for _ in 0..replays {
            let report = replay_once(&path, registry, None)?;
            identical += usize::from(report.is_identical() && report.recomputed.is_empty());
            (samples, length) = (report.compared(), report.seconds);
            first = first.or(report.first_difference.map(|d| d.to_string()));
        }
        let wall = begun.elapsed().as_secs_f64() / replays as f64;
        let complete =
            Session::open(&path).map_err(Failure::failed)?.completeness() == Completeness::Complete;
        drop(folder.free("session")?);
        let result = Result {
            seconds: length,
            load: self.load,
            complete,
            samples,
            replays,
            identical,
            first_difference: first,
            speed: length / wall,
            bulk: bulk(if self.quick { 2 } else { 10 }, &folder, registry)?,
        };
        if self.json {
            print_json(&result)?;
        } else {
            print(&result);
        }
        let good = result.identical == replays && result.bulk.iter().all(|b| b.identical);
        Ok(if good { Exit::Done } else { Exit::Differs })
    }
}

fn print(r: &Result) {
    outln!(
        "{} of {} replays identical: {:.1} s live under {} spinning threads per core, {}, {} samples compared in each, \
         {:.1}x real time without output",
        r.identical,
        r.replays,
        r.seconds,
        r.load,
        if r.complete { "complete" } else { "not complete" },
        r.samples,
        r.speed
    );
    if let Some(first) = &r.first_difference {
        outln!("the first difference: {first}");
    }
    for b in &r.bulk {
        outln!(
            "three topics of 1.2 MB at 30 Hz, {} to {}: {:.1} s, {:.2} GB written again on one core at {:.1}x real time \
             (the first {:.1}x; {:.1}x in CPU time)",
            b.session,
            b.output,
            b.seconds,
            b.bytes as f64 / 1e9,
            b.speed,
            b.first,
            b.cpu_speed
        );
    }
}

fn record(
    text: &str,
    seconds: u64,
    session: (&Path, Compression),
    registry: &Registry,
) -> std::result::Result<(), Failure> {
    let length = Duration::from_secs(seconds);
    let session = Some(session);
    Window { pipeline: text, registry, length, session, taps: &[] }.run().map(drop)
}

/// Replays a session, and writes the output into a folder if one is given.
fn replay_once(
    path: &Path,
    registry: &Registry,
    output: Option<(&Path, Compression)>,
) -> std::result::Result<ReplayReport, Failure> {
    let session = Session::open(path).map_err(Failure::failed)?;
    let (graph, files) = pipeline_of(&session, registry)?;
    let graph = Arc::new(graph);
    let all = Selection::All;
    let Some((output, compression)) = output else {
        return replay(&session, &graph, &files, &all, &mut Nobody).map_err(Failure::failed);
    };
    let wide = Graph { record: Record::All, ..(*graph).clone() };
    let opening = opening_of(&session);
    let mut session_recorder =
        SessionRecorder::create(output, &wide, &opening, compression).map_err(Failure::failed)?;
    let report = replay(&session, &graph, &files, &all, &mut session_recorder).map_err(Failure::failed)?;
    session_recorder.finish(None).map_err(Failure::failed)?;
    Ok(report)
}

/// Replays two sessions with output, one with LZ4 and one uncompressed. The output is uncompressed, as is the default
/// of `replay --record`. The LZ4 session is replayed into an LZ4 output, too.
fn bulk(seconds: u64, folder: &Folder, registry: &Registry) -> std::result::Result<Vec<Bulk>, Failure> {
    let mut found = Vec::new();
    let (none, lz4) = (Compression::None, Compression::Lz4);
    for (session, outputs) in [(lz4, &[none, lz4][..]), (none, &[none])] {
        let path = folder.free("bulk")?;
        record(BULK, seconds, (&path, session), registry)?;
        for output in outputs {
            found.push(written(&path, session, *output, folder, registry)?);
        }
    }
    Ok(found)
}

/// Replays a session with output three times in a row. The first replay may be slower: a virtual machine that returns
/// free memory to its host must request every page of the output again.
fn written(
    path: &Path,
    session: Compression,
    output: Compression,
    folder: &Folder,
    registry: &Registry,
) -> std::result::Result<Bulk, Failure> {
    let all = cores::cores()?;
    cores::bind(&all[all.len().saturating_sub(1)..])?;
    let (mut speeds, mut cpu_speeds, mut identical) = (Vec::new(), Vec::new(), true);
    let (mut bytes, mut seconds) = (0, 0.0);
    for _ in 0..RUNS {
        let into = folder.free("again")?;
        let (begun, cpu) = (Instant::now(), cpu_time());
        let report = replay_once(path, registry, Some((&into, output)))?;
        speeds.push(report.seconds / begun.elapsed().as_secs_f64());
        cpu_speeds.push(report.seconds / ((cpu_time() - cpu) as f64 / 1e9));
        identical &= report.is_identical();
        seconds = report.seconds;
        let parts = stillpoint_recorder::session_parts(&into).map_err(Failure::failed)?;
        bytes = parts.iter().filter_map(|p| p.metadata().ok()).map(|m| m.len()).sum();
    }
    cores::bind(&all)?;
    Ok(Bulk {
        session,
        output,
        seconds,
        bytes,
        first: speeds.first().copied().unwrap_or_default(),
        speed: median(&speeds),
        cpu_speed: median(&cpu_speeds),
        identical,
    })
}

/// Executes `work` while `per_core` threads per core spin.
fn under_load<T>(per_core: usize, work: impl FnOnce() -> T) -> T {
    let threads = per_core * std::thread::available_parallelism().map_or(1, usize::from);
    let over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while !over.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        let done = work();
        over.store(true, Ordering::Relaxed);
        done
    })
}
