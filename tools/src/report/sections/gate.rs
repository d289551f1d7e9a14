//! The gate of the beam: when it was open, and what kept it shut.

use serde::Serialize;
use stillpoint_samples::GateReason;

use super::tracks::LINE;
use crate::chart::{Chart, Series, Style};
use crate::exit::Failure;
use crate::report::numbers::{count, fixed, percent};
use crate::report::page::{Block, Cell, Section, Table};
use crate::report::recording::{Gates, Recording};
use crate::report::source::Source;
use crate::report::statistics::for_a_line;

#[derive(Serialize)]
struct Figures {
    gates: Vec<Figured>,
}

#[derive(Serialize)]
struct Figured {
    topic: String,
    /// Part of the time watched in which the beam was allowed, as the gate counts it.
    open: Option<f64>,
    open_s: f64,
    watched_s: f64,
    leases: u64,
    /// Part of the samples that name a reason against the beam.
    reasons: Vec<(&'static str, f64)>,
}

pub fn section(from: &Source<'_>) -> Result<Section, Failure> {
    let recording = &from.recording;
    let gates = || recording.gates.iter().filter(|g| !g.values.items().is_empty());
    let figures = Figures { gates: gates().map(figured).collect() };
    let mut section = Section::new("gate", "Beam gate", &figures)?;
    if figures.gates.is_empty() {
        return Ok(section.nothing("The session has no gate of a beam."));
    }
    for (gate, rows) in figures.gates.iter().zip(gates()) {
        section.blocks.push(Block::Text(format!(
            "{}: the beam was allowed for {} s of {} s ({}), in {} leases.",
            gate.topic,
            fixed(gate.open_s, 2),
            fixed(gate.watched_s, 2),
            percent(gate.open),
            count(gate.leases)
        )));
        let mut table = Table::new("", &["reason against the beam", "part of the samples"]);
        for (reason, part) in &gate.reasons {
            table.row([Cell::text(*reason), Cell::Bar(*part, percent(*part))]);
        }
        section.blocks.push(Block::Table(table));
        section.blocks.push(chart(recording, rows));
    }
    Ok(section)
}

fn figured(gates: &Gates) -> Figured {
    let items = gates.values.items();
    let part =
        |bit: u32| items.iter().filter(|(_, _, r)| r & bit != 0).count() as f64 / items.len().max(1) as f64;
    let [leases, on, watched] = gates.totals;
    Figured {
        topic: gates.topic.clone(),
        open: (watched > 0).then(|| on as f64 / watched as f64),
        open_s: on as f64 * 1e-9,
        watched_s: watched as f64 * 1e-9,
        leases,
        reasons: GateReason::ALL
            .iter()
            .map(|(word, bit)| (*word, part(*bit)))
            .filter(|(_, p)| *p > 0.0)
            .collect(),
    }
}

fn chart(recording: &Recording<'_>, gates: &Gates) -> Block {
    let items = gates.values.items().iter();
    let points: Vec<_> = items.map(|(t, on, _)| (recording.seconds(*t), f64::from(u8::from(*on)))).collect();
    let name = "beam allowed".to_owned();
    let series = vec![Series { name, points: for_a_line(&points, LINE), style: Style::Steps }];
    let chart = Chart { title: gates.topic.clone(), x: "time, s".into(), y: "1: allowed".into(), series };
    Block::Chart(chart, String::new())
}
