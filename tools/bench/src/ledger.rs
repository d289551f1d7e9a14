//! `stillpoint bench ledger`: the account of every sample of a run with overflow, kills and start-up.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use clap::Args;
use rustix::process::{Signal, kill_process};
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_pipeline::ledger::LedgerLine;
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_pipeline::live::{Fault, Run};

use super::processes::{Chance, children};
use super::window::Window;
use stillpoint::{Ended, Exit, print_json};

/// A pipeline with bursts that are longer than their queues, a relay, a consumer of the latest sample, and up to 1000
/// restarts of each process.
const PIPELINE: &str = "
stillpoint: 1
name: bench-ledger
operators:
  source:  { use: bench.source, every: 100 us, params: { words: 8, burst: 8 } }
  second:  { use: bench.source, every: 150 us, params: { words: 64 } }
  relay:   { use: bench.relay, inputs: { load: { from: source.load, queue: 6 } }, params: { words: 8 } }
  relayed: { use: bench.sink, inputs: { load: { from: relay.load, queue: 16 } } }
  direct:  { use: bench.sink, inputs: { load: { from: source.load, queue: 2 } } }
  newest:  { use: bench.sink, inputs: { load: { from: source.load, latest: true } } }
  quiet:   { use: bench.sink, inputs: { load: second.load } }
processes:
  source:  { operators: [source], restart: { limit: 1000, backoff: 10 ms } }
  second:  { operators: [second], restart: { limit: 1000, backoff: 10 ms } }
  middle:  { operators: [relay, direct], restart: { limit: 1000, backoff: 10 ms } }
  sinks:   { operators: [relayed, newest, quiet], restart: { limit: 1000, backoff: 10 ms } }
";
/// Minimum time between kills, ms. In less time no process can start.
const SHORTEST_LIFE: u64 = 10;
/// Maximum length of a run.
const PATIENCE: Duration = Duration::from_secs(580);

/// Check that every sample is accounted for in a run with overflow, start-up, and `kill -9` of processes at random
/// moments.
#[derive(Args)]
pub struct Ledger {
    /// Number of samples that the sources send.
    #[arg(long, default_value_t = 1_000_000, value_parser = super::at_least::<u64>(1))]
    samples: u64,
    /// Mean time between kills, ms, at least 10; 0 for no kills.
    #[arg(long, default_value_t = 700, value_parser = kill_every)]
    kill_every: u64,
    /// A short measurement: 100,000 samples.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Result {
    seconds: f64,
    kills: u64,
    samples: u64,
    overwritten: u64,
    unexplained: u64,
    balanced: bool,
    unseen_entries: u64,
    lines: Vec<LedgerLine>,
}

/// A time between kills that is too short.
#[derive(Debug, thiserror::Error)]
#[error("it must be 0 or at least {SHORTEST_LIFE}")]
struct TooShort;

/// Parses a mean time between kills, ms.
fn kill_every(text: &str) -> std::result::Result<u64, TooShort> {
    let time = text.parse::<u64>().ok().filter(|ms| *ms == 0 || *ms >= SHORTEST_LIFE);
    time.ok_or(TooShort)
}

impl Ledger {
    /// Runs the pipeline with kills and prints the account. Fails if a sample is not accounted for.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let samples = if self.quick { 100_000 } else { self.samples };
        let (stop, kills) = (AtomicBool::new(false), AtomicU64::new(0));
        let mut count = Count { samples, stop: &stop };
        let window = Window { pipeline: PIPELINE, registry, length: PATIENCE, session: None, taps: &[] };
        let outcome = std::thread::scope(|scope| {
            if self.kill_every > 0 {
                scope.spawn(|| kill(self.kill_every, &stop, &kills));
            }
            let outcome = window.run_watched(&stop, &mut count);
            stop.store(true, Ordering::Relaxed);
            outcome
        })?;
        let lines = outcome.report.ledger;
        let total = |pick: fn(&LedgerLine) -> u64| lines.iter().map(pick).sum();
        let result = Result {
            seconds: outcome.report.seconds,
            kills: kills.into_inner(),
            samples: total(|l| l.sent),
            overwritten: total(|l| l.overwritten),
            unexplained: total(|l| l.unexplained),
            balanced: outcome.report.balanced,
            unseen_entries: outcome.report.unseen_entries,
            lines,
        };
        if self.json {
            print_json(&result)?;
        } else {
            print(&result);
        }
        Ok(if result.balanced && result.unexplained == 0 { Exit::Done } else { Exit::Failed })
    }
}

fn print(result: &Result) {
    outln!(
        "{:<12} {:<14} {:>10} {:>10} {:>11} {:>9} {:>8} {:>8} {:>12}",
        "topic",
        "consumer",
        "sent",
        "received",
        "overwritten",
        "pool_exhausted",
        "down",
        "left",
        "unexplained"
    );
    for l in &result.lines {
        outln!(
            "{:<12} {:<14} {:>10} {:>10} {:>11} {:>9} {:>8} {:>8} {:>12}",
            l.topic,
            l.consumer,
            l.sent,
            l.received,
            l.overwritten,
            l.pool_exhausted,
            l.down,
            l.left,
            l.unexplained
        );
    }
    outln!(
        "{} samples on {} edges in {:.1} s with {} kills: {} unexplained; {} journal entries not seen",
        result.samples,
        result.lines.len(),
        result.seconds,
        result.kills,
        result.unexplained,
        result.unseen_entries
    );
}

/// Stops the run when its sources have sent `samples` samples.
struct Count<'a> {
    samples: u64,
    stop: &'a AtomicBool,
}

impl Run for Count<'_> {
    fn goes_on(&mut self, _: f64, operators: &[OperatorFigures]) {
        let sources = operators.iter().filter(|o| matches!(o.operator.as_str(), "source" | "second"));
        if sources.map(|o| o.sent).sum::<u64>() >= self.samples {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
    fn failed(&mut self, _: &Fault) {}
    fn started(&mut self, _: &[(String, u32)]) {}
}

/// Kills a random worker at random intervals, `every_ms` on average, until `stop` is set. Counts the kills.
fn kill(every_ms: u64, stop: &AtomicBool, kills: &AtomicU64) {
    let mut chance = Chance::new();
    loop {
        let wait = Duration::from_micros(every_ms * 500 + chance.draw(every_ms * 1000));
        std::thread::sleep(wait);
        if stop.load(Ordering::Relaxed) {
            return;
        }
        let children = children(std::process::id());
        let Some((_, child)) = children.get(chance.draw(children.len() as u64) as usize) else { continue };
        if kill_process(*child, Signal::KILL).is_ok() {
            kills.fetch_add(1, Ordering::Relaxed);
        }
    }
}
