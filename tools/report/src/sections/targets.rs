//! Targets, and how the estimate follows them: over time, and step by step.

use serde::Serialize;
use stillpoint_control::response::{Response, response, steps};

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::motion::{CHANNELS, unit};
use crate::numbers::fixed;
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{PoseRole, Recording, Signal, TargetTrack};
use crate::source::Source;
use crate::statistics::{Spread, for_a_line};

#[derive(Serialize)]
struct TargetsFigures {
    channels: Vec<Followed>,
    refused: Vec<Refused>,
}

/// A target that was asked for and refused.
#[derive(Serialize)]
struct Refused {
    target: String,
    at_s: f64,
    why: String,
}

/// A channel of a target and the estimate that follows it, in mm or degrees.
#[derive(Serialize)]
struct Followed {
    target: String,
    estimate: String,
    channel: &'static str,
    unit: &'static str,
    /// Root mean square of estimate minus target, over the whole session.
    rms: f64,
    /// Sizes of estimate minus target.
    distance: Spread,
    steps: Vec<Response>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let (mut channels, mut charts) = (Vec::new(), Vec::new());
    for target_track in &recording.targets {
        let Some(estimate) = followed_by(recording, target_track) else { continue };
        for channel in 0..6 {
            if let Some((figures, chart)) = follow(recording, target_track, estimate, channel) {
                channels.push(figures);
                charts.push(chart);
            }
        }
    }
    let refused = recording.targets.iter().flat_map(|target_track| {
        target_track.refusals.each.iter().map(|r| Refused {
            target: target_track.topic.clone(),
            at_s: recording.seconds(r.stamp),
            why: r.why.clone(),
        })
    });
    let figures = TargetsFigures { channels, refused: refused.collect() };
    let mut section = Section::new("targets", "Targets", &figures)?;
    if figures.channels.is_empty() && figures.refused.is_empty() {
        let sentence = "The session has no target with an estimate in its frame.";
        return Ok(section.nothing(sentence));
    }
    if !figures.refused.is_empty() {
        section.blocks.push(Block::Table(refusals(&figures.refused)));
    }
    if !figures.channels.is_empty() {
        section.blocks.push(Block::Table(following(&figures.channels)));
    }
    if figures.channels.iter().any(|c| !c.steps.is_empty()) {
        section.blocks.push(Block::Table(answers(&figures.channels)));
    }
    section.blocks.extend(charts);
    Ok(section)
}

/// The estimate that whoever follows a target takes beside it; else the one that stands last in the target's frame: fused,
/// or filtered, or raw.
fn followed_by<'r>(recording: &'r Recording<'_>, target_track: &TargetTrack) -> Option<&'r Signal> {
    let parts = [PoseRole::Fused, PoseRole::Filtered, PoseRole::Raw];
    let fits = |s: &&Signal| s.frame == target_track.frame;
    let is_followed = |s: &&Signal| {
        fits(s)
            && recording.wiring.consumers(&target_track.topic).any(|stage| stage.inputs.contains(&s.topic))
    };
    let first = |of: &dyn Fn(&&'r Signal) -> bool| {
        parts.into_iter().find_map(|part| recording.signals_of(part).find(|s| of(s)))
    };
    first(&is_followed).or_else(|| first(&fits))
}

fn follow(
    recording: &Recording<'_>,
    target_track: &TargetTrack,
    estimate: &Signal,
    channel: usize,
) -> Option<(Followed, Block)> {
    let (unit, scale) = unit(channel);
    let target: Vec<(f64, f64)> = target_track
        .values
        .items()
        .iter()
        .map(|(time, channels)| (recording.seconds(*time), channels[channel] * scale))
        .collect();
    let value: Vec<(f64, f64)> = estimate
        .states
        .items()
        .iter()
        .map(|s| (recording.seconds(s.origin), s.channels[channel] * scale))
        .collect();
    let distances: Vec<f64> = value
        .iter()
        .filter_map(|(time, v)| {
            let stood = target.partition_point(|(t, _)| t <= time).checked_sub(1)?;
            Some(v - target[stood].1).filter(|d| d.is_finite())
        })
        .collect();
    if distances.is_empty() {
        return None;
    }
    let squares: f64 = distances.iter().map(|d| d * d).sum();
    let steps = steps(&target, recording.length());
    let figures = Followed {
        target: target_track.topic.clone(),
        estimate: estimate.topic.clone(),
        channel: CHANNELS[channel],
        unit,
        rms: (squares / distances.len() as f64).sqrt(),
        distance: Spread::of(distances.iter().map(|d| d.abs())),
        steps: steps.into_iter().filter_map(|step| response(step, &value)).collect(),
    };
    let chart = Chart {
        title: format!("{} of {}", CHANNELS[channel], target_track.topic),
        x: "time, s".into(),
        y: format!("{}, {unit}", CHANNELS[channel]),
        series: vec![
            Series { name: estimate.topic.clone(), points: for_a_line(&value, LINE), style: Style::Line },
            Series {
                name: target_track.topic.clone(),
                points: for_a_line(&target, LINE),
                style: Style::Steps,
            },
        ],
    };
    Some((figures, Block::Chart(chart, String::new())))
}

fn refusals(refused: &[Refused]) -> Table {
    let mut table = Table::new("Refused targets.", &["target", "at, s", "reason"]);
    for r in refused {
        table.row([Cell::text(&r.target), Cell::number(fixed(r.at_s, 2)), Cell::text(&r.why)]);
    }
    table
}

fn following(channels: &[Followed]) -> Table {
    let columns = ["target", "estimate", "channel", "rms", "p50", "p99", "worst", "unit"];
    let mut table = Table::new("Estimate minus the target at the same time.", &columns);
    for c in channels {
        let n = |v: Option<f64>| Cell::number(fixed(v, 3));
        table.row([
            Cell::text(&c.target),
            Cell::text(&c.estimate),
            Cell::text(c.channel),
            n(Some(c.rms)),
            n(c.distance.p50),
            n(c.distance.p99),
            n(c.distance.max),
            Cell::text(c.unit),
        ]);
    }
    table
}

fn answers(channels: &[Followed]) -> Table {
    let columns =
        ["channel", "step at, s", "from", "to", "unit", "rise, s", "settling, s", "overshoot", "left", "sd"];
    let mut table = Table::new(
        "Answers to steps. Rise is from 10 % to 90 %; settled is within 5 % of the step; what is left and its standard \
         deviation are those of the last quarter.",
        &columns,
    );
    for (c, r) in channels.iter().flat_map(|c| c.steps.iter().map(move |r| (c, r))) {
        let n = |v: Option<f64>, digits| Cell::number(fixed(v, digits));
        table.row([
            Cell::text(c.channel),
            n(Some(r.step.at_s), 2),
            n(Some(r.step.from), 2),
            n(Some(r.step.to), 2),
            Cell::text(c.unit),
            n(r.rise_s, 2),
            n(r.settling_s, 2),
            n(Some(r.overshoot), 3),
            n(Some(r.left), 3),
            n(Some(r.sd), 3),
        ]);
    }
    table
}
