//! `stillpoint bench killed`: the part of a session that survives the kill of its recorder.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use clap::Args;
use rustix::process::{Pid, Signal, kill_process};
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_pipeline::clock::realtime;
use stillpoint_pipeline::live::status::OperatorFigures;
use stillpoint_pipeline::live::{Fault, Run};
use stillpoint_recorder::{Compression, Session, recover_session, session_parts};

use super::figures::median;
use super::folder::Folder;
use super::processes::Chance;
use super::window::Window;
use stillpoint::{Ended, Exit, Failure, print_json};

/// A pipeline with frequent small samples, occasional larger samples, and a computed topic. Its data rate is so low
/// that every chunk is flushed by time before it is full. In this case a kill loses most.
const PIPELINE: &str = "
stillpoint: 1
name: bench-killed
operators:
  often: { use: bench.source, every: 2 ms, params: { words: 64 } }
  large: { use: bench.source, every: 40 ms, params: { words: 400 } }
  relay: { use: bench.relay, inputs: { load: often.load }, params: { words: 64 } }
record: { topics: all }
";
/// Maximum time before a kill whose samples may be lost, ms.
const LIMIT_MS: f64 = 1000.0;
/// The latest moment of a kill, counted from the run's beginning, ms.
const LATEST_MS: u64 = 2500;
/// Time that the next recorder has before the run ends.
const AFTER: Duration = Duration::from_millis(300);
/// Maximum length of a run.
const PATIENCE: Duration = Duration::from_secs(120);

/// Kill the recorder of a live run at a random moment, repeatedly. Report from the session how long before the kill
/// each topic ends, whether any sample before that is missing, and whether the MCAP library opens the repaired part.
#[derive(Args)]
pub struct Killed {
    /// Number of kills, each in a separate run.
    #[arg(long, default_value_t = 100, value_parser = super::at_least::<usize>(1))]
    kills: usize,
    /// Folder for the sessions; they are removed when the measurement ends.
    #[arg(long, value_name = "FOLDER")]
    folder: Option<std::path::PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// State of a session after one kill.
struct Left {
    /// Time from the end of the journal that ends first to the kill, ms.
    lost_ms: f64,
    /// Whether every topic has all its samples before its end.
    whole: bool,
    /// Whether the reader of the MCAP library finds every message.
    opens: bool,
}

#[derive(Serialize)]
struct Outcome {
    kills: usize,
    /// Number of kills that lost at most the last second, left no gap before it, and left a part that the MCAP library
    /// opens.
    #[serde(rename = "kept")]
    retained: usize,
    whole: usize,
    opens: usize,
    median_lost_ms: f64,
    most_lost_ms: f64,
}

impl Killed {
    /// Runs the kills and prints their losses. Fails if a kill lost more than permitted.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(self.folder.as_deref())?;
        let mut chance = Chance::new();
        let all = (0..self.kills)
            .map(|_| kill(&folder.free("session")?, &mut chance, registry))
            .collect::<Result<Vec<Left>, Failure>>()?;
        let lost: Vec<f64> = all.iter().map(|l| l.lost_ms).collect();
        let outcome = Outcome {
            kills: all.len(),
            retained: all.iter().filter(|l| l.lost_ms <= LIMIT_MS && l.whole && l.opens).count(),
            whole: all.iter().filter(|l| l.whole).count(),
            opens: all.iter().filter(|l| l.opens).count(),
            median_lost_ms: median(&lost),
            most_lost_ms: lost.iter().copied().fold(0.0, f64::max),
        };
        if self.json {
            print_json(&outcome)?;
        } else {
            outln!(
                "{} of {} kills took at most the last second: {:.0} ms in the median, {:.0} ms at most; \
                 {} whole before that, {} open in the format's own reader",
                outcome.retained,
                outcome.kills,
                outcome.median_lost_ms,
                outcome.most_lost_ms,
                outcome.whole,
                outcome.opens
            );
        }
        Ok(if outcome.retained == outcome.kills { Exit::Done } else { Exit::Failed })
    }
}

/// Sends the process number of the recorder when the run has started.
struct Begun(Sender<Pid>);

impl Run for Begun {
    fn goes_on(&mut self, _: f64, _: &[OperatorFigures]) {}
    fn failed(&mut self, _: &Fault) {}
    fn started(&mut self, processes: &[(String, u32)]) {
        let recorder = processes.iter().find(|(name, _)| name == "recorder");
        if let Some(pid) = recorder.and_then(|(_, number)| Pid::from_raw(*number as i32)) {
            let _ = self.0.send(pid);
        }
    }
}

/// Runs the pipeline once, kills its recorder, and examines the session.
fn kill(session: &Path, chance: &mut Chance, registry: &Registry) -> Result<Left, Failure> {
    let moment = Duration::from_millis(chance.draw(LATEST_MS));
    let stop = AtomicBool::new(false);
    let window = Window {
        pipeline: PIPELINE,
        registry,
        length: PATIENCE,
        session: Some((session, Compression::Lz4)),
        taps: &[],
    };
    let (begun, begins) = channel();
    let struck = std::thread::scope(|scope| {
        let over = &stop;
        let striker = scope.spawn(move || {
            let struck = strike(&begins, moment);
            over.store(true, Ordering::Relaxed);
            struck
        });
        let outcome = window.run_watched(&stop, &mut Begun(begun));
        let struck = striker.join().unwrap_or_else(|_| Err(Failure::failed("the striker panicked")));
        outcome.and(struck)
    })?;
    // `stillpoint run` recovers the session at its end, too.
    recover_session(session).map_err(Failure::failed)?;
    let parts = session_parts(session).map_err(Failure::failed)?;
    let first = parts.first().ok_or_else(|| Failure::failed("the session has no part"))?;
    let retained = Session::open(first).map_err(Failure::failed)?;
    let mut left = Left { lost_ms: 0.0, whole: true, opens: opens(first)? };
    for entries in retained.journals().values() {
        let last = entries.last().map_or(0, |e| e.header.stamp);
        left.lost_ms = left.lost_ms.max(struck.saturating_sub(last) as f64 / 1e6);
    }
    for topic in 0..retained.topics().len() {
        left.whole &= retained.numbers(topic).zip(0..).all(|((_, sequence), due)| sequence == due);
    }
    Ok(left)
}

/// Kills the recorder `moment` after the run has begun. Gives the time of the kill, ns since the epoch.
fn strike(begins: &Receiver<Pid>, moment: Duration) -> Result<u64, Failure> {
    let recorder = begins.recv().map_err(|_| Failure::failed("the run did not begin"))?;
    std::thread::sleep(moment);
    let struck = realtime();
    kill_process(recorder, Signal::KILL).map_err(Failure::failed)?;
    std::thread::sleep(AFTER);
    Ok(struck)
}

/// Whether the reader of the MCAP library finds every message that the summary of the part counts.
fn opens(part: &Path) -> Result<bool, Failure> {
    let bytes = std::fs::read(part).map_err(Failure::failed)?;
    let counted = mcap::Summary::read(&bytes).ok().flatten().and_then(|s| s.stats).map(|s| s.message_count);
    let found = mcap::MessageStream::new(&bytes).map_or(0, |all| all.take_while(Result::is_ok).count());
    Ok(counted == Some(found as u64))
}
