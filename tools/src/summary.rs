//! What is said at the end of a run.

use std::path::Path;

use serde_json::{Value, json};
use stillpoint_pipeline::live::{Fault, RunReport};

use crate::accuracy;
use crate::exit::Failure;

/// Failures that are shown.
const MOST_FAULTS: usize = 10;

/// The report as JSON, with the session's path and the accuracy.
pub fn to_json(report: &RunReport, session: Option<&Path>) -> Result<Value, Failure> {
    let mut value = serde_json::to_value(report).map_err(Failure::failed)?;
    if let Some(session) = session {
        value["session"] = session.display().to_string().into();
        value["session_bytes"] = size_of(session).into();
        value["accuracy"] = accuracy::of_session(session).map_or(Value::Null, |a| json!(a));
    }
    Ok(value)
}

/// Prints the report for people.
pub fn print(report: &RunReport, session: Option<&Path>) {
    println!("{}: {:.1} s of session time", report.pipeline, report.seconds);
    if let Some(reason) = &report.ended_early {
        println!("ended early: {reason}");
    }
    for id in &report.swept {
        println!("swept what the dead run {id} had left");
    }
    println!();
    println!(
        "{:<12} {:>8} {:>8} {:>16} {:>16}  failures",
        "operator", "done", "Hz", "step ms p50 p99", "age ms p50 p99"
    );
    for o in &report.operators {
        let pair =
            |p: [f64; 2]| if p[0].is_finite() { format!("{:.2} {:.2}", p[0], p[1]) } else { "-".to_string() };
        let mut failures = Vec::new();
        let mut say = |n: u64, what: &str| {
            if n > 0 {
                failures.push(format!("{n} {what}"));
            }
        };
        say(o.errors, "errors");
        say(o.panics, "panics");
        say(u64::from(o.incarnations.saturating_sub(1)), "restarts");
        println!(
            "{:<12} {:>8} {:>8.1} {:>16} {:>16}  {}",
            o.operator,
            o.activations,
            o.rate_hz,
            pair(o.step_ms),
            pair(o.age_ms),
            failures.join(", ")
        );
    }
    print_faults(report);
    print_ledger(report);
    if let Some(session) = session {
        if let Some(a) = accuracy::of_session(session) {
            println!();
            println!("{a}");
        }
        print_session(report, session);
    }
}

/// What failed, each once with how often.
fn print_faults(report: &RunReport) {
    let mut counts: Vec<(&Fault, u64)> = Vec::new();
    for fault in &report.faults {
        match counts.iter_mut().find(|(seen, _)| *seen == fault) {
            Some((_, count)) => *count += 1,
            None => counts.push((fault, 1)),
        }
    }
    if !counts.is_empty() {
        println!();
    }
    for (fault, count) in counts.iter().take(MOST_FAULTS) {
        let often = if *count > 1 { format!(" ({count} times)") } else { String::new() };
        println!("failed: {}: {}{often}", fault.operator, fault.reason);
    }
    if counts.len() > MOST_FAULTS {
        println!("and {} other failures: --json lists all", counts.len() - MOST_FAULTS);
    }
}

fn print_ledger(report: &RunReport) {
    println!();
    println!(
        "{:<32} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>6}",
        "ledger: topic -> input", "sent", "received", "passed", "over", "no mem", "down", "left"
    );
    for line in &report.ledger {
        println!(
            "{:<32} {:>9} {:>9} {:>8} {:>8} {:>8} {:>8} {:>6}{}",
            format!("{} -> {}", line.topic, line.consumer),
            line.sent,
            line.received,
            line.passed,
            line.overwritten,
            line.homeless,
            line.down,
            line.left,
            if line.balances() { String::new() } else { format!("  UNEXPLAINED {}", line.unexplained) }
        );
    }
    println!("{}", if report.balanced { "the ledger balances" } else { "THE LEDGER DOES NOT BALANCE" });
}

fn print_session(report: &RunReport, session: &Path) {
    println!();
    let lost: u64 = report.recorded.iter().flat_map(|r| r.lost.values()).sum();
    let size = size_of(session) as f64 / 1e6;
    println!(
        "session {}: {size:.1} MB ({:.1} MB/s), {} parts, {} samples{}",
        session.display(),
        size / report.seconds.max(1e-9),
        report.recorded.len(),
        report.recorded.iter().map(|r| r.samples).sum::<u64>(),
        if lost > 0 { format!(", {lost} NOT KEPT") } else { String::new() }
    );
    println!("replay it: stillpoint replay {0}    (cargo run --release -- replay {0})", session.display());
}

/// Bytes of a session's files.
fn size_of(session: &Path) -> u64 {
    let parts = stillpoint_recorder::session_parts(session).unwrap_or_default();
    parts.iter().filter_map(|p| p.metadata().ok()).map(|m| m.len()).sum()
}
