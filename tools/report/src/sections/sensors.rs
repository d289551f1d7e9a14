//! The sensors that a fused estimate used, and the reasons against the others.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::ReportError;
use crate::numbers::{fixed, percent};
use crate::page::{Block, Cell, Mood, Section, Table};
use crate::source::Source;

/// Changes that are listed.
const SHOWN: usize = 60;

#[derive(Serialize)]
struct SensorsFigures {
    sensors: Vec<Sensor>,
    changes: Vec<Change>,
}

#[derive(Serialize)]
struct Sensor {
    topic: String,
    sensor: String,
    /// Part of the time in which it was used.
    used: f64,
    changes: usize,
}

#[derive(Serialize)]
struct Change {
    at_s: f64,
    topic: String,
    sensor: String,
    reason: String,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let mut by_sensor: BTreeMap<(&str, &str), Vec<(u64, bool)>> = BTreeMap::new();
    for v in &recording.verdicts {
        by_sensor.entry((&v.topic, &v.sensor)).or_default().push((v.since, v.reason == "used"));
    }
    let sensors = by_sensor.into_iter().map(|((topic, sensor), turns)| {
        let ends = turns.iter().skip(1).map(|(since, _)| *since).chain([recording.span[1]]);
        let spans = turns.iter().zip(ends).map(|((since, used), end)| (end.saturating_sub(*since), *used));
        let (mut all, mut used) = (0.0, 0.0);
        for (span, is_used) in spans {
            all += span as f64;
            used += if is_used { span as f64 } else { 0.0 };
        }
        let used = used / f64::max(all, 1.0);
        Sensor { topic: topic.to_owned(), sensor: sensor.to_owned(), used, changes: turns.len() - 1 }
    });
    let changes = recording.verdicts.iter().map(|v| Change {
        at_s: recording.seconds(v.since),
        topic: v.topic.clone(),
        sensor: v.sensor.clone(),
        reason: v.reason.clone(),
    });
    let figures = SensorsFigures { sensors: sensors.collect(), changes: changes.collect() };
    let section = Section::new("sensors", "Sensors", &figures)?;
    if figures.sensors.is_empty() {
        return Ok(section.nothing("The session has no samples of the health of sensors."));
    }
    let mut sensors = Table::new("", &["topic", "sensor", "used", "changes"]);
    for s in &figures.sensors {
        sensors.row([
            Cell::text(&s.topic),
            Cell::text(&s.sensor),
            Cell::number(percent(s.used)),
            Cell::number(s.changes.to_string()),
        ]);
    }
    let caption = match figures.changes.len().checked_sub(SHOWN) {
        None | Some(0) => "All changes of the state of sensors.".to_owned(),
        Some(more) => {
            format!("The first {SHOWN} changes of the state of sensors; --json has {more} more.")
        }
    };
    let mut changes = Table::new(caption, &["time, s", "topic", "sensor", "state from then on"]);
    for c in figures.changes.iter().take(SHOWN) {
        let mood = if c.reason == "used" { Mood::Good } else { Mood::Bad };
        changes.row([
            Cell::number(fixed(c.at_s, 3)),
            Cell::text(&c.topic),
            Cell::text(&c.sensor),
            Cell::State(mood, c.reason.clone()),
        ]);
    }
    Ok(section.with(Block::Table(sensors)).with(Block::Table(changes)))
}
