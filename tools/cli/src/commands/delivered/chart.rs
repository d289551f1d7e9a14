//! Three histograms of each structure: planned, delivered, and without gating.

use stillpoint_patient::case::{Role, Structure};
use stillpoint_plan::metrics::Dvh;
use stillpoint_report::chart::{Chart, ChartError, Series, Style};

use super::outcome::Outcome;
use crate::commands::plan::percent_curve;

/// Every how many points of a curve a dot is drawn.
const DOTS: usize = 6;

/// The chart as an SVG document.
pub fn histograms(outcome: &Outcome<'_>) -> Result<String, ChartError> {
    let [planned, delivered, ungated] = outcome.histograms();
    let all = || planned.iter().chain(delivered).chain(ungated);
    let up_to_gy = 1.01 * all().map(|(_, dvh)| dvh.max()).fold(1.0, f64::max);
    let (mut series, mut colours) = (Vec::new(), Vec::new());
    let shown = planned.iter().enumerate().filter(|(_, (s, _))| s.role != Role::External);
    for (colour, (place, (structure, dvh))) in shown.enumerate() {
        let curve = |of: &[(&Structure, Dvh)]| of.get(place).map(|(_, dvh)| percent_curve(dvh, up_to_gy));
        let dots = curve(ungated).unwrap_or_default().into_iter().step_by(DOTS).collect();
        for (name, points, style) in [
            (structure.name.clone(), percent_curve(dvh, up_to_gy), Style::Line),
            (String::new(), curve(delivered).unwrap_or_default(), Style::Dashed),
            (String::new(), dots, Style::Dots),
        ] {
            series.push(Series { name, points, style });
            colours.push(colour);
        }
    }
    let chart = Chart {
        title: format!(
            "{}: lines planned, dashes delivered, dots without gating (all time after arming)",
            outcome.case.name()
        ),
        x: "dose, Gy".into(),
        y: "volume with at least this dose, %".into(),
        series,
    };
    chart.svg_with_legend_aside(960, 520, &colours)
}
