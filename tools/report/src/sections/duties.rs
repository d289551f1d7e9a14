//! Openings of valves over time, and how often the law asked for more than full opening.

use serde::Serialize;

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::numbers::{count, fixed, percent};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{Orders, Recording};
use crate::source::Source;
use crate::statistics::{Spread, for_a_line, mean};

/// Maximum number of valves in a chart; more lines could not be distinguished.
const IN_A_CHART: usize = 6;

#[derive(Serialize)]
struct DutiesFigures {
    topics: Vec<Topic>,
}

#[derive(Serialize)]
struct Topic {
    topic: String,
    orders: u64,
    /// Part of the orders in which the controller had nothing to act on.
    idle: f64,
    /// Part of the orders with a reason that something is out of order.
    with_reasons: f64,
    valves: Vec<Valve>,
}

#[derive(Serialize)]
struct Valve {
    valve: String,
    mean: f64,
    duty: Spread,
    /// Part of the orders in which the law asked for more than there is.
    saturated: f64,
}

/// The valve of this number: each bladder, counted from 0, has an inlet, then an outlet.
fn name(valve: usize) -> String {
    format!("bladder {} {}", valve / 2, if valve.is_multiple_of(2) { "in" } else { "out" })
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let figures = DutiesFigures { topics: recording.duties.iter().map(topic).collect() };
    let mut section = Section::new("duties", "Valve duties", &figures)?;
    if figures.topics.iter().all(|t| t.orders == 0) {
        return Ok(section.nothing("The session has no duties of valves."));
    }
    for (t, orders) in figures.topics.iter().zip(&recording.duties) {
        let sentence = format!(
            "{}: {} orders; idle in {}, with an irregularity in {}.",
            t.topic,
            count(t.orders),
            percent(t.idle),
            percent(t.with_reasons)
        );
        section.blocks.push(Block::Text(sentence));
        let mut table = Table::new("", &["valve", "mean duty", "p50", "p99", "max", "saturated"]);
        for v in &t.valves {
            let n = |v: Option<f64>| Cell::number(fixed(v, 3));
            table.row([
                Cell::text(&v.valve),
                n(Some(v.mean)),
                n(v.duty.p50),
                n(v.duty.p99),
                n(v.duty.max),
                Cell::Bar(v.saturated, percent(v.saturated)),
            ]);
        }
        section.blocks.push(Block::Table(table));
        let all: Vec<usize> = (0..orders.valves).collect();
        section.blocks.extend(all.chunks(IN_A_CHART).map(|some| chart(recording, orders, some)));
    }
    Ok(section)
}

fn topic(orders: &Orders) -> Topic {
    let items = orders.values.items();
    let part = |of: &dyn Fn(&crate::recording::Order) -> bool| {
        items.iter().filter(|o| of(o)).count() as f64 / items.len().max(1) as f64
    };
    let valves = (0..orders.valves).map(|valve| {
        let duties: Vec<f64> =
            items.iter().map(|o| f64::from(o.duty[valve])).filter(|d| d.is_finite()).collect();
        Valve {
            valve: name(valve),
            mean: mean(&duties).unwrap_or(0.0),
            duty: Spread::of(duties),
            saturated: part(&|o| o.saturated & (1 << valve) != 0),
        }
    });
    Topic {
        topic: orders.topic.clone(),
        orders: orders.values.seen(),
        idle: part(&|o| o.idle),
        with_reasons: part(&|o| o.reasons != 0),
        valves: valves.collect(),
    }
}

fn chart(recording: &Recording<'_>, orders: &Orders, valves: &[usize]) -> Block {
    let series = valves.iter().map(|valve| {
        let items = orders.values.items().iter();
        let points: Vec<_> = items.map(|o| (recording.seconds(o.stamp), f64::from(o.duty[*valve]))).collect();
        Series { name: name(*valve), points: for_a_line(&points, LINE), style: Style::Line }
    });
    let chart = Chart {
        title: format!("Duties of {}", orders.topic),
        x: "time, s".into(),
        y: "duty, part of full opening".into(),
        series: series.collect(),
    };
    Block::Chart(chart, String::new())
}
