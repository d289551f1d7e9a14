//! How well frames fit the reference surface of a dense tracker, and which directions the surface did not constrain.

use serde::Serialize;
use stillpoint_samples::PoseStatus;

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::numbers::{count, fixed, percent};
use crate::page::{Block, Cell, Mood, Section, Table};
use crate::recording::{Alignments, Fit, Recording};
use crate::rows::UNKNOWN_STATUS;
use crate::source::Source;
use crate::statistics::{Spread, for_a_line};

#[derive(Serialize)]
struct AlignmentFigures {
    trackers: Vec<Tracker>,
}

#[derive(Serialize)]
struct Tracker {
    topic: String,
    frames: u64,
    /// No frame became a reference.
    uncaptured: bool,
    statuses: Vec<(&'static str, u64)>,
    /// Frames in which at least one direction was refused.
    with_refused_directions: u64,
    residual_mm: Spread,
    overlap: Spread,
    iterations: Spread,
    points: Spread,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let figures = AlignmentFigures { trackers: recording.alignments.iter().map(tracker).collect() };
    let mut section = Section::new("alignment", "Fit to the reference surface", &figures)?;
    if figures.trackers.is_empty() {
        return Ok(section.nothing("The session has no reports of a pose estimate."));
    }
    for t in &figures.trackers {
        let mut table = Table::new(t.topic.clone(), &["status of a frame", "frames", "fraction"]);
        for (name, frames) in &t.statuses {
            let is_good = matches!(*name, "captured" | "tracked" | "found");
            let mood = if is_good { Mood::Plain } else { Mood::Bad };
            table.row([
                Cell::State(mood, (*name).to_owned()),
                Cell::number(count(*frames)),
                Cell::number(percent(*frames as f64 / t.frames.max(1) as f64)),
            ]);
        }
        section.blocks.push(Block::Table(table));
        if t.uncaptured {
            section.blocks.push(Block::Warning(format!(
                "{}: no reference was captured in the whole session, so no frame has a pose.",
                t.topic
            )));
            continue;
        }
        let mut table = Table::new("Frames with a fit", &["quantity", "p50", "p99", "max"]);
        for (name, s, digits) in [
            ("residual, mm", &t.residual_mm, 3),
            ("overlap, part", &t.overlap, 3),
            ("iterations", &t.iterations, 0),
            ("points", &t.points, 0),
        ] {
            let n = |v: Option<f64>| Cell::number(fixed(v, digits));
            table.row([Cell::text(name), n(s.p50), n(s.p99), n(s.max)]);
        }
        section.blocks.push(Block::Table(table));
        if t.with_refused_directions > 0 {
            section.blocks.push(Block::Warning(format!(
                "In {} frames the surface did not constrain all six directions.",
                count(t.with_refused_directions)
            )));
        }
    }
    for a in recording.alignments.iter().filter(|a| !a.fits.items().is_empty()) {
        section.blocks.push(chart(recording, a, "Residual", "mm", |f| f.residual * 1e3));
        section.blocks.push(chart(recording, a, "Overlap", "part", |f| f.overlap));
    }
    Ok(section)
}

fn tracker(a: &Alignments) -> Tracker {
    let known = PoseStatus::ALL.iter().map(|(name, status)| (*name, *status as usize));
    let names = known.chain([("unknown", UNKNOWN_STATUS)]);
    let spread = |of: fn(&Fit) -> f64| Spread::of(a.fits.items().iter().map(of));
    Tracker {
        topic: a.topic.clone(),
        frames: a.statuses.iter().sum(),
        uncaptured: a.is_uncaptured(),
        statuses: names.map(|(name, at)| (name, a.statuses[at])).filter(|(_, n)| *n > 0).collect(),
        with_refused_directions: a.refused[1..].iter().sum(),
        residual_mm: spread(|f| f.residual * 1e3),
        overlap: spread(|f| f.overlap),
        iterations: spread(|f| f64::from(f.iterations)),
        points: spread(|f| f64::from(f.points)),
    }
}

fn chart(recording: &Recording<'_>, a: &Alignments, what: &str, unit: &str, of: fn(&Fit) -> f64) -> Block {
    let points: Vec<_> = a.fits.items().iter().map(|f| (recording.seconds(f.origin), of(f))).collect();
    let name = what.to_lowercase();
    let y = format!("{name}, {unit}");
    let series = vec![Series { name, points: for_a_line(&points, LINE), style: Style::Line }];
    let title = format!("{what} of {}", a.topic);
    Block::Chart(Chart { title, x: "time, s".into(), y, series }, String::new())
}
