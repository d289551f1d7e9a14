//! Consistency of estimates: NIS of filters, and NEES if the session has a truth.

use serde::Serialize;
use stillpoint_samples::Standing;

use super::errors::compared;
use super::tracks::DOTS;
use crate::ReportError;
use crate::chart::{Chart, Series, Style};
use crate::motion::Comparison;
use crate::numbers::{count, fixed, percent};
use crate::page::{Block, Cell, Section, Table};
use crate::recording::{PoseRole, Recording, Signal};
use crate::source::Source;
use crate::statistics::{for_dots, mean};

/// The bounds that 95 % of a chi-squared number lie between, by degrees of freedom from 1.
const BOUNDS: [[f64; 2]; 6] = [
    [0.000_982, 5.0239],
    [0.0506, 7.3778],
    [0.2158, 9.3484],
    [0.4844, 11.1433],
    [0.8312, 12.8325],
    [1.2373, 14.4494],
];

#[derive(Serialize)]
struct ConsistencyFigures {
    estimates: Vec<Estimate>,
}

#[derive(Serialize)]
struct Estimate {
    topic: String,
    /// Measurements used and refused, by the last sample of a track.
    used: Option<u64>,
    refused: Option<u64>,
    nis: Option<Normalised>,
    nees: Option<Normalised>,
}

/// A normalised square: its mean is to be its degrees of freedom.
#[derive(Serialize)]
struct Normalised {
    samples: usize,
    mean: f64,
    expected: f64,
    /// Part within the bounds of 95 %.
    within: f64,
    bounds: [f64; 2],
}

impl Normalised {
    fn of(values: &[f64], expected: f64) -> Option<Self> {
        let bounds = *BOUNDS.get((expected as usize).checked_sub(1)?)?;
        let inside = values.iter().filter(|v| (bounds[0]..=bounds[1]).contains(*v)).count();
        Some(Self {
            samples: values.len(),
            mean: mean(values)?,
            expected,
            within: inside as f64 / values.len() as f64,
            bounds,
        })
    }
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let compared = compared(recording);
    let (mut estimates, mut charts) = (Vec::new(), Vec::new());
    for signal in recording.signals.iter().filter(|s| s.part != PoseRole::Truth) {
        let found = compared.iter().find(|c| c.signal.topic == signal.topic).map(|c| &c.found);
        let nis = nis(recording, signal);
        let nis_figures = Normalised::of(&numbers(&nis), nis_expected(recording, signal));
        let (nees, expected) = nees(recording, signal, found);
        let nees_figures = Normalised::of(&numbers(&nees), expected);
        if nis_figures.is_none() && nees_figures.is_none() {
            continue;
        }
        charts.extend(nis_figures.as_ref().map(|f| chart("NIS", &signal.topic, &nis, f)));
        charts.extend(nees_figures.as_ref().map(|f| chart("NEES", &signal.topic, &nees, f)));
        estimates.push(Estimate {
            topic: signal.topic.clone(),
            used: signal.tracking.map(|t| t.accepted),
            refused: signal.tracking.map(|t| t.rejected),
            nis: nis_figures,
            nees: nees_figures,
        });
    }
    let figures = ConsistencyFigures { estimates };
    let mut section = Section::new("consistency", "Consistency", &figures)?;
    if figures.estimates.is_empty() {
        let sentence = "The session has no filtered track with innovations, and no estimate with a truth.";
        return Ok(section.nothing(sentence));
    }
    section.blocks.push(Block::Text(
        "NIS is the square of what a measurement adds, over what the filter expects it to be; NEES the same of the error of \
         the estimate, that of the filter itself where it was given the truth, else against the session's truth without the \
         constant offset. Where an estimate's claims are right the mean is the number of channels, and 95 % lie within the \
         bounds. A smaller mean says that it expects more noise than there is, a larger one less. A filter that allows for \
         accelerations which the head does not make has a small NIS for that reason alone."
            .into(),
    ));
    section.blocks.push(Block::Table(table(&figures.estimates)));
    section.blocks.extend(charts);
    Ok(section)
}

fn numbers(values: &[(f64, f64)]) -> Vec<f64> {
    values.iter().map(|(_, v)| *v).collect()
}

fn nis(recording: &Recording<'_>, signal: &Signal) -> Vec<(f64, f64)> {
    let states = signal.states.items().iter();
    states
        .filter(|s| s.nis.is_finite() && s.standing == Standing::Measured)
        .map(|s| (recording.seconds(s.origin), s.nis))
        .collect()
}

/// What a filter's diagnostics say is to be expected; else the number of its channels.
fn nis_expected(recording: &Recording<'_>, signal: &Signal) -> f64 {
    let sentence = diagnostics(recording, signal, "nis_mean_expected").last().map(|(_, v)| *v);
    let channels = signal.tracking.map_or(0, |t| t.channels.count_ones());
    sentence.filter(|v| v.is_finite()).unwrap_or(f64::from(channels))
}

/// By the filter's diagnostics; where it was not told the truth, by the comparison with it. And what is to be expected.
fn nees(recording: &Recording<'_>, signal: &Signal, found: Option<&Comparison>) -> (Vec<(f64, f64)>, f64) {
    let sentence = diagnostics(recording, signal, "nees").iter().filter(|(_, v)| v.is_finite());
    let reported: Vec<_> = sentence.map(|(stamp, v)| (recording.seconds(*stamp), *v)).collect();
    if !reported.is_empty() {
        let expected =
            diagnostics(recording, signal, "nees_mean_expected").last().map_or(f64::NAN, |(_, v)| *v);
        return (reported, expected);
    }
    let pairs = found.map_or(&[][..], |f| &f.pairs);
    let Some(channels) = pairs.iter().filter_map(|p| p.nees).map(|(_, channels)| channels).max() else {
        return (Vec::new(), f64::NAN);
    };
    // An estimate that lacks channels for a while is judged where it has all.
    let of_all = pairs.iter().filter_map(|p| Some((p.origin, p.nees.filter(|(_, n)| *n == channels)?.0)));
    (of_all.map(|(origin, square)| (recording.seconds(origin), square)).collect(), channels as f64)
}

/// A number that the operator of a track says about its work.
fn diagnostics<'r>(recording: &'r Recording<'_>, signal: &Signal, name: &str) -> &'r [(u64, f64)] {
    let Some((stage, _)) = recording.wiring.producer(&signal.topic) else { return &[] };
    let own = |topic: &String| recording.metrics.iter().find(|m| m.topic == *topic);
    stage.outputs.iter().filter_map(own).map(|m| m.of(name)).find(|v| !v.is_empty()).unwrap_or(&[])
}

fn chart(what: &str, topic: &str, values: &[(f64, f64)], figures: &Normalised) -> Block {
    let ends = [values.first(), values.last()].map(|p| p.map_or(0.0, |p| p.0));
    let flat = |name: &str, y: f64| Series {
        name: name.into(),
        points: ends.map(|x| (x, y)).to_vec(),
        style: Style::Dashed,
    };
    let series = vec![
        Series { name: what.into(), points: for_dots(values, DOTS), style: Style::Dots },
        flat("expected mean", figures.expected),
        flat("95 % are below", figures.bounds[1]),
    ];
    let chart = Chart { title: format!("{what} of {topic}"), x: "time, s".into(), y: what.into(), series };
    Block::Chart(chart, String::new())
}

fn table(estimates: &[Estimate]) -> Table {
    let columns =
        ["estimate", "used", "refused", "number", "samples", "mean", "expected", "within 95 % bounds"];
    let mut table = Table::new("", &columns);
    let whole = |n: Option<u64>| Cell::number(n.map_or_else(String::new, count));
    for f in estimates {
        for (name, n) in [("NIS", &f.nis), ("NEES", &f.nees)] {
            let Some(n) = n else { continue };
            table.row([
                Cell::text(&f.topic),
                whole(f.used),
                whole(f.refused),
                Cell::text(name),
                Cell::number(count(n.samples as u64)),
                Cell::number(fixed(n.mean, 3)),
                Cell::number(fixed(n.expected, 0)),
                Cell::number(percent(n.within)),
            ]);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounds_hold_ninety_five_percent_of_squares_of_normal_numbers() {
        // Numbers evenly spread over the distribution: the normal quantiles of (k + 1/2) / n by bisection of erf.
        let n = 20_000;
        let squares: Vec<f64> =
            (0..n).map(|k| normal_quantile((k as f64 + 0.5) / n as f64).powi(2)).collect();
        let found = Normalised::of(&squares, 1.0).unwrap();
        assert!((found.within - 0.95).abs() < 1e-3 && (found.mean - 1.0).abs() < 2e-3, "{}", found.within);
        assert!(Normalised::of(&[], 1.0).is_none() && Normalised::of(&[1.0], f64::NAN).is_none());
    }

    fn normal_quantile(p: f64) -> f64 {
        let (mut low, mut high) = (-10.0, 10.0);
        for _ in 0..80 {
            let middle = 0.5 * (low + high);
            if 0.5 * libm::erfc(-middle / core::f64::consts::SQRT_2) < p {
                low = middle
            } else {
                high = middle
            }
        }
        0.5 * (low + high)
    }
}
