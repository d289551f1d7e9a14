//! A sweep over all tips: each moves to where the objective is less, with the others where they are.
//!
//! The dose is piecewise linear in a tip, with a bend at each edge of a cell. Tips often are at such edges, so slopes are taken to
//! both sides. A step is that of Newton's method, as far as the limits of the machine allow; its exact change of the dose is
//! weighed, and it is made only if the objective falls.

use super::field::{ArcField, Interval, part};
use super::trajectory::{Bounds, Trajectory};
use crate::fluence::{DoseChange, RunningCost};

/// Longest step, mm.
const LONGEST_MM: f64 = 8.0;
/// Shortest step, mm.
const SHORTEST_MM: f64 = 1e-3;
/// How often a step that does not lessen the objective is shortened, and to which part.
const SHORTER: (usize, f64) = (3, 0.35);
/// A tip that is nearer to an edge of a cell is at it, in widths.
const AT_EDGE: f64 = 1e-9;

/// A tip: its control point, its row of leaves, and its bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tip {
    /// Number of the control point.
    pub point: usize,
    /// Number of the row of leaves.
    pub row: usize,
    /// 0 for the tip at lower x, 1 for the other.
    pub bank: usize,
}

/// Sweeps over all tips in this order, or in the opposite one.
pub fn sweep(
    field: &ArcField,
    bounds: &Bounds,
    trajectory: &mut Trajectory,
    running: &mut RunningCost,
    backwards: bool,
) {
    let mut change = DoseChange::new(field.goal_rows());
    let points = field.points.len();
    for number in 0..points {
        let point = if backwards { points - 1 - number } else { number };
        for row in 0..field.rows.len() {
            for bank in 0..2 {
                improve(field, bounds, trajectory, running, Tip { point, row, bank }, &mut change);
            }
        }
    }
}

/// Moves a tip to the side to which the objective falls.
fn improve(
    field: &ArcField,
    bounds: &Bounds,
    trajectory: &mut Trajectory,
    running: &mut RunningCost,
    tip: Tip,
    change: &mut DoseChange,
) {
    for side in [1.0, -1.0] {
        let room_mm = room_mm(field, bounds, trajectory, tip, side).min(LONGEST_MM);
        if room_mm < SHORTEST_MM {
            continue;
        }
        let [slope, curvature] = slope(field, trajectory, running, tip, side, change);
        if slope >= 0.0 {
            continue;
        }
        let mut step_mm = if curvature > 0.0 { (-slope / curvature).min(room_mm) } else { room_mm };
        for _ in 0..=SHORTER.0 {
            if step_mm < SHORTEST_MM {
                break;
            }
            add_move(field, trajectory, tip, side * step_mm, change);
            let added = running.added(change);
            if added < 0.0 {
                running.make(change, added);
                trajectory.tips_mm[tip.point][tip.row][tip.bank] += side * step_mm;
                return;
            }
            step_mm *= SHORTER.1;
        }
    }
}

/// First and second derivative of the cost in the way of a tip to a side, per mm.
pub fn slope(
    field: &ArcField,
    trajectory: &Trajectory,
    running: &RunningCost,
    tip: Tip,
    side: f64,
    change: &mut DoseChange,
) -> [f64; 2] {
    change.clear();
    for (interval, number, own, weight) in sharing(field, trajectory, tip) {
        let place = trajectory.tips_at(interval, number, tip.row)[tip.bank] / field.width_mm + 0.5;
        let cell = match side > 0.0 {
            true => libm::floor(place + AT_EDGE) as i32,
            false => libm::ceil(place - AT_EDGE) as i32 - 1,
        };
        let weight = opens(tip, side) * own * weight * (1.0 - field.transmission) / field.width_mm;
        field.add_cell((interval.doses[number], tip.row, cell), weight, change);
    }
    running.along(change)
}

/// The exact change of the dose when a tip moves by this much.
pub fn add_move(field: &ArcField, trajectory: &Trajectory, tip: Tip, by_mm: f64, change: &mut DoseChange) {
    change.clear();
    let cells = &field.rows[tip.row].cells;
    for (interval, number, own, weight) in sharing(field, trajectory, tip) {
        let before = trajectory.tips_at(interval, number, tip.row)[tip.bank];
        let after = before + own * by_mm;
        let range = [before.min(after), before.max(after)];
        let weight = opens(tip, by_mm) * weight * (1.0 - field.transmission);
        let cell = |mm: f64| libm::floor(mm / field.width_mm + 0.5) as i32;
        for cell in cell(range[0]).max(cells.start)..=cell(range[1]).min(cells.end - 1) {
            let part = field.open(cell, range);
            if part > 0.0 {
                field.add_cell((interval.doses[number], tip.row, cell), weight * part, change);
            }
        }
    }
}

/// 1 where the move of a tip to a side opens, -1 where it closes.
fn opens(tip: Tip, side: f64) -> f64 {
    if (tip.bank == 1) == (side > 0.0) { 1.0 } else { -1.0 }
}

/// The parts of intervals whose dose depends on a tip: the interval, the number of the part, how far the tip at the part follows that of the
/// control point, and the weight of the part.
fn sharing<'a>(
    field: &'a ArcField,
    trajectory: &'a Trajectory,
    tip: Tip,
) -> impl Iterator<Item = (&'a Interval, usize, f64, f64)> + 'a {
    let point = &field.points[tip.point];
    let of = move |number: usize, is_end: bool| {
        let interval = &field.intervals[number];
        let weight = trajectory.weights[number] / interval.doses.len() as f64;
        (0..interval.doses.len())
            .filter(move |_| weight > 0.0)
            .map(move |at| (interval, at, if is_end { part(at) } else { 1.0 - part(at) }, weight))
    };
    let before = point.before.into_iter().flat_map(move |number| of(number, true));
    before.chain(point.after.into_iter().flat_map(move |number| of(number, false)))
}

/// How far a tip can move to a side, mm.
fn room_mm(field: &ArcField, bounds: &Bounds, trajectory: &Trajectory, tip: Tip, side: f64) -> f64 {
    let Tip { point, row, bank } = tip;
    let at = trajectory.tips_mm[point][row][bank];
    let [low, high] = bounds.ends_mm[point][row][bank];
    let mut room = if side > 0.0 { high - at } else { at - low };
    let partner = trajectory.tips_mm[point][row][1 - bank];
    if opens(tip, side) < 0.0 {
        room = room.min((partner - at).abs() - bounds.gap_mm);
    }
    let mut follow = |other: f64, travel_mm: f64| room = room.min(side * (other - at) + travel_mm);
    let of = &field.points[point];
    if let Some(interval) = of.before {
        follow(trajectory.tips_mm[point - 1][row][bank], bounds.travel_mm[interval]);
    }
    if let Some(interval) = of.after {
        follow(trajectory.tips_mm[point + 1][row][bank], bounds.travel_mm[interval]);
    }
    room
}
