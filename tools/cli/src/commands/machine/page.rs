//! The page of `stillpoint machine fit`: residuals, curves and spectrum.

use serde_json::Value;
use stillpoint_plan::measured::{Fitted, Residual};
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_report::html;
use stillpoint_report::page::{Block, Cell, Mood, Section, Table};

use super::fit::{HEADINGS, cells, percent, summary, word};
use crate::exit::Failure;

/// The page of a fit.
pub fn page(fitted: &Fitted) -> Result<String, Failure> {
    let section = |id, title, blocks: Vec<Block>| -> Result<Section, Failure> {
        let section = Section::new(id, title, &Value::Null).map_err(Failure::failed)?;
        Ok(blocks.into_iter().fold(section, Section::with))
    };
    let texts = summary(fitted).into_iter().map(Block::Text);
    let mut first: Vec<Block> = vec![Block::Table(table(fitted))];
    first.extend((!fitted.outputs.is_empty()).then(|| Block::Table(outputs(fitted))));
    first.extend(texts);
    let chart = |residual: &Residual| Block::Chart(curve(residual), String::new());
    let sections = [
        section("residuals", "Residuals", first)?,
        section("curves", "Curves", fitted.residuals.iter().map(chart).collect())?,
        section("spectrum", "Spectrum", vec![Block::Chart(spectrum(fitted), String::new())])?,
    ];
    Ok(html::page("Machine fit", &fitted.machine.file().provenance, &sections))
}

fn table(fitted: &Fitted) -> Table {
    let columns: Vec<&str> = HEADINGS.into_iter().chain(["file", "result"]).collect();
    let caption =
        "Computed less measured, in percent of the greatest dose of each curve, or of the dose there";
    let mut table = Table::new(caption, &columns);
    for residual in &fitted.residuals {
        let [name, numbers @ ..] = cells(residual);
        let mood = if residual.beyond_mm.is_none() { Mood::Good } else { Mood::Bad };
        let mut row = vec![Cell::Text(name)];
        row.extend(numbers.into_iter().map(Cell::Number));
        row.push(Cell::Text(format!("{}, line {}", residual.file, residual.line)));
        row.push(Cell::State(mood, word(residual).to_owned()));
        table.rows.push(row);
    }
    table
}

fn outputs(fitted: &Fitted) -> Table {
    let caption = "Output factors: scatter of the machine's head is not modelled";
    let mut table =
        Table::new(caption, &["field", "depth, mm", "measured", "computed", "difference", "result"]);
    for output in &fitted.outputs {
        let [x, y] = output.reading.setup.field_mm;
        table.rows.push(vec![
            Cell::Text(format!("{x} x {y} mm")),
            Cell::Number(output.reading.depth_mm.to_string()),
            Cell::Number(format!("{:.4}", output.reading.value)),
            Cell::Number(format!("{:.4}", output.computed)),
            Cell::Number(percent(output.difference)),
            match (output.is_judged, output.is_beyond) {
                (false, _) => Cell::Text("not judged".to_owned()),
                (true, false) => Cell::State(Mood::Good, "pass".to_owned()),
                (true, true) => Cell::State(Mood::Bad, "FAIL".to_owned()),
            },
        ]);
    }
    table
}

fn curve(residual: &Residual) -> Chart {
    let series = |name: &str, style, of: &dyn Fn(&stillpoint_plan::measured::ResidualPoint) -> f64| Series {
        name: name.to_owned(),
        points: residual.points.iter().map(|point| (point.at_mm, 100.0 * of(point))).collect(),
        style,
    };
    Chart {
        title: residual.name.clone(),
        x: if residual.is_profile { "distance from the middle, mm" } else { "depth, mm" }.to_owned(),
        y: "dose, % of the greatest measured".to_owned(),
        series: vec![
            series("measured", Style::Dots, &|point| point.measured),
            series("computed", Style::Line, &|point| point.computed),
            series("computed less measured, times 10", Style::Dashed, &|point| {
                10.0 * (point.computed - point.measured)
            }),
        ],
    }
}

fn spectrum(fitted: &Fitted) -> Chart {
    let points = fitted
        .machine
        .file()
        .superposition
        .iter()
        .flat_map(|section| section.energy_mev.iter().copied().zip(section.photons.iter().copied()));
    Chart {
        title: "Photons at the surface".to_owned(),
        x: "energy, MeV".to_owned(),
        y: "part of the photons".to_owned(),
        series: vec![Series { name: "fitted".to_owned(), points: points.collect(), style: Style::Line }],
    }
}
