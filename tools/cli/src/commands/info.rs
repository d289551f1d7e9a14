//! `stillpoint info`

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use stillpoint_operator::Registry;
use stillpoint_pipeline::session::{IDENTITY, INCLUDED, RUN, VARIABLES};
use stillpoint_recorder::{LEDGER_ATTACHMENT, Session};
use stillpoint_report::facts::{ending, gaps_of, layout};

use crate::exit::{Ended, Exit, print_json};
use crate::recorded::with_topics;
use stillpoint_report::numbers::started;

/// Digits of a build's hash that are shown to people.
const SHOWN_OF_BUILD: usize = 12;

/// Show the contents of a session and whether it is complete.
#[derive(Args)]
pub struct Info {
    /// The session: a folder of parts, or one file.
    session: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Info {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let session = with_topics(Session::open_any(&self.session), &self.session)?;
        let gaps = gaps_of(&session, registry);
        let ended = ending(&session);
        if self.json {
            let topics: Vec<_> = session
                .topics()
                .iter()
                .map(|t| json!({ "name": t.name, "type": t.type_name, "frame": t.frame, "samples": t.samples, "bytes": t.bytes, "layout": layout(t) }))
                .collect();
            let lost: Vec<_> = session
                .lost()
                .iter()
                .map(|l| json!({ "topic": l.topic, "incarnation": l.incarnation, "first": l.first, "count": l.count }))
                .collect();
            let ledger = session
                .attachments()
                .get(LEDGER_ATTACHMENT)
                .and_then(|a| serde_json::from_slice(&a.bytes).ok());
            print_json(&json!({
                "session": self.session.display().to_string(),
                "complete": gaps.is_empty(),
                "gaps": gaps,
                "lost": lost,
                "ended": ended,
                "unended": session.unended(),
                "topics": topics,
                "metadata": session.metadata(),
                "attachments": session.attachments().values().map(|a| json!({ "name": a.name, "bytes": a.bytes.len() })).collect::<Vec<_>>(),
                "ledger": ledger.unwrap_or(serde_json::Value::Null),
            }))?;
            return Ok(Exit::Done);
        }
        outln!("{}", self.session.display());
        for fact in facts(&session) {
            outln!("{fact}");
        }
        outln!("ended {ended}");
        for (operator, incarnation) in session.unended() {
            outln!("`{operator}`, incarnation {incarnation}: the journal stops without an end");
        }
        outln!();
        outln!("{:<28} {:>9} {:>10}  type", "topic", "samples", "MB");
        for t in session.topics() {
            let frame = t.frame.as_ref().map_or_else(String::new, |f| format!(" in {f}"));
            outln!(
                "{:<28} {:>9} {:>10.3}  {}{frame}{}",
                t.name,
                t.samples,
                t.bytes as f64 / 1e6,
                t.type_name,
                layout(t).map_or_else(String::new, |l| format!(" ({l})"))
            );
        }
        outln!();
        for a in session.attachments().values() {
            outln!("attached {:<32} {:>9} bytes", a.name, a.bytes.len());
        }
        outln!();
        for l in session.lost() {
            outln!(
                "{}, incarnation {}: {} samples lost from sequence {} on",
                l.topic,
                l.incarnation,
                l.count,
                l.first
            );
        }
        if gaps.is_empty() {
            outln!("complete: the session holds everything that a replay needs");
        } else {
            outln!("not complete:");
            for gap in &gaps {
                outln!("  {gap}");
            }
        }
        Ok(Exit::Done)
    }
}

/// The pipeline, the start time and the build, as far as the session states them.
fn facts(session: &Session) -> Vec<String> {
    let fact = |record: &str, key: &str| session.metadata().get(record)?.get(key).cloned();
    let run = |key| fact(RUN, key);
    let made = |key| fact(IDENTITY, key);
    let of = run("pipeline").map(|name| {
        let file = run("file").map_or_else(String::new, |file| format!(" of {file}"));
        let seed = run("seed").map_or_else(String::new, |seed| format!(", seed {seed}"));
        format!("pipeline {name}{file}{seed}")
    });
    let by = made("stillpoint").map(|version| {
        let build: String = made("build").unwrap_or_default().chars().take(SHOWN_OF_BUILD).collect();
        let (profile, cpu) = (made("profile").unwrap_or_default(), made("cpu").unwrap_or_default());
        format!("recorded by stillpoint {version}, {profile} build {build}, on {cpu}")
    });
    let at = started(session).map(|at| format!("started {at}"));
    let variables = session.metadata().get(VARIABLES).into_iter().flatten();
    let named =
        variables.map(|(name, value)| format!("paths of the pipeline named ${{{name}}}, which was {value}"));
    let files = session.metadata().get(INCLUDED).into_iter().flatten();
    let included = files.map(|(name, _)| format!("the pipeline included {name}, which its text holds"));
    [of, at, by].into_iter().flatten().chain(included).chain(named).collect()
}
