//! Histograms of the planned dose and that of the segments, with prescriptions and limits.

use stillpoint_plan::metrics::Dvh;
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_report::page::Block;
use stillpoint_report::themed;

use super::super::charts::percent_curve;
use super::super::outcome::Outcome;
use super::super::request::Request;
use super::shown;
use crate::exit::Failure;

/// Number of the colour of prescriptions.
const INK: usize = 6;

pub fn blocks(request: &Request, outcome: &Outcome<'_>) -> Result<Vec<Block>, Failure> {
    let planned = outcome.on_grid.histograms(&outcome.gray[0]);
    let shaped = outcome.leaves.as_ref().map(|leaves| outcome.on_grid.histograms(&leaves.gray));
    let both = || planned.iter().chain(shaped.iter().flatten());
    let up_to = 1.01 * both().map(|(_, dvh): &(_, Dvh)| dvh.max()).fold(1.0, f64::max);
    let (mut series, mut colours) = (Vec::new(), Vec::new());
    let mut add = |name: &str, points: Vec<(f64, f64)>, style: Style, colour: usize| {
        series.push(Series { name: name.to_owned(), points, style });
        colours.push(colour);
    };
    for (number, (structure, dvh)) in planned.iter().enumerate() {
        add(&structure.name, percent_curve(dvh, up_to), Style::Line, number);
    }
    for (number, (_, dvh)) in shaped.iter().flatten().enumerate() {
        add("", percent_curve(dvh, up_to), Style::Dashed, number);
    }
    for prescription in request.case.prescription() {
        add("", vec![(prescription.dose_gy, 0.0), (prescription.dose_gy, 100.0)], Style::Dashed, INK);
    }
    let (_, _, limits) = shown(outcome);
    let highest = request.case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
    for limit in limits {
        let Some(number) = planned.iter().position(|(s, _)| s.name == limit.structure) else { continue };
        let own = request.case.prescription().iter().find(|p| p.structure == limit.structure);
        let prescribed = own.map_or(highest, |p| p.dose_gy);
        if let Some(point) = point(&limit.limit, prescribed).filter(|(dose, _)| *dose <= up_to) {
            add("", vec![point], Style::Dots, number);
        }
    }
    let chart = Chart {
        title: String::new(),
        x: "dose, Gy".to_owned(),
        y: "volume with at least this dose, %".to_owned(),
        series,
    };
    let svg = chart.svg_with_legend_beside(960, 520, &colours).map_err(Failure::failed)?;
    let dashed = if shaped.is_some() { "; dashed: the dose of the segments" } else { "" };
    let caption = format!(
        "Lines: the dose of the planned fluence{dashed}. Vertical dashes: prescriptions. Dots: limits of the protocol, in the \
         colour of the structure."
    );
    Ok(vec![Block::Drawing(themed(&svg), caption)])
}

/// Where a limit such as `V75Gy[%] <= 15` or `D95%[%] >= 95` lies in a histogram; nothing for other quantities.
fn point(limit: &str, prescribed_gy: f64) -> Option<(f64, f64)> {
    let (quantity, bound) = limit.split_once("<=").or_else(|| limit.split_once(">="))?;
    let bound: f64 = bound.trim().parse().ok()?;
    let quantity = quantity.trim();
    if let Some(volume) = quantity.strip_prefix('V') {
        let dose = volume.strip_suffix("[%]")?;
        let gray = match dose.strip_suffix("Gy") {
            Some(gray) => gray.parse().ok()?,
            None => dose.strip_suffix('%')?.parse::<f64>().ok()? * prescribed_gy / 100.0,
        };
        return Some((gray, bound));
    }
    let (volume, unit) = quantity.strip_prefix('D')?.split_once("%[")?;
    let gray = match unit {
        "Gy]" => bound,
        "%]" => bound * prescribed_gy / 100.0,
        _ => return None,
    };
    Some((gray, volume.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_of_doses_and_volumes_are_points_and_others_are_none() {
        assert_eq!(point("V75Gy[%] <= 15", 78.0), Some((75.0, 15.0)));
        assert_eq!(point("V95%[%] >= 98", 50.0), Some((47.5, 98.0)));
        assert_eq!(point("D98%[%] >= 95", 60.0), Some((57.0, 98.0)));
        assert_eq!(point("D2%[Gy] <= 80", 60.0), Some((80.0, 2.0)));
        for other in
            ["Mean[Gy] <= 50", "D0.03cc[Gy] <= 54", "V20Gy[cc] <= 100", "Paddick >= 0.80", "R50 <= 5"]
        {
            assert_eq!(point(other, 60.0), None, "{other}");
        }
    }
}
