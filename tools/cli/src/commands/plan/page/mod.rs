//! `plan.html`: a plan as one self-contained page.
//!
//! - `arc`: the page of a plan in arcs
//! - `slices`: the image with isodose lines; `eye`: fluence in beam's-eye view
//! - `histogram`: planned and sequenced doses with prescriptions and limits
//! - `beams`: angles, what each is worth, its fluence
//! - `setup`: prescription, machine, objectives, notes
//! - `parts`: tables of limits and figures

pub mod arc;
mod beams;
mod eye;
pub mod histogram;
pub mod parts;
pub mod setup;
mod slices;

use serde_json::Value;
use stillpoint_patient::case::Structure;
use stillpoint_plan::check::Checked;
use stillpoint_plan::evaluation::StructureDose;
use stillpoint_plan::metrics::Dvh;
use stillpoint_plan::objectives::ObjectiveResult;
use stillpoint_plan::protocol::Judged;
use stillpoint_report::html;
use stillpoint_report::page::{Block, Section, Tile};
use stillpoint_report::themed;

use super::charts;
use super::outcome::Outcome;
use super::prepared::Prepared;
use super::request::Request;
use super::table::{angles, with_leaves};
use super::tree;
use crate::exit::Failure;
use crate::picture::Plane;
use slices::{Dosed, ISODOSES};

/// The page of a plan.
pub fn page(request: &Request, prepared: &Prepared, outcome: &Outcome<'_>) -> Result<String, Failure> {
    let sections = [
        summary(request, outcome)?,
        section("setup", "Setup", setup::blocks(request, &prepared.notes))?,
        doses(request, prepared, outcome)?,
        section("dvh", "Dose-volume histograms", histogram::blocks(request, outcome)?)?,
        limits(request, outcome)?,
        section("beams", "Beams", beams::blocks(request, prepared, outcome)?)?,
        search(request, outcome)?,
        figures(outcome)?,
    ];
    let name = request.setup.case.name();
    let about = format!(
        "Beams {} by {}. Research only: no plan made by stillpoint may treat a patient.",
        angles(&outcome.angles),
        outcome.run.name.word()
    );
    Ok(html::page(&format!("Plan of {name}"), &about, &sections))
}

/// A section with these blocks.
pub fn section(id: &'static str, title: &'static str, blocks: Vec<Block>) -> Result<Section, Failure> {
    let section = Section::new(id, title, &Value::Null).map_err(Failure::failed)?;
    Ok(blocks.into_iter().fold(section, Section::with))
}

/// The dose that the page shows: of the segments where there are some.
fn shown<'a>(outcome: &'a Outcome<'_>) -> (&'a [f32], &'a [StructureDose], &'a [Judged]) {
    match &outcome.leaves {
        Some(leaves) => (&leaves.gray, &leaves.figures, &leaves.limits),
        None => (&outcome.gray[0], &outcome.figures, &outcome.limits),
    }
}

fn summary(request: &Request, outcome: &Outcome<'_>) -> Result<Section, Failure> {
    let (_, figures, limits) = shown(outcome);
    let mut tiles = Vec::new();
    for target in figures.iter().filter(|f| f.prescribed_gy.is_some()) {
        let covered = 100.0 * target.covered.unwrap_or_default();
        tiles.push(Tile::plain(&format!("{}, V95%", target.name), format!("{covered:.1} %")));
        tiles.push(Tile::plain(&format!("{}, D95%", target.name), format!("{:.1} Gy", target.d95_gy)));
    }
    if let Some(protocol) = request.protocol() {
        let count = |requested| limits.iter().filter(|j| j.passed == Some(requested)).count();
        let text = format!("{} passed, {} failed", count(true), count(false));
        tiles.push(Tile::state(&format!("limits of {}", protocol.name), text, count(false) == 0));
    }
    if let Some(leaves) = &outcome.leaves {
        let (segments, units) = leaves.totals();
        let [opaque, loss] = leaves.losses().map(|part| 100.0 * part);
        tiles.push(Tile::plain("segments", segments.to_string()));
        tiles.push(Tile::plain("monitor units a fraction", format!("{units:.0}")));
        tiles.push(Tile::plain(
            "objective lost by leaves",
            format!("{opaque:.1} %, {loss:.1} % with transmission"),
        ));
    }
    let which = if outcome.leaves.is_some() { "segments" } else { "planned fluence" };
    let message = format!(
        "Figures, slices and limits are of the dose of the {which}, computed by the engine {} on a grid of {:.2} mm.",
        request.setup.engine_name(),
        outcome.grid().spacing_mm[0]
    );
    let mut blocks = vec![Block::Tiles(tiles), Block::Text(message)];
    blocks.extend(outcome.caution(request).map(|caution| Block::Warning(format!("Caution: {caution}."))));
    blocks.extend(checked(&outcome.checked, request.accept_check.as_deref()));
    section("summary", "Summary", blocks)
}

/// What the check of a plan found.
fn checked(checked: &Checked, accepted: Option<&str>) -> Vec<Block> {
    if checked.faults.is_empty() {
        return vec![Block::Text("The plan check has passed.".to_owned())];
    }
    let end = accepted.map_or(String::new(), |reason| format!(" (accepted: {reason})"));
    let faults = checked.faults.iter();
    faults.map(|fault| Block::Warning(format!("Plan check refused{end}: {fault}"))).collect()
}

fn doses(request: &Request, prepared: &Prepared, outcome: &Outcome<'_>) -> Result<Section, Failure> {
    let (gray, _, _) = shown(outcome);
    let case = &request.setup.case;
    let dosed = Dosed { case, grid: outcome.grid(), gray, prescribed_gy: prepared.prescribed_gy };
    let mut blocks =
        vec![Block::Drawing(legend(&outcome.given[0].histograms, prepared.prescribed_gy), String::new())];
    for plane in Plane::ALL {
        blocks.push(slices::stack(&dosed, plane)?);
    }
    blocks.push(Block::Text(
        "The page opens on the slices through the isocentre. Marks above a picture choose the slice; after a click on one, \
         arrow keys go through them. The wash of colours is the dose from 10 % of the prescription on."
            .to_owned(),
    ));
    section("dose", "Dose", blocks)
}

/// Names of structures and isodoses with their colours.
fn legend(histograms: &[(&Structure, Dvh)], prescribed_gy: f64) -> String {
    use std::fmt::Write;
    let (mut x, mut y, mut svg) = (0.0, 14.0, String::new());
    let mut entry = |colour: &str, dashes: &str, name: &str, svg: &mut String| {
        let width = 34.0 + 7.2 * name.chars().count() as f64;
        if x + width > 880.0 {
            (x, y) = (0.0, y + 20.0);
        }
        let _ = write!(
            svg,
            "<path d=\"M{x:.0} {0:.0}h20\" stroke=\"{colour}\" stroke-width=\"3\" stroke-dasharray=\"{dashes}\"/>\
             <text x=\"{1:.0}\" y=\"{y:.0}\" font-size=\"13\" fill=\"var(--ink)\">{2}</text>",
            y - 4.0,
            x + 26.0,
            stillpoint_report::escape(name)
        );
        x += width + 12.0;
        y
    };
    let mut bottom = 14.0;
    for (number, (structure, _)) in histograms.iter().enumerate() {
        let colour = slices::on_dark(number).replace("#ffffff", "var(--ink)");
        bottom = entry(&colour, "none", &structure.name, &mut svg);
    }
    for (percent, colour) in ISODOSES {
        let name = format!("{percent} % = {:.1} Gy", 0.01 * percent * prescribed_gy);
        bottom = entry(colour, if percent >= 95.0 { "none" } else { "4 2" }, &name, &mut svg);
    }
    format!(
        "<svg viewBox=\"0 0 900 {0:.0}\" width=\"900\" role=\"img\" aria-label=\"legend\">{svg}</svg>",
        bottom + 8.0
    )
}

fn limits(request: &Request, outcome: &Outcome<'_>) -> Result<Section, Failure> {
    let (_, _, shown) = shown(outcome);
    let segments = outcome.leaves.as_ref().map(|leaves| ("segments", &leaves.limits[..]));
    let values: Vec<_> = std::iter::once(("planned", &outcome.limits[..])).chain(segments).collect();
    judged(request, &outcome.objectives, &values, shown)
}

/// The limits of the protocol with the values of some doses, and of which of them the results are; then the objectives.
fn judged(
    request: &Request,
    objectives: &[ObjectiveResult],
    values: &[(&str, &[Judged])],
    shown: &[Judged],
) -> Result<Section, Failure> {
    let objectives = parts::objectives(objectives).map(Block::Table);
    let first = match request.protocol() {
        None => {
            let none = "No built-in protocol belongs to the site of this case; --protocol gives one.";
            Block::Text(none.to_owned())
        }
        Some(protocol) => {
            let all = |limits: &[Judged]| limits.iter().cloned().map(Some).collect::<Vec<_>>();
            let values: Vec<_> = values.iter().map(|(name, limits)| (*name, all(limits))).collect();
            let caption = format!("Limits of the protocol {}", protocol.name);
            Block::Table(parts::limits(caption, &values, &[("result", all(shown))]))
        }
    };
    section("limits", "Limits", std::iter::once(first).chain(objectives).collect())
}

fn search(request: &Request, outcome: &Outcome<'_>) -> Result<Section, Failure> {
    let run = outcome.run;
    let certificate = &run.choice.best.plan.certificate;
    let chart = charts::objective(request, run).map_err(Failure::failed)?;
    let ended = if run.choice.spent { "its budget was spent" } else { "there was nothing more to try" };
    let by_engine =
        request.searched_by.map_or(String::new(), |engine| format!(" on doses by the engine {engine}"));
    let found = match request.has_weights {
        true => "Beams and weights were given; nothing was optimised.".to_owned(),
        false => format!(
            "The search by {}{}{by_engine} ended after {} solves and {} prices, when {ended}. It does not prove that no other \
             set of beams is better.",
            run.name.word(),
            with_leaves(run),
            run.solves(),
            run.prices
        ),
    };
    let proved = format!(
        "Certificate: the objective of the planned fluence is {:.6}, proved to be at most {:.1e} (relative {:.1e}) above the \
         optimum of these beams{}. The largest violation of the optimality conditions is {:.1e}.",
        certificate.objective,
        certificate.excess,
        certificate.excess / certificate.objective,
        if run.choice.best.plan.rounds > 1 { " for the chosen voxels of its DVH points" } else { "" },
        certificate.kkt
    );
    let drawing = Block::Drawing(
        themed(&chart),
        "Objective of each set of beams, in the order of the solves.".to_owned(),
    );
    let mut blocks = vec![drawing];
    if let Some(tree) = tree::drawing(&run.directions, request.beams, &run.history) {
        let message = "Sets from which others were solved, each below the set from which it was reached by exchanging beams; bold: \
                    the way to the best set. Bars: solves below each set.";
        blocks.push(Block::Drawing(themed(&tree), message.to_owned()));
    }
    blocks.extend([Block::Text(found), Block::Text(proved)]);
    blocks.extend(outcome.worst_case(request).map(Block::Text));
    section("search", "Search and certificate", blocks)
}

fn figures(outcome: &Outcome<'_>) -> Result<Section, Failure> {
    let table = |caption: &str, figures: &[StructureDose]| {
        let rows = figures.iter().map(|f| (vec![f.name.clone()], f));
        Block::Table(parts::figures(caption, &["structure"], rows))
    };
    let mut blocks = vec![table("Planned fluence", &outcome.figures)];
    blocks.extend(outcome.leaves.as_ref().map(|leaves| table("Segments", &leaves.figures)));
    blocks.extend(outcome.reference.as_ref().map(|figures| table("Reference dose of the case", figures)));
    let (_, shown, _) = shown(outcome);
    blocks.push(Block::Table(parts::volumes(shown)));
    section("figures", "Figures", blocks)
}
