//! How sure a tracker was that it followed what was captured: the confidence with its parts, doubted frames, and the
//! reasons for which frames before the first capture had no face.

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_samples::{IdentityPart, PoseStatus};

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::numbers::{count, fixed};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{Alignments, Recording};
use crate::rows::Sure;
use crate::source::Source;
use crate::statistics::for_a_line;
use crate::unproven::cause;

/// Below it a frame has no pose.
const ENOUGH: f64 = 0.5;

#[derive(Serialize)]
struct ConfidenceFigures {
    trackers: Vec<Tracker>,
    /// Frames without a face before the first capture, by topic and reason.
    refusals: Vec<Refused>,
}

#[derive(Serialize)]
struct Tracker {
    topic: String,
    /// Frames that were judged.
    judged: u64,
    doubted: u64,
    /// Faces that were to become the reference and were refused.
    captures_refused: u64,
    /// Least and median confidence, and those of each part.
    confidence: Range,
    parts: Vec<(&'static str, Range)>,
    /// When, after the capture, the head was seen to move with all its parts, s; none where it was not.
    proven_s: Option<f64>,
    /// Why the last reference was not proven at the end, a code; 0 where it was.
    unproven: u32,
    /// Captures on which no face was found: all of the reference was taken for rigid.
    without_a_face: u64,
}

#[derive(Serialize)]
struct Range {
    least: Option<f64>,
    median: Option<f64>,
    /// Frames in which it was below the limit.
    below: u64,
}

#[derive(Serialize)]
struct Refused {
    topic: String,
    reason: String,
    frames: u64,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let judged = recording.alignments.iter().filter(|a| !a.sure.items().is_empty());
    let figures =
        ConfidenceFigures { trackers: judged.clone().map(tracker).collect(), refusals: refusals(recording) };
    let mut section = Section::new("confidence", "Confidence in the head", &figures)?;
    if figures.trackers.is_empty() && figures.refusals.is_empty() {
        return Ok(section.nothing("The session has no frames whose identity was checked."));
    }
    for t in &figures.trackers {
        section.blocks.push(Block::Text(sentence(t)));
        let columns = ["part", "least", "median", "frames below 0.5"];
        let mut table = Table::new(t.topic.clone(), &columns);
        for (name, range) in
            [("confidence", &t.confidence)].into_iter().chain(t.parts.iter().map(|(n, r)| (*n, r)))
        {
            table.row([
                Cell::text(name),
                Cell::number(fixed(range.least, 2)),
                Cell::number(fixed(range.median, 2)),
                Cell::fault(range.below),
            ]);
        }
        section.blocks.push(Block::Table(table));
    }
    for a in judged {
        section.blocks.push(chart(recording, a));
    }
    if !figures.refusals.is_empty() {
        let caption = "Frames without a face before the first capture";
        let mut table = Table::new(caption, &["topic", "reason", "frames"]);
        for r in &figures.refusals {
            table.row([Cell::text(&r.topic), Cell::text(&r.reason), Cell::number(count(r.frames))]);
        }
        section.blocks.push(Block::Table(table));
    }
    Ok(section)
}

fn sentence(t: &Tracker) -> String {
    let proof = match t.proven_s {
        Some(s) => format!(
            "the head was seen to move with all its parts {} s after the first judged frame",
            fixed(Some(s), 1)
        ),
        None => match cause(t.unproven) {
            Some(cause) => format!("the reference was not proven, so the gate stayed shut: {cause}"),
            None => "the head was not seen to move with all its parts, so the gate stayed shut".into(),
        },
    };
    let rigid = match t.without_a_face {
        0 => String::new(),
        n => format!(
            " No face was found on {} of the captured references, or `soft_tissue` is `ignored`: all of it was taken for rigid, and a smile lets go of the head.",
            count(n)
        ),
    };
    let refused = match t.captures_refused {
        0 => String::new(),
        n => format!(" {} faces were refused as a reference.", count(n)),
    };
    format!(
        "{}: {} of {} frames were doubted; {proof}.{refused}{rigid}",
        t.topic,
        count(t.doubted),
        count(t.judged)
    )
}

fn tracker(a: &Alignments) -> Tracker {
    let sure = a.sure.items();
    let first = sure.first().map(|s| s.origin);
    let proven = sure.iter().find(|s| s.is_proven).map(|s| s.origin);
    Tracker {
        topic: a.topic.clone(),
        judged: a.sure.seen(),
        doubted: a.statuses[PoseStatus::Doubted as usize],
        captures_refused: a.statuses[PoseStatus::CaptureRefused as usize],
        confidence: range(sure.iter().map(|s| s.confidence)),
        parts: IdentityPart::ALL
            .iter()
            .map(|(name, part)| (*name, range(sure.iter().map(|s| s.certainty[*part as usize]))))
            .collect(),
        unproven: a.unproven,
        without_a_face: a.without_a_face,
        proven_s: first.zip(proven).map(|(first, proven)| proven.saturating_sub(first) as f64 * 1e-9),
    }
}

fn range(values: impl Iterator<Item = f64>) -> Range {
    let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    Range {
        least: sorted.first().copied(),
        median: sorted.get(sorted.len() / 2).copied(),
        below: sorted.partition_point(|v| *v < ENOUGH) as u64,
    }
}

fn chart(recording: &Recording<'_>, a: &Alignments) -> Block {
    let line = |name: &str, style: Style, of: &dyn Fn(&Sure) -> f64| {
        let points: Vec<_> = a.sure.items().iter().map(|s| (recording.seconds(s.origin), of(s))).collect();
        Series { name: name.to_owned(), points: for_a_line(&points, LINE), style }
    };
    let parts = IdentityPart::ALL.iter().map(|(name, part)| {
        let part = *part as usize;
        line(name, Style::Dashed, &move |s: &Sure| s.certainty[part])
    });
    let mut series: Vec<Series> = parts.collect();
    series.push(line("confidence", Style::Line, &|s| s.confidence));
    let (title, y) = (format!("Confidence of {}", a.topic), "from 0 to 1".to_owned());
    let caption =
        "The confidence is the least of its parts. Below 0.5 a frame has no pose, and the beam is off.";
    Block::Chart(Chart { title, x: "time, s".into(), y, series }, caption.to_owned())
}

/// Reasons of frames without a face before the first frame that was judged.
fn refusals(recording: &Recording<'_>) -> Vec<Refused> {
    let first = recording.alignments.iter().filter_map(|a| a.sure.items().first()).map(|s| s.origin).min();
    let mut reasons: BTreeMap<(String, String), u64> = BTreeMap::new();
    for r in recording.refusals.items().iter().filter(|r| first.is_none_or(|first| r.stamp < first)) {
        *reasons.entry((r.topic.clone(), without_numbers(&r.reason))).or_default() += 1;
    }
    reasons.into_iter().map(|((topic, reason), frames)| Refused { topic, reason, frames }).collect()
}

/// A reason up to its first number, so that the same reason counts as one.
fn without_numbers(reason: &str) -> String {
    let end = reason.find(|c: char| c.is_ascii_digit()).unwrap_or(reason.len());
    let head = reason[..end].trim_end_matches(['-', '(', ' ', ':', ',']);
    if head.is_empty() { reason.to_owned() } else { head.to_owned() }
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{PoseReportElement, Proof, Unproven};
    use zerocopy::FromZeros;

    use super::*;

    #[test]
    fn the_figures_are_those_of_the_frames() {
        let sure = |origin: u64, confidence: f64, is_proven: bool| Sure {
            origin,
            confidence,
            certainty: [confidence, 1.0, 1.0, 1.0, 1.0],
            is_proven,
        };
        let mut a = Alignments { topic: "head.report".into(), ..Alignments::default() };
        for s in [sure(0, 0.9, false), sure(100_000_000, 0.4, false), sure(200_000_000, 0.8, true)] {
            a.sure.push(s);
        }
        a.statuses[PoseStatus::Doubted as usize] = 1;
        let found = tracker(&a);
        assert_eq!((found.judged, found.doubted, found.proven_s), (3, 1, Some(0.2)));
        assert_eq!(
            (found.confidence.least, found.confidence.median, found.confidence.below),
            (Some(0.4), Some(0.8), 1)
        );
        assert_eq!((found.parts[0].1.below, found.parts[1].1.below), (1, 0));
    }

    #[test]
    fn the_cause_of_a_missing_proof_and_a_missing_face_are_in_the_sentence() {
        let mut a = Alignments { topic: "head.report".into(), ..Alignments::default() };
        let report = PoseReportElement {
            status: PoseStatus::Captured as u32,
            reference: 1,
            confidence: 1.0,
            unproven: Unproven::PieceApart as u32,
            ..FromZeros::new_zeroed()
        };
        a.take(0, &report);
        let text = sentence(&tracker(&a));
        assert!(text.contains("such as a hand") && text.contains("No face was found on 1 of"), "{text}");
        a.take(1, &PoseReportElement { proof: Proof::Proven as u32, unproven: 0, ..report });
        assert!(!sentence(&tracker(&a)).contains("such as a hand"));
    }

    #[test]
    fn the_same_reason_with_other_numbers_is_one() {
        let [a, b] = ["ambiguous: (0.10, 0.02, 0.1) or (0.2, 0.1, 0.1)", "ambiguous: (-0.30, 0.02, 0.1) or"]
            .map(without_numbers);
        assert_eq!((a.as_str(), b.as_str()), ("ambiguous", "ambiguous"));
        assert_eq!(without_numbers("12 voxels"), "12 voxels");
        assert_eq!(without_numbers("no plane"), "no plane");
    }
}
