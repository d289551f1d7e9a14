//! The state as JSON: the figures of `top`, with the paths, the ledger and the log.

use std::path::Path;

use serde_json::{Value, json};
use stillpoint_pipeline::ledger::LedgerLine;
use stillpoint_pipeline::live::log::{self, LogLine};
use stillpoint_report::trace::Trace;

use crate::top::{Snapshot, words};

/// Lines of the log that are shown: the newest.
const LINES: usize = 200;

/// What changes slowly, or takes long to make.
#[derive(Clone, Debug, Default)]
pub struct Slow {
    /// The paths, the quickest of each start and end.
    pub paths: Vec<Value>,
    /// The account of every edge.
    pub ledger: Vec<LedgerLine>,
    /// The newest lines of the log.
    pub log: Vec<LogLine>,
}

impl Slow {
    /// Of a run or a session with this folder.
    pub fn of(trace: &Trace, ledger: Vec<LedgerLine>, folder: &Path) -> Self {
        let paths = trace.quickest().into_iter().map(|number| {
            let path = &trace.paths[number];
            json!({
                "path": path.path,
                "from": path.from,
                "to": path.to,
                "samples": path.samples,
                "arrived": path.arrived,
                "total_ms": path.total_ms,
                "blame": path.blame.first().map(|b| b.text()),
            })
        });
        let mut lines = log::read(folder).unwrap_or_default();
        let log = lines.split_off(lines.len().saturating_sub(LINES));
        Self { paths: paths.collect(), ledger, log }
    }
}

/// The state as JSON. `base`: session time of `t = 0`, ns.
///
/// # Errors
/// It cannot be written as JSON.
pub fn state(snapshot: &Snapshot, slow: &Slow, base: u64) -> Result<String, serde_json::Error> {
    let mut value = serde_json::to_value(snapshot)?;
    value["state"] = json!(words(snapshot));
    value["paths"] = json!(slow.paths);
    value["ledger"] = json!(slow.ledger);
    let line = |l: &LogLine| {
        let t = (l.time as f64 - base as f64) * 1e-9;
        json!({ "t": t, "level": l.level, "operator": l.operator, "message": l.message })
    };
    value["log"] = slow.log.iter().map(line).collect();
    serde_json::to_string(&value)
}
