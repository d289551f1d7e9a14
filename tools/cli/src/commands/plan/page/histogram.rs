//! Histograms of the planned dose and that of the segments, with prescriptions and limits.

use stillpoint_patient::case::{Prescription, Structure};
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::protocol::Judged;
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_report::page::Block;
use stillpoint_report::themed;

use super::super::charts::{percent_curve, up_to_gy};
use super::super::outcome::Outcome;
use super::super::request::Request;
use super::shown;
use crate::exit::Failure;

/// Number of the colour of prescriptions.
const INK: usize = 6;

/// Histograms in one drawing.
pub struct Histograms<'a> {
    /// Names of structures with their curves in lines; their order gives the colours.
    pub lines: Vec<(&'a str, Vec<(f64, f64)>)>,
    /// Names of structures with their curves in dashes.
    pub dashes: Vec<(&'a str, Vec<(f64, f64)>)>,
    /// Prescriptions of the case.
    pub prescription: &'a [Prescription],
    /// Limits, of which those on the histogram are drawn.
    pub limits: &'a [Judged],
}

pub fn blocks(request: &Request, outcome: &Outcome<'_>) -> Result<Vec<Block>, Failure> {
    let planned = &outcome.given[0].histograms;
    let shaped = outcome.leaves.as_ref().map_or(&[][..], |leaves| &leaves.given.histograms[..]);
    let up_to = up_to_gy(planned.iter().chain(shaped).map(|(_, dvh)| dvh));
    let (_, _, limits) = shown(outcome);
    let histograms = Histograms {
        lines: curves(planned, up_to),
        dashes: curves(shaped, up_to),
        prescription: request.setup.case.prescription(),
        limits,
    };
    let dashed = if shaped.is_empty() { "" } else { "; dashed: the dose of the segments" };
    Ok(vec![histograms.draw(&format!("Lines: the dose of the planned fluence{dashed}."))?])
}

/// Curves of histograms with the names of their structures.
pub fn curves<'a>(histograms: &[(&'a Structure, Dvh)], up_to: f64) -> Vec<(&'a str, Vec<(f64, f64)>)> {
    histograms.iter().map(|(structure, dvh)| (&structure.name[..], percent_curve(dvh, up_to))).collect()
}

impl Histograms<'_> {
    /// The drawing, with a caption that begins with these words.
    pub fn draw(&self, words: &str) -> Result<Block, Failure> {
        let both = || self.lines.iter().chain(&self.dashes);
        let up_to = both().flat_map(|(_, points)| points).map(|(dose, _)| *dose).fold(1.0, f64::max);
        let number = |name: &str| self.lines.iter().position(|(structure, _)| *structure == name);
        let (mut series, mut colours) = (Vec::new(), Vec::new());
        let mut add = |name: &str, points: Vec<(f64, f64)>, style: Style, colour: usize| {
            series.push(Series { name: name.to_owned(), points, style });
            colours.push(colour);
        };
        for (number, (name, points)) in self.lines.iter().enumerate() {
            add(name, points.clone(), Style::Line, number);
        }
        for (name, points) in &self.dashes {
            add("", points.clone(), Style::Dashed, number(name).unwrap_or(INK));
        }
        for prescription in self.prescription {
            let dose = prescription.dose_gy;
            add("", vec![(dose, 0.0), (dose, 100.0)], Style::Dashed, INK);
        }
        let highest = self.prescription.iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        for limit in self.limits {
            let Some(number) = number(&limit.structure) else { continue };
            let own = self.prescription.iter().find(|p| p.structure == limit.structure);
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
        let svg = chart.svg_with_legend_aside(960, 520, &colours).map_err(Failure::failed)?;
        let caption = format!(
            "{words} Vertical dashes: prescriptions. Dots: limits of the protocol, in the colour of the structure."
        );
        Ok(Block::Drawing(themed(&svg), caption))
    }
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
