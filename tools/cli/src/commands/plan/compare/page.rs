//! `compare.html`: two plans as one self-contained page.

use stillpoint_plan::plan_file::Histogram;
use stillpoint_report::html;
use stillpoint_report::page::{Block, Cell, Table};

use super::super::page::histogram::Histograms;
use super::super::page::{parts, section};
use super::NAMES;
use super::compared::Compared;
use super::side_by_side::SideBySide;
use crate::exit::Failure;

/// The page.
pub fn page(side_by_side: &SideBySide<'_>) -> Result<String, Failure> {
    let mut plans = Table::new("Both plans", &["", NAMES[0], NAMES[1]]);
    for (name, values) in side_by_side.rows() {
        plans.row([Cell::text(name)].into_iter().chain(values.map(Cell::text)));
    }
    let mut summary = vec![Block::Table(plans)];
    summary.extend(side_by_side.notes().into_iter().map(Block::Warning));
    let [a, b] = side_by_side.plans;
    let histograms = Histograms {
        lines: curves(a),
        dashes: curves(b),
        prescription: &a.file.prescription,
        limits: a.limits(),
    };
    let [of_a, of_b] = side_by_side.limits();
    let limits = if of_a.is_empty() {
        Block::Text("Neither plan was compared with a protocol.".to_owned())
    } else {
        let values = [(NAMES[0], of_a.clone()), (NAMES[1], of_b.clone())];
        let results = [("result of A", of_a), ("result of B", of_b)];
        Block::Table(parts::limits("Limits of the protocols".to_owned(), &values, &results))
    };
    let rows = side_by_side.structures().map(|(names, figures)| (names.map(str::to_owned).to_vec(), figures));
    let figures = parts::figures("Figures by structure", &["structure", "plan"], rows);
    let sections = [
        section("plans", "Plans", summary)?,
        section(
            "dvh",
            "Dose-volume histograms",
            vec![histograms.draw("Lines: plan A. Dashed lines: plan B.")?],
        )?,
        section("limits", "Limits", vec![limits])?,
        section("figures", "Figures", vec![Block::Table(figures)])?,
    ];
    let about = "Research only: no plan made by stillpoint may treat a patient.";
    Ok(html::page(&format!("Two plans of {}", a.case().name), about, &sections))
}

fn curves(plan: &Compared) -> Vec<(&str, Vec<(f64, f64)>)> {
    let curve = |histogram: &'_ Histogram| histogram.points();
    plan.shown().histograms.iter().map(|h| (&h.structure[..], curve(h))).collect()
}
