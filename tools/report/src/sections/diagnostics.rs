//! Diagnostics of operators: every named number over time.

use serde::Serialize;

use crate::ReportError;
use crate::numbers::short;
use crate::page::{Block, Cell, Section, Table};
use crate::source::Source;
use crate::statistics::{Spread, for_a_line};

/// Points of a small line.
const SPARK: usize = 120;

#[derive(Serialize)]
struct DiagnosticsFigures {
    topics: Vec<Topic>,
}

#[derive(Serialize)]
struct Topic {
    topic: String,
    metrics: Vec<Metric>,
}

#[derive(Serialize)]
struct Metric {
    name: String,
    samples: u64,
    /// Samples that are no number.
    without_number: usize,
    least: Option<f64>,
    spread: Spread,
    last: Option<f64>,
    /// (s, value), thinned.
    points: Vec<(f64, Option<f64>)>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let topics = recording.metrics.iter().filter(|m| !m.is_timing && !m.values.is_empty()).map(|m| {
        let metrics = m.values.iter().map(|(name, values)| {
            let items = values.items();
            let finite = || items.iter().map(|(_, v)| *v).filter(|v| v.is_finite());
            let points: Vec<(f64, f64)> = items.iter().map(|(t, v)| (recording.seconds(*t), *v)).collect();
            let drawn = for_a_line(&points, SPARK);
            Metric {
                name: name.clone(),
                samples: values.seen(),
                without_number: items.len() - finite().count(),
                least: finite().reduce(f64::min),
                spread: Spread::of(finite()),
                last: items.last().map(|(_, v)| *v).filter(|v| v.is_finite()),
                points: drawn.into_iter().map(|(t, v)| (t, Some(v).filter(|v| v.is_finite()))).collect(),
            }
        });
        Topic { topic: m.topic.clone(), metrics: metrics.collect() }
    });
    let figures = DiagnosticsFigures { topics: topics.collect() };
    let mut section = Section::new("diagnostics", "Diagnostics", &figures)?;
    if figures.topics.is_empty() {
        return Ok(section.nothing("The session has no diagnostics."));
    }
    let sentence = "A unit is at the end of a name: _s for seconds, _m for metres. The small line goes from the least to \
                the greatest value.";
    section.blocks.push(Block::Text(sentence.into()));
    for topic in &figures.topics {
        let columns = ["number", "least", "median", "greatest", "last", "over time"];
        let mut table = Table::new(topic.topic.clone(), &columns);
        for m in &topic.metrics {
            let points = m.points.iter().map(|(t, v)| (*t, v.unwrap_or(f64::NAN)));
            table.row([
                Cell::text(&m.name),
                Cell::number(short(m.least)),
                Cell::number(short(m.spread.p50)),
                Cell::number(short(m.spread.max)),
                Cell::number(short(m.last)),
                Cell::Spark(points.collect()),
            ]);
        }
        section.blocks.push(Block::Table(table));
    }
    Ok(section)
}
