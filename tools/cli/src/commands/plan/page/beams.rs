//! The beams of a plan: angles, what each is worth, its fluence.

use stillpoint_plan::Setups;
use stillpoint_plan::beams::Influence;
use stillpoint_plan::dose::BeamAngles;
use stillpoint_plan::fluence::{Options, solve_plan};
use stillpoint_report::page::{Block, Cell, Table};

use super::super::leaves::Leaves;
use super::super::outcome::Outcome;
use super::super::prepared::Prepared;
use super::super::request::Request;
use super::eye;
use crate::exit::Failure;

/// Accuracy of an objective without a beam.
const ACCURACY: Options = Options { tolerance: 1e-3, ..Options::DEFAULT };

pub fn blocks(request: &Request, prepared: &Prepared, outcome: &Outcome<'_>) -> Result<Vec<Block>, Failure> {
    let best = &outcome.run.choice.best;
    let whole: f64 = best.plan.weights.iter().sum();
    let is_coplanar = outcome.angles.iter().all(BeamAngles::is_coplanar);
    let mut columns = vec![
        if is_coplanar { "gantry, degrees" } else { "gantry@couch, degrees" },
        "share of the fluence",
        "objective without it",
    ];
    if outcome.leaves.is_some() {
        columns.extend(["segments", "monitor units"]);
    }
    let caption = "Why these angles: the rise of the objective when a beam is left out and the others are optimised again.";
    let mut table = Table::new(caption, &columns);
    let mut blocks = Vec::new();
    let most = best.plan.weights.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    for beam in best.beams.beams() {
        let weights = best.weights_of(*beam).unwrap_or_default();
        let share = weights.iter().sum::<f64>() / whole;
        let without = match without(request, prepared, outcome, *beam)? {
            Some(cost) => format!("+{:.0} %", 100.0 * (cost / best.solved_cost() - 1.0)),
            None => "-".to_owned(),
        };
        let angles = request.setup.directions.angles(*beam);
        let mut cells = vec![
            Cell::number(angles.to_string()),
            Cell::Bar(share, format!("{:.1} %", 100.0 * share)),
            Cell::number(without),
        ];
        let shaped = outcome.leaves.as_ref().and_then(|l| shaped(l, outcome, *beam));
        if let (Some(leaves), Some(shaped)) = (&outcome.leaves, shaped) {
            cells.push(Cell::number(shaped.segments.len().to_string()));
            cells.push(Cell::number(format!("{:.0}", leaves.beam_units(shaped))));
        } else if outcome.leaves.is_some() {
            cells.extend([Cell::number("0"), Cell::number("0")]);
        }
        table.row(cells);
        let fluence = match (shaped, request.collimator()) {
            (Some(shaped), Some(collimator)) => Some(shaped.fluence(collimator, request.setup.spec.bixel_mm)),
            _ => None,
        };
        let eye = eye::Eye {
            planned: (prepared.doses.solved.bixels_mm(*beam), weights),
            shaped: fluence.as_ref().map(|(bixels, weights)| (&bixels[..], &weights[..])),
            width_mm: request.setup.spec.bixel_mm,
            most,
        };
        let couch = match angles.is_coplanar() {
            true => String::new(),
            false => format!(", couch {} degrees", angles.couch_deg),
        };
        let caption = format!(
            "Gantry {} degrees{couch}, seen from the source: x of the beam to the right, the gantry up.",
            angles.gantry_deg
        );
        blocks.push(Block::Drawing(eye::draw(&eye), caption));
    }
    blocks.insert(0, Block::Table(table));
    Ok(blocks)
}

fn shaped<'a>(
    leaves: &'a Leaves<'a>,
    outcome: &'a Outcome<'_>,
    beam: u16,
) -> Option<&'a stillpoint_plan::leaves::LeafBeam> {
    leaves.beams(outcome.run).find(|(number, _)| **number == beam).map(|(_, shaped)| shaped)
}

/// The objective of the other beams; nothing where there are none.
fn without(
    request: &Request,
    prepared: &Prepared,
    outcome: &Outcome<'_>,
    beam: u16,
) -> Result<Option<f64>, Failure> {
    let best = &outcome.run.choice.best;
    let others: Vec<u16> = best.beams.beams().iter().copied().filter(|other| *other != beam).collect();
    if others.is_empty() {
        return Ok(None);
    }
    let matrices: Vec<Setups<'_>> = others.iter().map(|other| prepared.doses.solved.beam(*other)).collect();
    let start: Vec<f64> =
        others.iter().flat_map(|other| best.weights_of(*other).unwrap_or_default()).copied().collect();
    let problem = request.setup.goals.problem(&matrices).map_err(Failure::failed)?;
    let plan = solve_plan(&problem, Some(&start), ACCURACY).map_err(Failure::failed)?;
    Ok(Some(plan.certificate.objective))
}
