//! A snapshot as tables of text.

use std::fmt::Write;

use super::snapshot::{OperatorRow, Snapshot};
use crate::columns::{Columns, Side};

/// A number with this number of decimals; a missing one is `-`.
pub fn number(value: impl Into<Option<f64>>, digits: usize) -> String {
    value.into().filter(|v| v.is_finite()).map_or("-".to_owned(), |v| format!("{v:.digits$}"))
}

/// Bytes in MB.
pub fn megabytes(bytes: Option<u64>) -> String {
    bytes.map_or("-".to_owned(), |b| format!("{:.0}", b as f64 * 1e-6))
}

/// What a row of an operator says besides its name: heading and text.
pub fn cells(o: &OperatorRow) -> [(&'static str, String); 12] {
    let f = &o.figures;
    [
        ("state", o.state.to_owned()),
        ("Hz", number(f.rate_hz, 1)),
        ("step p50 ms", number(f.step_ms[0], 2)),
        ("step p99 ms", number(f.step_ms[1], 2)),
        ("age p50 ms", number(f.age_ms[0], 1)),
        ("missed", f.missed.to_string()),
        ("lost", f.lost.to_string()),
        ("failed", (f.errors + f.panics).to_string()),
        ("restarts", o.restarts.to_string()),
        ("CPU %", number(o.cpu_percent, 0)),
        ("MB", megabytes(o.memory_bytes)),
        ("process", o.process.clone()),
    ]
}

/// The lines above the tables: safety, what was found, what is wrong.
pub fn words(snapshot: &Snapshot) -> Vec<String> {
    let mut lines: Vec<String> = snapshot.held.iter().flat_map(stillpoint_report::hold::Held::now).collect();
    lines.extend(snapshot.found.iter().cloned());
    lines.extend(snapshot.changed.iter().map(|row| format!("changed: {}", row.text())));
    if let Some(recorder) = &snapshot.recorder {
        let free = recorder.free_bytes.map_or(String::new(), |b| format!(", {:.1} GB free", b as f64 * 1e-9));
        lines.push(format!("session {}: {:.1} MB{free}", recorder.session, recorder.bytes as f64 * 1e-6));
    }
    lines
}

/// The snapshot as text.
pub fn plain(snapshot: &Snapshot) -> String {
    let mut out = format!("{}, over {:.1} s\n", snapshot.pipeline, snapshot.seconds);
    for line in words(snapshot) {
        let _ = writeln!(out, "{line}");
    }
    for trouble in &snapshot.troubles {
        let _ = writeln!(out, "TROUBLE: {trouble}");
    }
    let headings = snapshot.operators.first().map(|o| cells(o).map(|(name, _)| name)).unwrap_or_default();
    let right = headings
        .map(|name| (if name == "state" || name == "process" { Side::Left } else { Side::Right }, name));
    let mut table = Columns::new([(Side::Left, "operator")].into_iter().chain(right));
    for o in &snapshot.operators {
        table.row(std::iter::once(o.operator.clone()).chain(cells(o).map(|(_, text)| text)));
    }
    let _ = write!(out, "\n{table}");
    let right = ["Hz", "latency p50 ms", "p99", "age p50 ms", "taken", "passed", "lost"];
    let head = [(Side::Left, "edge")].into_iter().chain(right.map(|name| (Side::Right, name)));
    let mut table = Columns::new(head);
    for e in snapshot.edges.iter().filter(|e| e.taken + e.lost > 0) {
        table.row([
            format!("{} -> {}", e.topic, e.to),
            number(e.rate_hz, 1),
            number(e.latency_ms.p50, 2),
            number(e.latency_ms.p99, 2),
            number(e.age_ms.p50, 1),
            e.taken.to_string(),
            e.passed.to_string(),
            e.lost.to_string(),
        ]);
    }
    let _ = write!(out, "\n{table}");
    if !snapshot.processes.is_empty() {
        let head = [
            (Side::Left, "process"),
            (Side::Right, "PID"),
            (Side::Right, "CPU %"),
            (Side::Right, "without a core %"),
            (Side::Right, "MB"),
            (Side::Left, "priority"),
            (Side::Left, "cores"),
        ];
        let mut table = Columns::new(head);
        for p in &snapshot.processes {
            table.row([
                p.state.name.clone(),
                p.state.pid.to_string(),
                number(p.cpu_percent, 0),
                number(p.delayed_percent, 1),
                megabytes(Some(p.state.memory_bytes)),
                p.state.granted.clone(),
                p.state.cores.clone(),
            ]);
        }
        let _ = write!(out, "\n{table}");
    }
    out
}
