//! `stillpoint bench pool`: the time of recorded plans with other workers and another network.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint::{Ended, Exit, Failure, print_json};
use stillpoint_pool::{Network, Outcome, Record, Simulation};

/// Compute how long recorded plans take with other numbers of workers.
///
/// A record is written by `stillpoint plan --pool ENDPOINT --pool-record FILE`, best with one worker on an idle machine and a
/// new folder of doses. Several records, or `--patients`, are patients that are planned at the same time by one host. Calls take
/// their recorded time on each worker, which has one slot and an empty cache; the clients choose workers and compare answers
/// as in a plan. Efficiency is the computation of all different calls, divided by the time and the number of workers.
#[derive(Args)]
pub struct Pool {
    /// Records of calls.
    #[arg(value_name = "RECORD", required = true)]
    records: Vec<PathBuf>,
    /// Numbers of workers.
    #[arg(long, value_delimiter = ',', default_values_t = [1, 2, 4, 8, 16, 32, 64], value_parser = super::at_least::<usize>(1))]
    workers: Vec<usize>,
    /// Patients: the records are taken in turn.
    #[arg(long, value_parser = super::at_least::<usize>(1))]
    patients: Option<usize>,
    /// Bandwidth of the link of each host in each direction, Mbit/s.
    #[arg(long, default_value_t = 1000, value_parser = super::at_least::<u64>(1))]
    mbit: u64,
    /// Time of a message from one host to another, us.
    #[arg(long, default_value_t = 1000)]
    delay: u64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Pool {
    /// Runs the simulations and prints their outcomes.
    pub fn execute(&self) -> Ended {
        let records = self.records.iter().map(|file| {
            let named = |e: &dyn std::fmt::Display| Failure::wrong(format!("{}: {e}", file.display()));
            let text = std::fs::read_to_string(file).map_err(|e| named(&e))?;
            Record::from_text(&text).map_err(|e| named(&e))
        });
        let records: Vec<Record> = records.collect::<Result<_, Failure>>()?;
        let patients: Vec<&Record> =
            records.iter().cycle().take(self.patients.unwrap_or(records.len())).collect();
        let network = Network { bits_per_s: self.mbit as f64 * 1e6, delay: self.delay.saturating_mul(1000) };
        let outcomes = self
            .workers
            .iter()
            .map(|workers| Simulation { workers: *workers, network }.run(&patients).map_err(Failure::wrong));
        let outcomes: Vec<Outcome> = outcomes.collect::<Result<_, Failure>>()?;
        if self.json {
            let recorded_s: Vec<f64> = records.iter().map(Record::seconds).collect();
            let rows: Vec<_> = outcomes.iter().map(as_json).collect();
            print_json(&json!({ "patients": patients.len(), "recorded_s": recorded_s, "outcomes": rows }))?;
            return Ok(Exit::Done);
        }
        for (file, record) in self.records.iter().zip(&records) {
            outln!(
                "{}: {} calls in {} rounds, {:.1} s of computation in {:.1} s",
                file.display(),
                record.calls.len(),
                record.rounds.len(),
                record.work_s(),
                record.seconds()
            );
        }
        outln!(
            "workers     time, s  efficiency  repeated, s  opened, s  starved, s  client, s  sent, MB  received, MB"
        );
        for outcome in &outcomes {
            let Outcome { workers, seconds, spent, between_s, sent, received, .. } = outcome;
            outln!(
                "{workers:>7} {seconds:>11.1} {:>11.2} {:>12.1} {:>10.1} {:>11.1} {between_s:>10.1} {:>9.0} {:>13.0}",
                outcome.efficiency(),
                spent.repeated_s,
                spent.opened_s,
                spent.starved_s,
                *sent as f64 * 1e-6,
                *received as f64 * 1e-6,
            );
        }
        Ok(Exit::Done)
    }
}

fn as_json(outcome: &Outcome) -> serde_json::Value {
    let Outcome { workers, seconds, work_s, spent, between_s, sent, received, tally } = outcome;
    json!({
        "workers": workers,
        "seconds": seconds,
        "efficiency": outcome.efficiency(),
        "work_s": work_s,
        "repeated_s": spent.repeated_s,
        "opened_s": spent.opened_s,
        "starved_s": spent.starved_s,
        "client_s": between_s,
        "sent_bytes": sent,
        "received_bytes": received,
        "compared": tally.compared,
        "asked_twice": tally.hedged,
    })
}
