//! The page of `stillpoint dose check`: the table of places, and the depth doses and profiles.

use serde_json::Value;
use stillpoint_plan::monte_carlo::{Comparison, VOXEL_MM};
use stillpoint_report::chart::{Chart, Series, Style};
use stillpoint_report::html;
use stillpoint_report::page::{Block, Cell, Mood, Section, Table};

use super::check::{about, bound, percent, places, word};
use crate::exit::Failure;

/// Depth of the profile that is drawn, mm: the nearest one to it.
const PROFILE_MM: f64 = 60.0;

/// The page of a machine.
pub fn page(machine: &str, all: &[Comparison]) -> Result<String, Failure> {
    let section = |id, title, blocks: Vec<Block>| -> Result<Section, Failure> {
        let section = Section::new(id, title, &Value::Null).map_err(Failure::failed)?;
        Ok(blocks.into_iter().fold(section, Section::with))
    };
    let depths = all.iter().map(|one| Block::Chart(depth_dose(one), String::new())).collect();
    let profiles = all.iter().filter_map(|one| Some(Block::Chart(profile(one)?, String::new()))).collect();
    let sections = [
        section("places", "Places", vec![Block::Table(table(all))])?,
        section("depth-doses", "Depth doses", depths)?,
        section("profiles", "Profiles", profiles)?,
    ];
    Ok(html::page(&format!("Dose check of {machine}"), &about(machine), &sections))
}

fn table(all: &[Comparison]) -> Table {
    let columns = ["phantom and field", "place", "superposition", "bound", "pencil beams", "result"];
    let caption = "Deviations from the reference, positive where the dose is too high";
    let mut table = Table::new(caption, &columns);
    for (one, place) in places(all) {
        let mood = match place.is_met() {
            Some(true) => Mood::Good,
            Some(false) => Mood::Bad,
            None => Mood::Plain,
        };
        table.rows.push(vec![
            Cell::Text(one.setting.to_string()),
            Cell::Text(place.name.to_owned()),
            Cell::Number(percent(place.superposition)),
            Cell::Number(bound(place)),
            Cell::Number(percent(place.pencil)),
            Cell::State(mood, word(place).to_owned()),
        ]);
    }
    table
}

fn depth_dose(one: &Comparison) -> Chart {
    chart(
        one.setting.to_string(),
        "depth, mm",
        [&one.reference.axis, &one.superposition.axis, &one.pencil.axis],
    )
}

/// The profile nearest to a depth.
fn profile(one: &Comparison) -> Option<Chart> {
    let off = |depth_mm: f64| (depth_mm - PROFILE_MM).abs();
    let profiles = one.reference.profiles.iter().enumerate();
    let (at, profile) = profiles.min_by(|a, b| off(a.1.depth_mm).total_cmp(&off(b.1.depth_mm)))?;
    let title = format!("{}, {:.0} mm deep", one.setting, profile.depth_mm);
    let doses = [&profile.dose, one.superposition.profiles.get(at)?, one.pencil.profiles.get(at)?];
    Some(chart(title, "distance from the axis, mm", doses))
}

fn chart(title: String, x: &str, [reference, superposition, pencil]: [&Vec<f64>; 3]) -> Chart {
    let series = |name: &str, dose: &[f64], style| {
        let points = dose.iter().enumerate().map(|(i, dose)| ((i as f64 + 0.5) * VOXEL_MM, *dose));
        Series { name: name.to_owned(), points: points.collect(), style }
    };
    Chart {
        title,
        x: x.to_owned(),
        y: "dose, 1e-3 MeV/g per photon/cm2".to_owned(),
        series: vec![
            series("Monte Carlo", reference, Style::Dots),
            series("superposition", superposition, Style::Line),
            series("pencil beams", pencil, Style::Dashed),
        ],
    }
}
