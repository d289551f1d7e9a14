//! Where the search for an arc begins: an aperture after the other, each at the control point where it lessens the objective
//! most (column generation: Romeijn, Ahuja, Dempsey, Kumar, SIAM J. Optim. 15 (2005) 838; for arcs with bounds of the leaves'
//! way to apertures that are there: Peng et al., Phys. Med. Biol. 57 (2012) 4569).
//!
//! An aperture counts here as if it stood still for half an interval to both sides. That is a start and not a result: what is
//! delivered between two control points is other than both.

use std::num::NonZeroUsize;

use super::ArcError;
use super::field::{ArcField, PARTS};
use super::trajectory::{Bounds, Trajectory};
use super::weights::{ArcColumns, solved};
use crate::fluence::Goals;
use crate::threads::on_threads;

/// Apertures of one pricing, and the control points that they are apart.
const AT_ONCE: (usize, usize) = (3, 8);

/// What tips may be off by rounding, mm.
const ROUNDING_MM: f64 = 1e-9;

/// Apertures that are placed, by control point.
type Placed = Vec<Option<Vec<[f64; 2]>>>;

/// Apertures by price, in between tips that move evenly, and weights of intervals from those of the apertures.
///
/// # Errors
/// The goals make no problem.
pub fn start(
    field: &ArcField,
    goals: &Goals,
    bounds: &Bounds,
    threads: NonZeroUsize,
) -> Result<Trajectory, ArcError> {
    let count = field.points.len();
    let mut placed: Placed = vec![None; count];
    let mut order: Vec<usize> = Vec::new();
    let mut columns = ArcColumns::default();
    let mut weights: Vec<f64> = Vec::new();
    let problem = goals.problem(&[])?;
    let mut running = problem.running(vec![0.0; field.goal_rows()]);
    while order.len() < count {
        let pull = running.pull();
        let angles: Vec<usize> = (0..field.doses.len()).collect();
        let slopes = on_threads(&angles, threads, |at| Ok::<_, ArcError>(field.slopes(*at, &pull)))?;
        let free: Vec<usize> = (0..count).filter(|point| placed[*point].is_none()).collect();
        let priced = on_threads(&free, threads, |point| {
            Ok::<_, ArcError>(steepest(field, bounds, &placed, *point, &slopes))
        })?;
        let mut found: Vec<(f64, usize, Vec<[f64; 2]>)> = priced
            .into_iter()
            .zip(free)
            .filter(|((slope, _), _)| *slope < 0.0)
            .map(|((slope, tips), point)| (slope, point, tips))
            .collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let Some(best) = found.first().map(|(slope, ..)| *slope) else { break };
        let mut now: Vec<usize> = Vec::new();
        for (slope, point, tips) in found {
            let is_far = now.iter().all(|other| other.abs_diff(point) >= AT_ONCE.1);
            if now.len() < AT_ONCE.0
                && is_far
                && slope <= 0.5 * best
                && is_reached(field, bounds, &placed, point, &tips)
            {
                columns.push(still_dose(field, point, &tips), goals)?;
                placed[point] = Some(tips);
                order.push(point);
                weights.push(0.0);
                now.push(point);
            }
        }
        weights = solved(goals, &columns, &weights)?;
        running = problem.running(columns.dose(field.goal_rows(), &weights));
    }
    if order.is_empty() {
        return Err(ArcError::NoGain);
    }
    let mut of_point = vec![0.0; count];
    order.iter().zip(&weights).for_each(|(point, weight)| of_point[*point] = *weight);
    let of_interval = |from: usize| 0.5 * (of_point[from] + of_point[from + 1]);
    Ok(Trajectory {
        tips_mm: between(field, bounds, &placed),
        weights: field
            .intervals
            .iter()
            .zip(&bounds.weights)
            .map(|(interval, [least, most])| of_interval(interval.from).clamp(*least, *most))
            .collect(),
    })
}

/// The angles of doses nearest to a control point.
fn nearest(field: &ArcField, point: usize) -> impl Iterator<Item = usize> + '_ {
    let at = &field.points[point];
    let before = at.before.map(|interval| field.intervals[interval].doses[PARTS - 1]);
    before.into_iter().chain(at.after.map(|interval| field.intervals[interval].doses[0]))
}

/// Dose of an aperture that stands still at a control point.
fn still_dose(field: &ArcField, point: usize, tips: &[[f64; 2]]) -> Vec<f64> {
    let mut dose = vec![0.0; field.goal_rows()];
    let share = 1.0 / nearest(field, point).count() as f64;
    nearest(field, point).for_each(|doses| field.add_open(doses, |row| tips[row], share, &mut dose));
    dose
}

/// The aperture of the least slope that the placed ones leave time for, with that slope.
fn steepest(
    field: &ArcField,
    bounds: &Bounds,
    placed: &Placed,
    point: usize,
    slopes: &[Vec<f64>],
) -> (f64, Vec<[f64; 2]>) {
    let share = 1.0 / nearest(field, point).count() as f64;
    let mut slope = 0.0;
    let mut tips = Vec::with_capacity(field.rows.len());
    for row in 0..field.rows.len() {
        let cells = field.rows[row].cells.len();
        let mut sums = vec![0.0; cells + 1];
        for doses in nearest(field, point) {
            for (at, of_cell) in field.of_row(row, &slopes[doses]).iter().enumerate() {
                sums[at + 1] += share * of_cell;
            }
        }
        (0..cells).for_each(|at| sums[at + 1] += sums[at]);
        let allowed = reachable(field, bounds, placed, point, row);
        let (open, best) = least_sum(field, row, &sums, allowed, bounds.gap_mm);
        slope += field.transmission * sums[cells] + (1.0 - field.transmission) * open;
        tips.push(best);
    }
    (slope, tips)
}

/// Where each tip of a row can be at a control point, given the nearest placed apertures of its arc.
fn reachable(field: &ArcField, bounds: &Bounds, placed: &Placed, point: usize, row: usize) -> [[f64; 2]; 2] {
    let mut allowed = bounds.ends_mm[point][row];
    let mut restrict = |travel_mm: f64, tips: &[[f64; 2]]| {
        for bank in 0..2 {
            let [low, high] = allowed[bank];
            let low = low.max(tips[row][bank] - travel_mm);
            // Not below it, whatever the rounding.
            allowed[bank] = [low, high.min(tips[row][bank] + travel_mm).max(low)];
        }
    };
    let (mut at, mut travel_mm) = (point, 0.0);
    while let Some(interval) = field.points[at].before {
        (at, travel_mm) = (at - 1, travel_mm + bounds.travel_mm[interval]);
        if let Some(tips) = &placed[at] {
            restrict(travel_mm, tips);
            break;
        }
    }
    let (mut at, mut travel_mm) = (point, 0.0);
    while let Some(interval) = field.points[at].after {
        (at, travel_mm) = (at + 1, travel_mm + bounds.travel_mm[interval]);
        if let Some(tips) = &placed[at] {
            restrict(travel_mm, tips);
            break;
        }
    }
    allowed
}

/// Whether an aperture keeps the limits at a control point, given the nearest placed ones: the others of its pricing may be new.
fn is_reached(field: &ArcField, bounds: &Bounds, placed: &Placed, point: usize, tips: &[[f64; 2]]) -> bool {
    (0..field.rows.len()).all(|row| {
        let allowed = reachable(field, bounds, placed, point, row);
        let is_within = |bank: usize| {
            let [low, high] = allowed[bank];
            (low - ROUNDING_MM..=high + ROUNDING_MM).contains(&tips[row][bank])
        };
        is_within(0) && is_within(1)
    })
}

/// The sum of slopes up to a place, linear within a cell.
fn sum_to(field: &ArcField, row: usize, sums: &[f64], mm: f64) -> f64 {
    let place = ((mm - field.ends_mm(row)[0]) / field.width_mm).clamp(0.0, (sums.len() - 1) as f64);
    let cell = (place as usize).min(sums.len() - 2);
    sums[cell] + (place - cell as f64) * (sums[cell + 1] - sums[cell])
}

/// Tips within these ends between which the sum of slopes is least; each is at an edge of a cell or at an end. Of equal sums the
/// narrowest opening is taken. A closed row is as near as can be to the middle of its cells.
fn least_sum(
    field: &ArcField,
    row: usize,
    sums: &[f64],
    [lower, upper]: [[f64; 2]; 2],
    gap_mm: f64,
) -> (f64, [f64; 2]) {
    let low_mm = field.ends_mm(row)[0];
    let edges = |[from, to]: [f64; 2]| {
        let mut places = vec![from, to];
        places.extend(
            (0..sums.len()).map(|at| low_mm + at as f64 * field.width_mm).filter(|x| *x > from && *x < to),
        );
        places
    };
    let ends = field.ends_mm(row);
    let middle = 0.5 * (ends[0] + ends[1]);
    // Closed, or as closed as can be.
    let highest = lower[1].min(upper[1] - gap_mm).max(lower[0]);
    let low = (middle - 0.5 * gap_mm).max(upper[0] - gap_mm).clamp(lower[0], highest);
    let high = (low + gap_mm).max(upper[0]);
    let of = |low: f64, high: f64| sum_to(field, row, sums, high) - sum_to(field, row, sums, low);
    let mut best = (of(low, high), [low, high]);
    let highs = edges(upper);
    for low in edges(lower) {
        for high in highs.iter().filter(|high| **high - low >= gap_mm) {
            let sum = of(low, *high);
            let is_narrower = *high - low < best.1[1] - best.1[0] - 1e-9;
            if sum < best.0 - 1e-12 || (sum <= best.0 && is_narrower) {
                best = (sum, [low, *high]);
            }
        }
    }
    best
}

/// Tips of all control points: those that are placed, and between them what moves evenly, as far as their ends allow. Ends move no
/// faster than leaves, so tips that stop at them do not either.
fn between(field: &ArcField, bounds: &Bounds, placed: &Placed) -> Vec<Vec<[f64; 2]>> {
    let count = field.points.len();
    let same_arc = |a: usize, b: usize| field.points[a].arc == field.points[b].arc;
    let of = |point: usize| -> Vec<[f64; 2]> {
        if let Some(tips) = &placed[point] {
            return tips.clone();
        }
        let before = (0..point).rev().take_while(|at| same_arc(*at, point)).find(|at| placed[*at].is_some());
        let after = (point..count).take_while(|at| same_arc(*at, point)).find(|at| placed[*at].is_some());
        let tips = |at: usize, row: usize| placed[at].as_ref().map_or([0.0; 2], |tips| tips[row]);
        let row = |row: usize| match (before, after) {
            (Some(a), Some(b)) => {
                let part = (point - a) as f64 / (b - a) as f64;
                [0, 1].map(|bank| tips(a, row)[bank] + part * (tips(b, row)[bank] - tips(a, row)[bank]))
            }
            (Some(only), None) | (None, Some(only)) => tips(only, row),
            (None, None) => {
                let ends = bounds.ends_mm[point][row];
                let middle = 0.5 * (ends[0][0] + ends[1][1] - bounds.gap_mm);
                [middle, middle + bounds.gap_mm]
            }
        };
        let within = |row: usize, tips: [f64; 2]| {
            let ends = bounds.ends_mm[point][row];
            [0, 1].map(|bank| tips[bank].max(ends[bank][0]).min(ends[bank][1]))
        };
        (0..field.rows.len()).map(|number| within(number, row(number))).collect()
    };
    (0..count).map(of).collect()
}
