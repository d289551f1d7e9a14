//! Charts of a plan: histograms, and how the search went.

use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::objectives::follows;

use super::outcome::Outcome;
use super::request::Request;
use super::table::angles;
use stillpoint_plan::recipe::PlanRun;
use stillpoint_report::chart::{Chart, ChartError, Series, Style};

/// Points of a histogram.
const STEPS: usize = 300;

/// Dose-volume histograms of the structures: lines as planned, dashes as it came with the case or in the other set-ups.
pub fn histograms(request: &Request, outcome: &Outcome<'_>) -> Result<String, ChartError> {
    let planned = &outcome.given[0].histograms;
    let reference = outcome.reference_given.as_ref().map(|given| &given.histograms);
    let up_to = up_to_gy(planned.iter().chain(reference.into_iter().flatten()).map(|(_, dvh)| dvh));
    let percent = |dvh: &Dvh| percent_curve(dvh, up_to);
    let (mut series, mut colours) = (Vec::new(), Vec::new());
    for (place, (structure, dvh)) in planned.iter().enumerate() {
        series.push(Series { name: structure.name.clone(), points: percent(dvh), style: Style::Line });
        colours.push(place);
        if let Some((_, dvh)) = reference.into_iter().flatten().find(|(s, _)| s.name == structure.name) {
            series.push(Series { name: String::new(), points: percent(dvh), style: Style::Dashed });
            colours.push(place);
        }
    }
    // The least and the most that each structure gets over the set-ups.
    let moved = &outcome.given[1..];
    for (place, (structure, dvh)) in planned.iter().enumerate() {
        if moved.is_empty() || !follows(structure.role) {
            continue;
        }
        let all = || {
            let others = moved
                .iter()
                .flat_map(|given| &given.histograms)
                .filter(|(s, _)| s.name == structure.name)
                .map(|(_, dvh)| dvh);
            std::iter::once(dvh).chain(others)
        };
        for extreme in [f64::min as fn(f64, f64) -> f64, f64::max] {
            let mut curve = vec![(0.0, f64::NAN); STEPS + 1];
            for dvh in all() {
                for (point, (dose, volume)) in curve.iter_mut().zip(dvh.curve(up_to, STEPS)) {
                    *point = (dose, extreme(point.1, 100.0 * volume));
                }
            }
            let end = curve.iter().position(|(_, v)| *v == 0.0).map_or(curve.len(), |at| at + 1);
            curve.truncate(end);
            series.push(Series { name: String::new(), points: curve, style: Style::Dashed });
            colours.push(place);
        }
    }
    let side_by_side = match (&reference, moved.is_empty()) {
        (Some(_), true) => "; dashed: the reference dose of the case",
        (None, false) => "; dashed: minimum and maximum over the set-ups",
        (Some(_), false) => {
            "; dashed: the reference dose of the case, and minimum and maximum over the set-ups"
        }
        (None, true) => "",
    };
    let chart = Chart {
        title: format!("{}, {}{side_by_side}", request.setup.case.name(), angles(&outcome.angles)),
        x: "dose, Gy".into(),
        y: "volume with at least this dose, %".into(),
        series,
    };
    chart.svg_with_legend_aside(960, 520, &colours)
}

/// The dose at which histograms end, gray.
pub fn up_to_gy<'a>(histograms: impl Iterator<Item = &'a Dvh>) -> f64 {
    1.01 * histograms.map(Dvh::max).fold(1.0, f64::max)
}

/// The cumulative curve of a histogram in percent, until nothing is left.
pub fn percent_curve(dvh: &Dvh, up_to_gy: f64) -> Vec<(f64, f64)> {
    let curve = dvh.curve(up_to_gy, STEPS);
    let end = curve.iter().position(|(_, v)| *v == 0.0).map_or(curve.len(), |at| at + 1);
    curve[..end].iter().map(|(dose, volume)| (*dose, 100.0 * volume)).collect()
}

/// Cost of each solve, and the best until then. Sets of fewer beams are shown where they do not dwarf the others.
pub fn objective(request: &Request, run: &PlanRun) -> Result<String, ChartError> {
    let full = || run.history.iter().filter(|p| p.beams.beams().len() >= request.beams).map(|p| p.cost);
    let most = if full().count() < 3 { f64::INFINITY } else { full().fold(0.0, f64::max) };
    let costs = |name: String, requested: &dyn Fn(usize) -> bool| {
        let sets = run.history.iter().filter(|p| requested(p.beams.beams().len()) && p.cost <= most);
        Series { name, points: sets.map(|p| (p.solves as f64, p.cost)).collect(), style: Style::Dots }
    };
    let beams = request.beams;
    let best = run.history.iter().map(|p| (p.solves as f64, p.best)).collect();
    let mut series = vec![
        Series {
            name: "best so far".into(),
            points: with_end(best, request.budget as f64),
            style: Style::Steps,
        },
        costs(format!("a set of {beams}"), &|n| n == beams),
        costs("a smaller set".into(), &|n| n < beams),
        costs("a larger set".into(), &|n| n > beams),
    ];
    series.retain(|s| !s.points.is_empty());
    let chart = Chart {
        title: format!("{}: {beams} beams by {}", request.setup.case.name(), run.name.word()),
        x: "solves".into(),
        y: "objective".into(),
        series,
    };
    chart.svg_with_legend_aside(960, 420, &[0, 1, 2, 3])
}

/// The best of each method over its solves.
pub fn comparison(request: &Request, runs: &[PlanRun]) -> Result<String, ChartError> {
    let series = |run: &PlanRun| Series {
        name: run.label(),
        points: with_end(
            run.history.iter().map(|p| (p.solves as f64, p.best)).collect(),
            request.budget as f64,
        ),
        style: Style::Steps,
    };
    let chart = Chart {
        title: format!(
            "{}: {} beams, every method with {} solves",
            request.setup.case.name(),
            request.beams,
            request.budget
        ),
        x: "solves".into(),
        y: "best objective".into(),
        series: runs.iter().map(series).collect(),
    };
    chart.svg_with_legend_aside(960, 480, &(0..runs.len()).collect::<Vec<_>>())
}

/// A search that ended early keeps what it found.
fn with_end(mut points: Vec<(f64, f64)>, end: f64) -> Vec<(f64, f64)> {
    if let Some(&(last, best)) = points.last()
        && last < end
    {
        points.push((end, best));
    }
    points
}
