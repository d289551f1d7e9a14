//! Errors of every estimate against the truth: figures, charts over time, and histograms.

use serde::Serialize;

use super::tracks::{DOTS, LINE};
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::motion::{CHANNELS, Comparison, ErrorFigures, Truth, compare, unit};
use crate::numbers::{count, fixed};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{PoseRole, Recording, Signal};
use crate::source::Source;
use crate::statistics::{Histogram, for_a_line, for_dots};

/// Bins of a histogram.
const BINS: usize = 41;

#[derive(Serialize)]
struct ErrorsFigures {
    errors: Vec<ErrorFigures>,
    histograms: Vec<Binned>,
    /// Estimates that no truth of their frame is recorded for.
    without_truth: Vec<String>,
}

#[derive(Serialize)]
struct Binned {
    topic: String,
    channel: &'static str,
    unit: &'static str,
    histogram: Histogram,
}

/// An estimate beside the truth of its frame.
pub struct Compared<'r> {
    pub signal: &'r Signal,
    /// The comparison with the truth.
    pub found: Comparison,
}

/// Every estimate that has a truth: raw ones first, fused ones last.
pub fn compared<'r>(recording: &'r Recording<'_>) -> Vec<Compared<'r>> {
    let parts = [PoseRole::Raw, PoseRole::Filtered, PoseRole::Fused];
    let estimates = parts.into_iter().flat_map(|part| recording.signals_of(part));
    let with_truth = estimates.filter_map(|signal| {
        let truth = recording.truth_of(signal)?;
        let found = compare(&Truth::of(truth), signal.states.items());
        (!found.pairs.is_empty()).then_some(Compared { signal, found })
    });
    with_truth.collect()
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let compared = compared(recording);
    let errors: Vec<ErrorFigures> = compared
        .iter()
        .flat_map(|c| (0..6).filter_map(|channel| c.found.figures(&c.signal.topic, channel)))
        .collect();
    let is_compared = |s: &&Signal| compared.iter().any(|c| c.signal.topic == s.topic);
    let without_truth = recording
        .signals
        .iter()
        .filter(|s| s.part != PoseRole::Truth && !s.states.items().is_empty() && !is_compared(s))
        .map(|s| s.topic.clone())
        .collect();
    let mut histograms = Vec::new();
    let mut charts = Vec::new();
    for (channel, name) in CHANNELS.into_iter().enumerate() {
        let of_channel = || errors.iter().filter(|e| e.channel == name);
        let Some(largest) = of_channel().map(|e| e.p95 * 2.0).reduce(f64::max).filter(|l| *l > 0.0) else {
            continue;
        };
        let unit = unit(channel).0;
        charts.push(over_time(recording, &compared, channel));
        let mut series = Vec::new();
        for c in &compared {
            if c.found.offset[channel].is_none() {
                continue;
            }
            let histogram = c.found.histogram(channel, largest, BINS);
            let topic = c.signal.topic.clone();
            series.push(Series { name: topic.clone(), points: outline(&histogram), style: Style::Steps });
            histograms.push(Binned { topic, channel: name, unit, histogram });
        }
        let x = format!("error of {name}, {unit}");
        let title = format!("Histogram of errors: {name}");
        let chart = Chart { title, x, y: "share of estimates, %".into(), series };
        charts.push(Block::Chart(chart, String::new()));
    }
    let figures = ErrorsFigures { errors, histograms, without_truth };
    let mut section = Section::new("errors", "Errors", &figures)?;
    if figures.errors.is_empty() {
        return Ok(section.nothing("No estimate has a truth in its frame, so there are no errors."));
    }
    section.blocks.push(Block::Text(
            "Estimate minus truth. The truth is interpolated to the acquisition time behind the estimate. The offset is \
             the mean difference; for an estimate with six channels it is the mean rigid offset. All other figures are \
             without the offset."
                .into(),
    ));
    section.blocks.push(Block::Table(table(&figures.errors)));
    if !figures.without_truth.is_empty() {
        let sentence = format!("Without a truth: {}.", figures.without_truth.join(", "));
        section.blocks.push(Block::Text(sentence));
    }
    section.blocks.extend(charts);
    Ok(section)
}

fn outline(histogram: &Histogram) -> Vec<(f64, f64)> {
    histogram.outline().into_iter().map(|(x, share)| (x, share * 100.0)).collect()
}

fn over_time(recording: &Recording<'_>, compared: &[Compared<'_>], channel: usize) -> Block {
    let series = compared.iter().filter(|c| c.found.offset[channel].is_some()).map(|c| {
        let points: Vec<_> =
            c.found.errors(channel).map(|(time, error)| (recording.seconds(time), error)).collect();
        let name = c.signal.topic.clone();
        match c.signal.part {
            PoseRole::Raw => Series { name, points: for_dots(&points, DOTS), style: Style::Dots },
            _ => Series { name, points: for_a_line(&points, LINE), style: Style::Line },
        }
    });
    let (name, unit) = (CHANNELS[channel], unit(channel).0);
    let chart = Chart {
        title: format!("Error over time: {name}"),
        x: "time, s".into(),
        y: format!("error, {unit}"),
        series: series.collect(),
    };
    Block::Chart(chart, String::new())
}

fn table(errors: &[ErrorFigures]) -> Table {
    let columns = [
        "estimate",
        "channel",
        "estimates",
        "offset",
        "rms",
        "95 %",
        "worst",
        "claimed",
        "truth moved",
        "unit",
    ];
    let mut table = Table::new(
        "\"Claimed\" is the standard deviation that the estimate states. The claim is right if it equals \"rms\".",
        &columns,
    );
    for e in errors {
        let number = |v: f64| Cell::number(fixed(v, 3));
        table.row([
            Cell::text(&e.topic),
            Cell::text(e.channel),
            Cell::number(count(e.samples as u64)),
            number(e.offset),
            number(e.rms),
            number(e.p95),
            number(e.worst),
            number(e.claimed),
            number(e.moved),
            Cell::State(crate::page::Mood::Plain, e.unit.to_owned()),
        ]);
    }
    table
}
