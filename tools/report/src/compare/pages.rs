//! The page of a comparison: the table, and both runs in each chart.

use super::{Comparison, FieldDifference, TopicDifference};
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::numbers;
use crate::page::{Block, Cell, Section, Table};

/// Charts of a topic.
const MOST_CHARTS: usize = 6;

/// The sections of the page. `names` are those of the two runs.
///
/// # Errors
/// Figures cannot be written as JSON.
pub fn sections(comparison: &Comparison, names: [&str; 2]) -> Result<Vec<Section>, ReportError> {
    let mut topics = Section::new("topics", "Topics", comparison)?;
    let first = match &comparison.first {
        Some(first) => {
            let field = first.field.as_ref().map_or(String::new(), |f| format!(", {f}"));
            format!("The first difference is in {}{field}, at {:.3} s.", first.topic, first.at_s)
        }
        None if comparison.is_identical() => "Both sessions are the same, to the bit.".to_owned(),
        None => "No topic that both sessions hold differs in its values.".to_owned(),
    };
    topics = topics.with(Block::Text(first));
    if comparison.topics.iter().any(|topic| !topic.identical) {
        topics = topics.with(Block::Table(table(comparison)));
    }
    let identical: Vec<&str> =
        comparison.topics.iter().filter(|topic| topic.identical).map(|topic| topic.topic.as_str()).collect();
    if !identical.is_empty() && !comparison.is_identical() {
        topics = topics.with(Block::Text(format!("Identical to the bit: {}.", identical.join(", "))));
    }
    let mut figures = Section::new("figures", "Figures at the end", &comparison.figures)?;
    let mut values = Table::new("Figures of both runs", &["figure", names[0], names[1]]);
    for figure in &comparison.figures {
        let text = |value: Option<f64>| Cell::number(format!("{} {}", numbers::short(value), figure.unit));
        values.row([Cell::text(figure.name.clone()), text(figure.values[0]), text(figure.values[1])]);
    }
    figures = match values.rows.is_empty() {
        true => figures.nothing("neither session has figures of how a head was held"),
        false => figures.with(Block::Table(values)),
    };
    let mut charts = Section::new("charts", "Both runs", &())?;
    let changed = || comparison.topics.iter().filter(|t| !t.curves.is_empty());
    for topic in changed() {
        charts = charts.with(Block::Heading(topic.topic.clone()));
        for curves in topic.curves.iter().take(MOST_CHARTS) {
            let series = |side: usize, style: Style| Series {
                name: names[side].to_owned(),
                points: curves.points.iter().map(|(at, both)| (*at, both[side])).collect(),
                style,
            };
            let chart = Chart {
                title: format!("{} {}", topic.topic, curves.field),
                x: "session time, s".to_owned(),
                y: if curves.unit.is_empty() { curves.field.clone() } else { curves.unit.clone() },
                series: vec![series(0, Style::Line), series(1, Style::Line)],
            };
            charts = charts.with(Block::Chart(chart, caption(topic, &curves.field)));
        }
        if topic.curves.len() > MOST_CHARTS {
            let more = topic.curves.len() - MOST_CHARTS;
            charts = charts.with(Block::Text(format!("{more} more fields differ; the table has them.")));
        }
    }
    if changed().next().is_none() {
        charts = charts.nothing("no number of a topic with one set of values differs");
    }
    Ok(vec![topics, figures, charts])
}

fn caption(topic: &TopicDifference, field: &str) -> String {
    topic.fields.iter().find(|f| f.field == field).map_or(String::new(), words)
}

/// What is said of a field.
fn words(field: &FieldDifference) -> String {
    match (field.rms, field.worst, field.worst_s) {
        (Some(rms), Some(worst), Some(at)) => format!(
            "Differs from {:.3} s on: rms {} {}, at most {} at {at:.3} s.",
            field.since_s,
            numbers::short(rms),
            field.unit,
            numbers::short(worst)
        ),
        _ => format!("Differs from {:.3} s on, in {} samples.", field.since_s, field.samples),
    }
}

fn table(comparison: &Comparison) -> Table {
    let columns = ["topic", "samples", "differing", "since, s", "field", "unit", "rms", "largest", "at, s"];
    let mut table = Table::new("Topics that both sessions hold and that differ", &columns);
    for topic in comparison.topics.iter().filter(|topic| !topic.identical) {
        let lead = |state: &str| {
            [
                Cell::text(topic.topic.clone()),
                Cell::number(numbers::count(topic.pairs)),
                Cell::number(numbers::count(topic.differing)),
                Cell::number(topic.since_s.map_or("-".to_owned(), |s| format!("{s:.3}"))),
                Cell::text(state),
            ]
        };
        let none = || [(); 4].map(|()| Cell::number(""));
        if topic.fields.is_empty() {
            table.row(lead("times or number of samples").into_iter().chain(none()));
        }
        for field in &topic.fields {
            let number = |value: Option<f64>| Cell::number(value.map_or("-".to_owned(), numbers::short));
            let at = Cell::number(field.worst_s.map_or("-".to_owned(), |s| format!("{s:.3}")));
            let rest = [Cell::text(field.unit.clone()), number(field.rms), number(field.worst), at];
            table.row(lead(&field.field).into_iter().chain(rest));
        }
    }
    table
}
