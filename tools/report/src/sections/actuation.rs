//! Pressures in bladders, and the states of actuation and of the rig.

use serde::Serialize;

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::far_end::{FarEnd, FarEnds};
use crate::numbers::{count, fixed};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{Pressures, Recording};
use crate::source::Source;
use crate::statistics::{Spread, for_a_line};

/// Changes that are listed.
const SHOWN: usize = 60;

#[derive(Serialize)]
struct ActuationFigures {
    bladders: Vec<Bladder>,
    changes: Vec<Change>,
    /// The figures of the far ends.
    far_ends: Vec<FarEnd>,
}

/// Pressure over the room, kPa.
#[derive(Serialize)]
struct Bladder {
    topic: String,
    /// Counted from 0, as in the parameters of a rig.
    bladder: usize,
    pressure_kpa: Spread,
    least_kpa: Option<f64>,
}

#[derive(Serialize)]
struct Change {
    at_s: f64,
    topic: String,
    state: String,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let changes = recording.states.iter().map(|v| Change {
        at_s: recording.seconds(v.since),
        topic: v.topic.clone(),
        state: v.reason.clone(),
    });
    let figures = ActuationFigures {
        bladders: recording.pressures.iter().flat_map(bladders).collect(),
        changes: changes.collect(),
        far_ends: recording.far_ends.iter().filter_map(FarEnds::reported).collect(),
    };
    let mut section = Section::new("actuation", "Pressures and actuation", &figures)?;
    if figures.bladders.is_empty() && figures.changes.is_empty() {
        return Ok(section.nothing("The session has no pressures of bladders and no state of actuation."));
    }
    let columns = ["topic", "bladder", "least, kPa", "median", "99 %", "greatest"];
    let mut table = Table::new("Pressure above ambient.", &columns);
    for b in &figures.bladders {
        let n = |v: Option<f64>| Cell::number(fixed(v, 3));
        table.row([
            Cell::text(&b.topic),
            Cell::number(b.bladder.to_string()),
            n(b.least_kpa),
            n(b.pressure_kpa.p50),
            n(b.pressure_kpa.p99),
            n(b.pressure_kpa.max),
        ]);
    }
    section.blocks.push(Block::Table(table));
    section.blocks.extend(recording.pressures.iter().filter(|p| p.bladders > 0).map(|p| chart(recording, p)));
    if !figures.far_ends.is_empty() {
        section.blocks.push(Block::Table(datagrams(&figures.far_ends)));
    }
    let caption = match figures.changes.len().checked_sub(SHOWN) {
        None | Some(0) => "All changes of state.".to_owned(),
        Some(more) => format!("The first {SHOWN} changes of state; --json has {more} more."),
    };
    let mut table = Table::new(caption, &["time, s", "topic", "state and reasons"]);
    for c in figures.changes.iter().take(SHOWN) {
        table.row([Cell::number(fixed(c.at_s, 3)), Cell::text(&c.topic), Cell::text(&c.state)]);
    }
    Ok(section.with(Block::Table(table)))
}

fn datagrams(far_ends: &[FarEnd]) -> Table {
    let columns =
        ["far end", "at the end", "accepted", "refused", "refused, beam", "missing", "reasons of refusals"];
    let mut table = Table::new("Datagrams at the far end.", &columns);
    for far in far_ends {
        table.row([
            Cell::text(&far.topic),
            Cell::text(far.doing),
            Cell::number(count(far.accepted)),
            Cell::fault(far.refused),
            Cell::fault(far.refused_beam),
            Cell::number(count(far.missing)),
            Cell::text(far.why()),
        ]);
    }
    table
}

fn bladders(p: &Pressures) -> impl Iterator<Item = Bladder> {
    (0..p.bladders).map(|bladder| {
        let values = || p.values.items().iter().map(|(_, all)| f64::from(all[bladder]) * 1e-3);
        Bladder {
            topic: p.topic.clone(),
            bladder,
            pressure_kpa: Spread::of(values()),
            least_kpa: values().filter(|v| v.is_finite()).reduce(f64::min),
        }
    })
}

fn chart(recording: &Recording<'_>, p: &Pressures) -> Block {
    let series = (0..p.bladders).map(|bladder| {
        let items = p.values.items().iter();
        let points: Vec<_> =
            items.map(|(t, all)| (recording.seconds(*t), f64::from(all[bladder]) * 1e-3)).collect();
        let name = format!("bladder {bladder}");
        Series { name, points: for_a_line(&points, LINE), style: Style::Line }
    });
    let chart = Chart {
        title: format!("Pressures of {}", p.topic),
        x: "time, s".into(),
        y: "pressure, kPa".into(),
        series: series.collect(),
    };
    Block::Chart(chart, String::new())
}
