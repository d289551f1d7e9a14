//! Two histograms of each structure: recalculated, and as the other program has it.

use stillpoint_patient::case::Role;
use stillpoint_report::chart::{Chart, ChartError, Series, Style};

use super::outcome::Outcome;
use crate::commands::plan::percent_curve;

/// The chart as an SVG document.
pub fn histograms(outcome: &Outcome<'_>) -> Result<String, ChartError> {
    let [own, other] = outcome.histograms();
    let up_to_gy = 1.01 * own.iter().chain(other).map(|(_, dvh)| dvh.max()).fold(1.0, f64::max);
    let (mut series, mut colours) = (Vec::new(), Vec::new());
    let shown = own.iter().enumerate().filter(|(_, (s, _))| s.role != Role::External);
    for (colour, (place, (structure, dvh))) in shown.enumerate() {
        let points = percent_curve(dvh, up_to_gy);
        series.push(Series { name: structure.name.clone(), points, style: Style::Line });
        colours.push(colour);
        if let Some((_, dvh)) = other.get(place) {
            let points = percent_curve(dvh, up_to_gy);
            series.push(Series { name: String::new(), points, style: Style::Dashed });
            colours.push(colour);
        }
    }
    let note = if other.is_empty() { "" } else { ": lines recalculated, dashes as given" };
    let chart = Chart {
        title: format!("{}{note}", outcome.case().name()),
        x: "dose, Gy".into(),
        y: "volume with at least this dose, %".into(),
        series,
    };
    chart.svg_with_legend_aside(960, 520, &colours)
}
