//! How often each operator ran, how long it took, and how old the images behind its output were, from the journals.

use serde::Serialize;
use stillpoint_samples::{Cause, Entry, Outcome, RefKind};

use super::tracks::LINE;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::numbers::{count, fixed};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::Recording;
use crate::source::Source;
use crate::statistics::{Spread, for_a_line};
use crate::wiring::Stage;
use crate::wiring::is_activation;

/// Operators whose ages are drawn: the last ones downstream.
const DRAWN: usize = 5;

#[derive(Serialize)]
struct OperatorsFigures {
    seconds: f64,
    operators: Vec<Operator>,
}

/// One operator over all its incarnations. Times in ms.
#[derive(Serialize)]
pub struct Operator {
    pub operator: String,
    pub activations: u64,
    /// Activations per second of the session.
    pub rate_hz: f64,
    /// From one activation to the next.
    pub interval_ms: Spread,
    /// From the activation to the sending of its outputs.
    pub step_ms: Spread,
    /// From the acquisition behind the outputs to their sending.
    pub age_ms: Spread,
    pub sent: u64,
    /// Activations that returned an error.
    pub errors: u64,
    pub panics: u64,
    pub incarnations: u64,
}

/// The figures of every operator, upstream first.
pub fn of(recording: &Recording<'_>) -> Vec<Operator> {
    let seconds = recording.length();
    let journals = recording.session.journals();
    let stages = recording.wiring.stages().iter();
    stages
        .filter_map(|stage| {
            let entries = journals.get(&stage.name)?;
            let active: Vec<&Entry> = entries.iter().filter(|e| is_activation(e)).collect();
            let ended = |outcome| active.iter().filter(|e| e.outcome() == Some(outcome)).count() as u64;
            let times = sent_times(entries);
            let sent = active.iter().flat_map(|e| e.refs_of(RefKind::Output)).map(|r| u64::from(r.count));
            let same_life = |w: &&[&Entry]| w[0].header.incarnation == w[1].header.incarnation;
            let intervals = active.windows(2).filter(same_life);
            let intervals =
                intervals.map(|w| w[1].header.stamp.saturating_sub(w[0].header.stamp) as f64 * 1e-6);
            Some(Operator {
                operator: stage.name.clone(),
                activations: active.len() as u64,
                rate_hz: if seconds > 0.0 { active.len() as f64 / seconds } else { 0.0 },
                interval_ms: Spread::of(intervals),
                step_ms: Spread::of(times.iter().map(|(e, sent)| (sent - e.header.stamp) as f64 * 1e-6)),
                age_ms: Spread::of(times.iter().filter(|t| has_age(stage, t.0)).map(|t| age_ms(*t))),
                sent: sent.sum(),
                errors: ended(Outcome::Error),
                panics: ended(Outcome::Panic),
                incarnations: entries.iter().filter(|e| e.cause() == Some(Cause::Start)).count() as u64,
            })
        })
        .collect()
}

/// Activations with the time, ns, at which their outputs were sent, as the entry behind them says. A simulated session
/// charges no time, and has none.
fn sent_times(entries: &[Entry]) -> Vec<(&Entry, u64)> {
    let pairs = entries.windows(2).filter(|w| {
        is_activation(&w[0])
            && w[0].header.incarnation == w[1].header.incarnation
            && w[1].body.sent_before > w[0].header.stamp
    });
    pairs.map(|w| (&w[0], w[1].body.sent_before)).collect()
}

/// Whether something was acquired behind an activation: a timer's tick of an operator with inputs may have nothing new.
fn has_age(stage: &Stage, entry: &Entry) -> bool {
    entry.header.origin < entry.header.stamp || stage.inputs.iter().all(String::is_empty)
}

fn age_ms((entry, sent): (&Entry, u64)) -> f64 {
    sent.saturating_sub(entry.header.origin) as f64 * 1e-6
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let figures = OperatorsFigures { seconds: recording.length(), operators: of(recording) };
    let mut section = Section::new("operators", "Rates and latency", &figures)?;
    if figures.operators.is_empty() {
        return Ok(section.nothing("The session has no journals, so rates and latencies are not known."));
    }
    section.blocks.push(Block::Text(
        "A step is the time from an activation to the sending of its outputs. The age is that of the oldest image behind \
         the outputs when they are sent: the latency of the chain up to there. All from the journals."
            .into(),
    ));
    if figures.operators.iter().all(|o| o.step_ms.count == 0) {
        let sentence =
            "Steps took no session time: the session was simulated without latencies, or it is too short.";
        section.blocks.push(Block::Text(sentence.into()));
    }
    section.blocks.push(Block::Table(table(&figures.operators)));
    section.blocks.extend(ages(recording));
    Ok(section)
}

fn table(operators: &[Operator]) -> Table {
    let columns = [
        "operator",
        "runs",
        "Hz",
        "longest interval, ms",
        "step p50, ms",
        "p99",
        "max",
        "age p50, ms",
        "p99",
        "max",
        "errors",
        "panics",
        "restarts",
    ];
    let mut table = Table::new("", &columns);
    let longest = operators.iter().filter_map(|o| o.step_ms.p50).fold(0.0, f64::max);
    for o in operators {
        let ms = |v: Option<f64>| Cell::number(fixed(v, 2));
        table.row([
            Cell::text(&o.operator),
            Cell::number(count(o.activations)),
            Cell::number(fixed(o.rate_hz, 1)),
            ms(o.interval_ms.max),
            o.step_ms
                .p50
                .map_or_else(|| ms(None), |step| Cell::Bar(step / longest.max(1e-9), fixed(step, 2))),
            ms(o.step_ms.p99),
            ms(o.step_ms.max),
            ms(o.age_ms.p50),
            ms(o.age_ms.p99),
            ms(o.age_ms.max),
            Cell::fault(o.errors),
            Cell::fault(o.panics),
            Cell::fault(o.incarnations.saturating_sub(1)),
        ]);
    }
    table
}

/// Ages of the last operators downstream, over time.
fn ages(recording: &Recording<'_>) -> Option<Block> {
    let made = recording.wiring.stages().iter().filter(|s| s.inputs.iter().any(|i| !i.is_empty()));
    let all = made.filter_map(|stage| {
        let times = sent_times(recording.session.journals().get(&stage.name)?);
        let times = times.iter().filter(|t| has_age(stage, t.0));
        let points: Vec<_> = times.map(|t| (recording.seconds(t.0.header.stamp), age_ms(*t))).collect();
        (!points.is_empty()).then(|| Series {
            name: stage.name.clone(),
            points: for_a_line(&points, LINE),
            style: Style::Line,
        })
    });
    let mut series: Vec<Series> = all.collect();
    series.drain(..series.len().saturating_sub(DRAWN));
    let title = "Age of the images behind the outputs of the last operators".to_owned();
    let chart = Chart { title, x: "time, s".into(), y: "age, ms".into(), series };
    (!chart.series.is_empty()).then(|| Block::Chart(chart, String::new()))
}
