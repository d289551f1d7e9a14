//! How long the stages of a step took, where an operator has stages and a live run measured them.

use serde::Serialize;

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::numbers::{count, fixed, percent};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{Metrics, Recording};
use crate::source::Source;
use crate::statistics::{Spread, for_a_line, mean};

/// Stages of an operator that are drawn.
const DRAWN: usize = 5;

#[derive(Serialize)]
struct StagesFigures {
    topics: Vec<Timing>,
}

#[derive(Serialize)]
struct Timing {
    topic: String,
    stages: Vec<Lap>,
}

/// One stage, ms.
#[derive(Serialize)]
struct Lap {
    stage: String,
    time_ms: Spread,
    mean_ms: f64,
    /// Part of all stages' time.
    share: f64,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let timings = || recording.metrics.iter().filter(|m| m.is_timing && !m.values.is_empty());
    let figures = StagesFigures { topics: timings().map(timing).collect() };
    let mut section = Section::new("stages", "Stages of a step", &figures)?;
    if figures.topics.is_empty() {
        let sentence = "No operator of this session has measured stages. Only a live run measures them.";
        return Ok(section.nothing(sentence));
    }
    let mut table = Table::new(
        "Wall time by stage, measured in the live run.",
        &["topic", "stage", "measured", "p50, ms", "p90", "p99", "max", "share"],
    );
    for t in &figures.topics {
        for lap in &t.stages {
            let ms = |v: Option<f64>| Cell::number(fixed(v, 3));
            table.row([
                Cell::text(&t.topic),
                Cell::text(&lap.stage),
                Cell::number(count(lap.time_ms.count as u64)),
                ms(lap.time_ms.p50),
                ms(lap.time_ms.p90),
                ms(lap.time_ms.p99),
                ms(lap.time_ms.max),
                Cell::Bar(lap.share, percent(lap.share)),
            ]);
        }
    }
    section.blocks.push(Block::Table(table));
    section.blocks.extend(timings().map(|m| chart(recording, m)));
    Ok(section)
}

fn stage_of(metric: &str) -> String {
    metric.trim_end_matches("_s").replace('_', " ")
}

fn timing(metrics: &Metrics) -> Timing {
    let ms = |values: &[(u64, f64)]| -> Vec<f64> { values.iter().map(|(_, s)| s * 1e3).collect() };
    let means: Vec<f64> = metrics.values.iter().map(|(_, v)| mean(&ms(v.items())).unwrap_or(0.0)).collect();
    let all: f64 = means.iter().sum();
    let stages = metrics.values.iter().zip(&means).map(|((name, values), mean)| Lap {
        stage: stage_of(name),
        time_ms: Spread::of(ms(values.items())),
        mean_ms: *mean,
        share: if all > 0.0 { mean / all } else { 0.0 },
    });
    Timing { topic: metrics.topic.clone(), stages: stages.collect() }
}

/// The stages that take most of the time, over time.
fn chart(recording: &Recording<'_>, metrics: &Metrics) -> Block {
    let sum = |values: &[(u64, f64)]| values.iter().map(|(_, s)| s).filter(|s| s.is_finite()).sum::<f64>();
    let mut largest: Vec<_> = metrics.values.iter().map(|(name, v)| (sum(v.items()), name, v)).collect();
    largest.sort_by(|a, b| b.0.total_cmp(&a.0));
    let series = largest.into_iter().filter(|(sum, ..)| *sum > 0.0).take(DRAWN).map(|(_, name, values)| {
        let points: Vec<_> = values.items().iter().map(|(t, s)| (recording.seconds(*t), s * 1e3)).collect();
        Series { name: stage_of(name), points: for_a_line(&points, LINE), style: Style::Line }
    });
    let chart = Chart {
        title: format!("The longest stages of {}", metrics.topic),
        x: "time, s".into(),
        y: "time, ms".into(),
        series: series.collect(),
    };
    Block::Chart(chart, String::new())
}
