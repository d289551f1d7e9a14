//! `plan.html` of a plan in arcs.

use stillpoint_plan::arc::{ArcBeam, ArcPoint, REPORTED_DEG};
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_report::html;
use stillpoint_report::page::{Block, Section, Tile};

use super::super::arc::outcome::ArcOutcome;
use super::super::charts::up_to_gy;
use super::super::request::Request;
use super::histogram::{Histograms, curves};
use super::{parts, section, setup, slices};
use crate::exit::Failure;
use crate::picture::Plane;
use slices::Dosed;

/// The page.
pub fn page(request: &Request, notes: &[String], outcome: &ArcOutcome<'_>) -> Result<String, Failure> {
    let sections = [
        summary(request, outcome)?,
        section("setup", "Setup", setup::of_arcs(request, notes))?,
        doses(request, outcome)?,
        section("dvh", "Dose-volume histograms", vec![drawn(request, outcome)?])?,
        super::judged(request, &outcome.objectives, &[("arcs", &outcome.judged)], &outcome.judged)?,
        section("arcs", "Arcs", arcs(outcome)?)?,
        figures(outcome)?,
    ];
    let about =
        format!("Arcs {}. Research only: no plan made by stillpoint may treat a patient.", outcome.arcs());
    Ok(html::page(&format!("Plan of {}", request.setup.case.name()), &about, &sections))
}

/// The histograms as a picture of their own.
pub fn histograms(request: &Request, outcome: &ArcOutcome<'_>) -> Result<String, Failure> {
    let up_to = up_to_gy(outcome.given.histograms.iter().map(|(_, dvh)| dvh));
    let lines = curves(&outcome.given.histograms, up_to);
    let series =
        lines.into_iter().map(|(name, points)| Series { name: name.to_owned(), points, style: Style::Line });
    let chart = Chart {
        title: format!("{}, arcs {}", request.setup.case.name(), outcome.arcs()),
        x: "dose, Gy".into(),
        y: "volume with at least this dose, %".into(),
        series: series.collect(),
    };
    let colours: Vec<usize> = (0..chart.series.len()).collect();
    chart.svg_with_legend_aside(960, 520, &colours).map_err(Failure::failed)
}

fn drawn(request: &Request, outcome: &ArcOutcome<'_>) -> Result<Block, Failure> {
    let up_to = up_to_gy(outcome.given.histograms.iter().map(|(_, dvh)| dvh));
    let histograms = Histograms {
        lines: curves(&outcome.given.histograms, up_to),
        dashes: Vec::new(),
        prescription: request.setup.case.prescription(),
        limits: &outcome.judged,
    };
    histograms.draw("Lines: the dose of the arcs.")
}

fn summary(request: &Request, outcome: &ArcOutcome<'_>) -> Result<Section, Failure> {
    let mut tiles = Vec::new();
    for target in outcome.figures.iter().filter(|f| f.prescribed_gy.is_some()) {
        let covered = 100.0 * target.covered.unwrap_or_default();
        tiles.push(Tile::plain(&format!("{}, V95%", target.name), format!("{covered:.1} %")));
        tiles.push(Tile::plain(&format!("{}, D95%", target.name), format!("{:.1} Gy", target.d95_gy)));
    }
    if let Some(protocol) = request.protocol() {
        let count = |requested| outcome.judged.iter().filter(|j| j.passed == Some(requested)).count();
        let text = format!("{} passed, {} failed", count(true), count(false));
        tiles.push(Tile::state(&format!("limits of {}", protocol.name), text, count(false) == 0));
    }
    tiles.push(Tile::plain("delivery, beam on", format!("{:.0} s", outcome.seconds())));
    tiles.push(Tile::plain("monitor units a fraction", format!("{:.0}", outcome.units())));
    tiles.push(Tile::plain("objective", format!("{:.1}", outcome.planned.objective)));
    let spacing = &outcome.planned.spacing;
    let message = format!(
        "Figures, slices and limits are of the dose of the arcs at angles of at most {REPORTED_DEG} degrees, computed by the engine {} \
         on a grid of {:.2} mm. With half as many angles, points differ by {:.2} Gy (root of the mean square) and at most {:.2} Gy.",
        request.setup.engine_name(),
        outcome.grid().spacing_mm[0],
        spacing.rms_gy,
        spacing.largest_gy
    );
    let mut blocks = vec![Block::Tiles(tiles), Block::Text(message)];
    blocks.extend(outcome.caution(request).map(|caution| Block::Warning(format!("Caution: {caution}."))));
    blocks.extend(super::checked(&outcome.checked, request.accept_check.as_deref()));
    section("summary", "Summary", blocks)
}

fn doses(request: &Request, outcome: &ArcOutcome<'_>) -> Result<Section, Failure> {
    let prescribed_gy = request.setup.prescribed_gy();
    let dosed = Dosed { case: &request.setup.case, grid: outcome.grid(), gray: &outcome.gray, prescribed_gy };
    let legend = super::legend(&outcome.given.histograms, prescribed_gy);
    let mut blocks = vec![Block::Drawing(legend, String::new())];
    for plane in Plane::ALL {
        blocks.push(slices::stack(&dosed, plane)?);
    }
    section("dose", "Dose", blocks)
}

fn figures(outcome: &ArcOutcome<'_>) -> Result<Section, Failure> {
    let table = |caption: &str, figures: &[stillpoint_plan::evaluation::StructureDose]| {
        let rows = figures.iter().map(|f| (vec![f.name.clone()], f));
        Block::Table(parts::figures(caption, &["structure"], rows))
    };
    let mut blocks = vec![table("Arcs", &outcome.figures)];
    blocks.extend(outcome.reference.as_ref().map(|figures| table("Reference dose of the case", figures)));
    blocks.push(Block::Table(parts::volumes(&outcome.figures)));
    section("figures", "Figures", blocks)
}

/// For each arc the leaves, the dose rate and the speeds over the angle.
fn arcs(outcome: &ArcOutcome<'_>) -> Result<Vec<Block>, Failure> {
    let mut blocks = Vec::new();
    for beam in &outcome.planned.beams {
        blocks.push(Block::Heading(format!("Arc {}", beam.spec)));
        blocks.push(Block::Chart(
            leaves(beam),
            "Tips of the leaf pairs that open widest, and of the pair in the middle of the field, over the gantry angle.".to_owned(),
        ));
        let turned = |of: &dyn Fn(f64, &stillpoint_plan::dose::Stretch) -> f64, name: &str| {
            let mut points = Vec::new();
            for (pair, stretch) in beam.points.windows(2).zip(beam.stretches()) {
                let value = of(outcome.limits.seconds(&stretch), &stretch);
                points.extend([(pair[0].gantry_deg, value), (pair[1].gantry_deg, value)]);
            }
            Series { name: name.to_owned(), points, style: Style::Line }
        };
        let chart = |y: &str, series: Vec<Series>| Chart {
            title: String::new(),
            x: "gantry, degrees (they run on beyond 360)".to_owned(),
            y: y.to_owned(),
            series,
        };
        let rate = turned(&|s, stretch| 60.0 * stretch.units / s, "dose rate");
        blocks.push(Block::Chart(chart("MU/min", vec![rate]), "Dose rate.".to_owned()));
        let speeds = vec![
            turned(&|s, stretch| stretch.degrees / s, "gantry, degrees/s"),
            turned(&|s, stretch| stretch.travel_mm / s, "fastest leaf, mm/s"),
        ];
        let caption = format!(
            "Speeds where each stretch takes as long as the slowest of gantry, leaves and dose rate needs: {:.0} s in all.",
            beam.seconds(&outcome.limits)
        );
        blocks.push(Block::Chart(chart("speed", speeds), caption));
    }
    Ok(blocks)
}

/// Lowest and highest tip of the whole field, and both tips of its middle pair.
fn leaves(beam: &ArcBeam) -> Chart {
    let is_open = |tips: &&[f64; 2]| tips[0] < tips[1];
    let of = |name: &str, place: &dyn Fn(&ArcPoint) -> f64| Series {
        name: name.to_owned(),
        points: beam.points.iter().map(|point| (point.gantry_deg, place(point))).collect(),
        style: Style::Line,
    };
    let opened: Vec<usize> = (0..beam.points.first().map_or(0, |point| point.tips_mm.len()))
        .filter(|pair| beam.points.iter().any(|point| is_open(&&point.tips_mm[*pair])))
        .collect();
    let middle = opened.get(opened.len() / 2).copied().unwrap_or_default();
    let low =
        |point: &ArcPoint| point.tips_mm.iter().filter(is_open).map(|tips| tips[0]).fold(f64::NAN, f64::min);
    let high =
        |point: &ArcPoint| point.tips_mm.iter().filter(is_open).map(|tips| tips[1]).fold(f64::NAN, f64::max);
    Chart {
        title: String::new(),
        x: "gantry, degrees (they run on beyond 360)".to_owned(),
        y: "tip, mm".to_owned(),
        series: vec![
            of("lowest tip of an open pair", &low),
            of("highest tip of an open pair", &high),
            of("lower tip of the middle pair", &|point| point.tips_mm[middle][0]),
            of("higher tip of the middle pair", &|point| point.tips_mm[middle][1]),
        ],
    }
}
