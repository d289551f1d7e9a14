//! Raw, filtered and fused tracks against the truth, channel by channel.

use std::collections::BTreeSet;

use serde::Serialize;

use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::motion::{CHANNELS, Truth, compare, unit};
use crate::page::{Block, Section};
use crate::recording::{PoseRole, Recording, Signal};
use crate::source::Source;
use crate::statistics::{for_a_line, for_dots};

/// Points of a line, and dots, that are drawn.
pub const LINE: usize = 1200;
pub const DOTS: usize = 500;

#[derive(Serialize)]
struct TracksFigures {
    signals: Vec<SignalFigures>,
}

#[derive(Serialize)]
struct SignalFigures {
    topic: String,
    frame: Option<String>,
    part: PoseRole,
    samples: u64,
    #[serde(rename = "kept_one_of")]
    retained_one_of: u64,
    channels: Vec<&'static str>,
    /// Least and largest value by channel, mm and degrees.
    range: Vec<[f64; 2]>,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let signals = recording.signals.iter().filter(|s| !s.states.items().is_empty());
    let figures = TracksFigures { signals: signals.map(figures).collect() };
    let mut section = Section::new("tracks", "Tracks", &figures)?;
    if figures.signals.is_empty() {
        return Ok(section.nothing("The session has no pose and no track."));
    }
    let shown = || recording.signals.iter().filter(|s| !s.states.items().is_empty());
    let truth_of = |s: &Signal| match s.part {
        PoseRole::Truth => Some(s.topic.clone()),
        _ => recording.truth_of(s).map(|t| t.topic.clone()),
    };
    // One for each frame, and for each truth in it.
    let groups: BTreeSet<(Option<String>, Option<String>)> =
        shown().map(|s| (s.frame.clone(), truth_of(s))).collect();
    for (frame, truth) in groups {
        let all: Vec<&Signal> = shown().filter(|s| s.frame == frame && truth_of(s) == truth).collect();
        let name = frame.as_deref().unwrap_or("no frame");
        let truth = all.iter().copied().find(|s| s.part == PoseRole::Truth);
        section.blocks.push(Block::Heading(format!("In the frame {name}")));
        section.blocks.push(Block::Text(match truth {
            Some(t) => format!(
                "The truth is {}. Every estimate is drawn without its constant offset from the truth, because a camera \
                 tracks another point of the head than the origin of the truth. The table of errors states the offset.",
                t.topic
            ),
            None => "The session has no truth in this frame; the values are drawn unchanged.".to_owned(),
        }));
        section.blocks.extend((0..6).filter_map(|channel| chart(recording, &all, truth, channel)));
    }
    Ok(section)
}

fn figures(signal: &Signal) -> SignalFigures {
    let (mut channels, mut range) = (Vec::new(), Vec::new());
    for (channel, name) in CHANNELS.into_iter().enumerate() {
        let scale = unit(channel).1;
        let values =
            || signal.states.items().iter().map(|s| s.channels[channel] * scale).filter(|v| v.is_finite());
        if values().next().is_some() {
            channels.push(name);
            range.push([values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]);
        }
    }
    SignalFigures {
        topic: signal.topic.clone(),
        frame: signal.frame.clone(),
        part: signal.part,
        samples: signal.states.seen(),
        retained_one_of: signal.states.stride(),
        channels,
        range,
    }
}

/// A chart of one channel of all signals of a frame; `None` if only the truth has the channel although there are estimates.
fn chart(
    recording: &Recording<'_>,
    all: &[&Signal],
    truth: Option<&Signal>,
    channel: usize,
) -> Option<Block> {
    let (unit, scale) = unit(channel);
    let has = |s: &&&Signal| s.states.items().iter().any(|state| state.channels[channel].is_finite());
    let mut drawn: Vec<&&Signal> = all.iter().filter(has).filter(|s| s.part != PoseRole::Truth).collect();
    drawn.sort_by_key(|s| s.part);
    if drawn.is_empty() && all.iter().any(|s| s.part != PoseRole::Truth) {
        return None;
    }
    let mut series: Vec<Series> =
        drawn.into_iter().map(|s| of_estimate(recording, s, truth, channel)).collect();
    if let Some(truth) = truth.filter(|t| has(&t)) {
        let points: Vec<_> = truth
            .states
            .items()
            .iter()
            .map(|s| (recording.seconds(s.origin), s.channels[channel] * scale))
            .collect();
        series.push(Series {
            name: truth.topic.clone(),
            points: for_a_line(&points, LINE),
            style: Style::Dashed,
        });
    }
    let name = CHANNELS[channel];
    (!series.is_empty()).then(|| {
        let y = format!("{name}, {unit}");
        Block::Chart(Chart { title: name.to_owned(), x: "time, s".into(), y, series }, String::new())
    })
}

fn of_estimate(recording: &Recording<'_>, signal: &Signal, truth: Option<&Signal>, channel: usize) -> Series {
    let scale = unit(channel).1;
    let points: Vec<(f64, f64)> = match truth.map(|t| compare(&Truth::of(t), signal.states.items())) {
        Some(found) if !found.pairs.is_empty() => found
            .pairs
            .iter()
            .map(|p| (recording.seconds(p.origin), (p.truth[channel] + p.error[channel]) * scale))
            .collect(),
        _ => signal
            .states
            .items()
            .iter()
            .map(|s| (recording.seconds(s.origin), s.channels[channel] * scale))
            .collect(),
    };
    match signal.part {
        PoseRole::Raw => {
            Series { name: signal.topic.clone(), points: for_dots(&points, DOTS), style: Style::Dots }
        }
        _ => Series { name: signal.topic.clone(), points: for_a_line(&points, LINE), style: Style::Line },
    }
}
