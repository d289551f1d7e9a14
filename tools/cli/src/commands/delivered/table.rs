//! The figures of a delivered dose, for people.

use stillpoint_patient::case::Role;
use stillpoint_plan::evaluation::StructureDose;

use super::outcome::{INTERPLAY, MotionTime, Outcome};
use super::plan_file::DeliveredPlan;
use super::recorded::Recorded;
use super::reference::Reference;
use crate::columns::{Columns, Side};

/// Prints it.
pub fn print(outcome: &Outcome<'_>, plan: &DeliveredPlan, reference: &Reference, recorded: &Recorded) {
    outln!(
        "{}: {} beams at couch {} degrees, {} fractions; poses of {}, relative to the planning CT {} ({})",
        outcome.case.name(),
        plan.beams.len(),
        reference.couch_deg,
        plan.fractions,
        reference.poses,
        reference.surface,
        match reference.is_case {
            Some(_) => "the case of the plan",
            None => "a mesh: its patient cannot be compared with the case",
        }
    );
    outln!(
        "beam on at {} for {:.2} s, of which {:.2} s have no pose; {:.2} s with a pose after arming ({})",
        recorded.beam,
        outcome.on.seconds + recorded.on.unknown_ns as f64 * 1e-9,
        recorded.on.unknown_ns as f64 * 1e-9,
        outcome.armed.seconds,
        recorded.armed_since
    );
    if let Some(units) = plan.monitor_units() {
        outln!(
            "planned meterset of a fraction: {units:.1} monitor units; over the beam-on time of this session {:.0} a minute",
            60.0 * units / outcome.on.seconds
        );
    }
    outln!("\nmotion at the isocentre from the planned set-up, along and about left, back, head:\n");
    motion(outcome);
    outln!(
        "\ndose of all fractions as if each had this motion, Gy, on a grid of {:.2} mm:\n",
        plan.recompute.grid().spacing_mm[0]
    );
    structures(outcome);
    outln!(
        "D98 is the dose that 98 % of the structure receive at least, D0.03 that of 0.03 cm3; without gating: over all time after arming"
    );
    outln!(
        "shifted cloud: the planned dose moved by the shifts alone; where at least half of the prescription is planned, the \
         delivered dose differs from it by {:.3} Gy (root mean square) and {:.2} Gy (largest)",
        outcome.from_cloud_gy[0],
        outcome.from_cloud_gy[1]
    );
    outln!("interplay: {INTERPLAY}");
}

fn motion(outcome: &Outcome<'_>) {
    let numbers = ["x mm", "y mm", "z mm", "x deg", "y deg", "z deg", "bins"].map(|name| (Side::Right, name));
    let mut rows = Columns::new([(Side::Left, "time"), (Side::Left, "")].into_iter().chain(numbers));
    let mut add = |name: &str, time: &MotionTime| {
        let parts =
            [("mean", &time.mean), ("standard deviation", &time.deviation), ("largest", &time.largest)];
        for (place, (what, numbers)) in parts.into_iter().enumerate() {
            let bins = if place == 0 { time.bins.len().to_string() } else { String::new() };
            let mut row = vec![if place == 0 { name.to_owned() } else { String::new() }, what.to_owned()];
            row.extend(numbers.iter().map(|number| format!("{number:.3}")));
            row.push(bins);
            rows.row(row);
        }
    };
    add("delivered", &outcome.on);
    add("without gating", &outcome.armed);
    out!("{rows}");
}

type Read = fn(&StructureDose) -> f64;

fn structures(outcome: &Outcome<'_>) {
    let doses = outcome.doses.iter().map(|dose| (Side::Right, dose.name));
    let mut rows = Columns::new([(Side::Left, "structure"), (Side::Left, "")].into_iter().chain(doses));
    let [planned, ..] = &outcome.doses;
    for (place, structure) in planned.figures.iter().enumerate().filter(|(_, s)| s.role != Role::External) {
        let of_target: &[(&str, Read)] =
            &[("D98", |f| f.d98_gy), ("D50", |f| f.d50_gy), ("D0.03", |f| f.d003cc_gy)];
        let of_organ: &[(&str, Read)] = &[("mean", |f| f.mean_gy), ("D0.03", |f| f.d003cc_gy)];
        let figures = if structure.role == Role::Target { of_target } else { of_organ };
        for (line, (what, read)) in figures.iter().enumerate() {
            let name = if line == 0 { structure.name.clone() } else { String::new() };
            let mut row = vec![name, (*what).to_owned()];
            row.extend(outcome.doses.iter().map(|dose| format!("{:.2}", read(&dose.figures[place]))));
            rows.row(row);
        }
    }
    out!("{rows}");
}
