//! The figures of arcs, for people.

use std::fmt::Write;

use super::super::prepared::volumes_at_gy;
use super::super::request::Request;
use super::super::table;
use super::outcome::ArcOutcome;
use crate::columns::{Columns, Side};

/// What was found.
pub fn text(request: &Request, outcome: &ArcOutcome<'_>) -> String {
    let planned = &outcome.planned;
    let first = planned.objectives.first().copied().unwrap_or_default();
    let last = planned.objectives.last().copied().unwrap_or_default();
    let mut text = format!(
        "\n{}: arcs {}, objective {:.4}, {:.0} monitor units a fraction, {:.0} s with the beam on\n\
         leaves: objective of the search from {first:.1} to {last:.1} in {} rounds, at {} points\n\n",
        request.setup.case.name(),
        outcome.arcs(),
        planned.objective,
        outcome.units(),
        outcome.seconds(),
        planned.objectives.len().saturating_sub(1),
        planned.points
    );
    let head = ["monitor units", "s", "control points", "greatest MU/min", "greatest leaf speed, mm/s"];
    let head = head.map(|name| (Side::Right, name));
    let mut arcs = Columns::new([(Side::Left, "arc")].into_iter().chain(head));
    for beam in &planned.beams {
        let stretches = beam.stretches();
        let most = |of: &dyn Fn(f64, &stillpoint_plan::dose::Stretch) -> f64| {
            stretches.iter().map(|s| of(outcome.limits.seconds(s), s)).fold(0.0, f64::max)
        };
        arcs.row([
            beam.spec.to_string(),
            format!("{:.0}", beam.units()),
            format!("{:.0}", beam.seconds(&outcome.limits)),
            beam.points.len().to_string(),
            format!("{:.0}", most(&|s, stretch| 60.0 * stretch.units / s)),
            format!("{:.1}", most(&|s, stretch| stretch.travel_mm / s)),
        ]);
    }
    let _ = write!(text, "{arcs}");
    let _ = write!(
        text,
        "\ndose ({}) at angles of at most {} degrees, on a grid of {:.2} mm; with half as many angles, points differ by {:.2} Gy \
         (root of the mean square) and at most {:.2} Gy:\n\n",
        request.setup.engine_name(),
        stillpoint_plan::arc::REPORTED_DEG,
        outcome.grid().spacing_mm[0],
        planned.spacing.rms_gy,
        planned.spacing.largest_gy
    );
    if let Some(caution) = outcome.caution(request) {
        let _ = write!(text, "caution: {caution}\n\n");
    }
    let volumes = volumes_at_gy(request.setup.prescribed_gy());
    let of = |figures: &[stillpoint_plan::evaluation::StructureDose]| {
        let rows = figures.iter().map(|f| (vec![f.name.clone()], f));
        table::of_structures(&["structure"], rows, &volumes).to_string()
    };
    text += &of(&outcome.figures);
    text += &format!("{}\n", table::HEADINGS);
    if let Some(fall_off) = &outcome.given.fall_off {
        text += &format!("{}\n", table::describe(fall_off));
    }
    text += &table::objectives(&outcome.objectives);
    if let Some(protocol) = request.protocol() {
        text += &table::limits(&protocol.name, "arcs", &outcome.judged, &request.setup.served);
    }
    text += &table::check(&outcome.checked, request.accept_check.as_deref());
    if let Some(reference) = &outcome.reference {
        text += &format!("\nthe reference dose of the case, on the same grid:\n\n{}", of(reference));
    }
    text
}
