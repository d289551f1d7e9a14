//! `stillpoint ps`

use clap::Args;
use serde::Serialize;
use serde_json::json;
use stillpoint_pipeline::live::run_folder::{self, RunState};

use crate::columns::{Columns, Side};
use crate::exit::{Ended, Exit, Failure, print_json};
use crate::processes::{self, ProcessState};

/// List the runs of this user on this machine: pipeline, age, state and session.
#[derive(Args)]
pub struct Ps {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Row {
    /// PID of the supervisor; none before the run has begun.
    run: Option<u32>,
    pipeline: Option<String>,
    /// Seconds since the run's folder was made.
    age_s: f64,
    state: &'static str,
    session: Option<String>,
    /// Its processes, with the scheduling class that each is granted.
    processes: Vec<ProcessState>,
    /// Name of the run's folder.
    id: String,
}

impl Ps {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        let rows: Vec<Row> = run_folder::all()
            .map_err(Failure::failed)?
            .into_iter()
            .map(|run| Row {
                run: run.card.as_ref().map(|c| c.pid),
                pipeline: run.card.as_ref().map(|c| c.pipeline.clone()),
                age_s: run.age.as_secs_f64(),
                state: word(run.state),
                processes: run.card.as_ref().map_or_else(Vec::new, |c| processes::of_run(c.pid)),
                session: run.card.and_then(|c| c.session).map(|s| s.display().to_string()),
                id: run.id,
            })
            .collect();
        if self.json {
            print_json(&json!({ "runs": rows }))?;
            return Ok(Exit::Done);
        }
        if rows.is_empty() {
            outln!("no pipeline is running");
            return Ok(Exit::Done);
        }
        let head = [
            (Side::Right, "run"),
            (Side::Left, "pipeline"),
            (Side::Right, "age"),
            (Side::Left, "state"),
            (Side::Left, "real-time"),
            (Side::Left, "session"),
        ];
        let mut table = Columns::new(head);
        for row in rows {
            table.row([
                row.run.map_or("-".to_owned(), |pid| pid.to_string()),
                row.pipeline.unwrap_or_else(|| "-".to_owned()),
                age(row.age_s),
                row.state.to_owned(),
                real_time(&row.processes),
                row.session.unwrap_or_else(|| "not recorded".to_owned()),
            ]);
        }
        out!("{table}");
        Ok(Exit::Done)
    }
}

fn word(state: RunState) -> &'static str {
    match state {
        RunState::Starting => "starting",
        RunState::Running => "running",
        RunState::Suspended => "suspended",
        RunState::Dead => "dead",
    }
}

/// The processes that are granted a real-time priority.
fn real_time(processes: &[ProcessState]) -> String {
    let granted = processes.iter().filter(|p| p.granted != "normal");
    let said: Vec<String> = granted.map(|p| format!("{} {}", p.name, p.granted)).collect();
    if said.is_empty() { "no".to_owned() } else { said.join(", ") }
}

/// An age, as people read it.
fn age(seconds: f64) -> String {
    let s = seconds as u64;
    match s {
        0..60 => format!("{seconds:.1} s"),
        60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        _ => format!("{} h {:02} min", s / 3600, s % 3600 / 60),
    }
}
