//! `stillpoint stop`

use std::time::{Duration, Instant};

use clap::Args;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use stillpoint_pipeline::live::run_folder::is_going_on;

use crate::attach::Which;
use crate::exit::{Ended, Exit, Failure, print_json};

/// Time within which a run ends: its levels and its recorder have 10 s each.
const PATIENCE: Duration = Duration::from_secs(120);
/// Interval at which the run is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// End a run in order, as Ctrl-C does, and wait until it has ended.
#[derive(Args)]
pub struct Stop {
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    which: Which,
}

impl Stop {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let card = self.which.card()?;
        let folder = card.root.parent().map(std::path::Path::to_path_buf).unwrap_or_default();
        let pid = i32::try_from(card.pid).ok().and_then(Pid::from_raw);
        let pid =
            pid.ok_or_else(|| Failure::failed(format!("run {}: this is not a process number", card.pid)))?;
        let begun = Instant::now();
        kill_process(pid, Signal::INT)
            .map_err(|e| Failure::failed(format!("run {} cannot be ended: {e}", card.pid)))?;
        while is_going_on(&folder) {
            if begun.elapsed() > PATIENCE {
                return Err(Failure::failed(format!(
                    "run {} ({}) was asked to end and still runs after {} s; `stillpoint ps` shows its state",
                    card.pid,
                    card.pipeline,
                    PATIENCE.as_secs()
                )));
            }
            std::thread::sleep(LOOK);
        }
        let session = card.session.map(|s| s.display().to_string());
        if self.json {
            let seconds = begun.elapsed().as_secs_f64();
            print_json(
                &json!({ "run": card.pid, "pipeline": card.pipeline, "session": session, "seconds": seconds }),
            )?;
        } else {
            let session = session.map_or_else(String::new, |s| format!("; its session is {s}"));
            outln!("run {} ({}) has ended{session}", card.pid, card.pipeline);
        }
        Ok(Exit::Done)
    }
}
