//! Where the leaves are at each control point, and what is given between them.

use super::ArcError;
use super::field::{ArcField, Interval, part};
use super::window::{Room, down};
use crate::dose::{ArcLimits, Collimator, Stretch, farthest_mm};

/// Tips are at whole micrometres in a plan, so that every limit holds in the decimals of a file.
pub const GRID_PER_MM: f64 = 1e3;

/// The leaves and the weights of all arcs.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// For each control point the tips of each row of leaves, those at lower x first, mm.
    pub tips_mm: Vec<Vec<[f64; 2]>>,
    /// For each interval its weight: fluence of the open field, in the unit of bixel weights.
    pub weights: Vec<f64>,
}

/// What a machine allows of a trajectory, in the unit of weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds {
    /// Longest way of a tip in each interval, mm.
    pub travel_mm: Vec<f64>,
    /// Least and largest weight of each interval.
    pub weights: Vec<[f64; 2]>,
    /// Least distance of the tips of a pair, mm.
    pub gap_mm: f64,
    /// The lowest and the highest place of a tip, for each control point, each row of leaves and each bank, mm.
    pub ends_mm: Vec<Vec<[[f64; 2]; 2]>>,
}

impl Bounds {
    /// Those of a machine whose fluence of weight 1 is so many monitor units in a fraction.
    ///
    /// # Errors
    /// The leaves do not reach what is lit.
    pub fn new(
        field: &ArcField,
        limits: &ArcLimits,
        collimator: &Collimator,
        mu_per_weight: f64,
    ) -> Result<Self, ArcError> {
        let travel_mm: Vec<f64> = field.intervals.iter().map(|i| limits.travel_mm(i.degrees)).collect();
        let gap_mm = limits.whole_gap_mm();
        let room = Room { points: &field.points, collimator, gap_mm, travel_mm: &travel_mm };
        let mut ends_mm = vec![Vec::with_capacity(field.rows.len()); field.points.len()];
        for row in 0..field.rows.len() {
            let window = |of: &Vec<Option<_>>| of[row].as_ref().map(|cells| field.around_mm(cells));
            let windows_mm: Vec<_> = field.windows.iter().map(window).collect();
            let [low, high] = field.ends_mm(row);
            let ends = room.ends(&windows_mm, 0.5 * (low + high))?;
            ends_mm.iter_mut().zip(ends).for_each(|(all, ends)| all.push(ends));
        }
        let units = |interval: &Interval| limits.units(interval.degrees).map(|units| units / mu_per_weight);
        Ok(Self { travel_mm, weights: field.intervals.iter().map(units).collect(), gap_mm, ends_mm })
    }
}

impl Trajectory {
    /// Tips of a row at a part of an interval.
    #[inline]
    pub fn tips_at(&self, interval: &Interval, number: usize, row: usize) -> [f64; 2] {
        let a = part(number);
        let [from, to] = [&self.tips_mm[interval.from][row], &self.tips_mm[interval.from + 1][row]];
        [0, 1].map(|bank| from[bank] + a * (to[bank] - from[bank]))
    }

    /// Dose of the rows of the goals, gray.
    pub fn dose(&self, field: &ArcField) -> Vec<f64> {
        let mut dose = vec![0.0; field.goal_rows()];
        for (number, weight) in self.weights.iter().enumerate() {
            self.add_interval(field, number, *weight, &mut dose);
        }
        dose
    }

    /// Adds the dose of an interval with this weight.
    pub fn add_interval(&self, field: &ArcField, number: usize, weight: f64, dose: &mut [f64]) {
        if weight == 0.0 {
            return;
        }
        let interval = &field.intervals[number];
        for (at, doses) in interval.doses.iter().enumerate() {
            let share = weight / interval.doses.len() as f64;
            field.add_open(*doses, |row| self.tips_at(interval, at, row), share, dose);
        }
    }

    /// The longest way of a tip in an interval, mm.
    pub fn travel_mm(&self, interval: &Interval) -> f64 {
        farthest_mm(&self.tips_mm[interval.from], &self.tips_mm[interval.from + 1])
    }

    /// The stretches of an arc's intervals.
    pub fn stretches(&self, field: &ArcField, mu_per_weight: f64) -> Vec<Stretch> {
        let of = |(interval, weight): (&Interval, &f64)| Stretch {
            degrees: interval.degrees,
            travel_mm: self.travel_mm(interval),
            units: weight * mu_per_weight,
        };
        field.intervals.iter().zip(&self.weights).map(of).collect()
    }

    /// The same with all tips at whole micrometres, downwards. Limits of whole micrometres that held before hold after it.
    #[must_use]
    pub fn on_grid(&self) -> Self {
        let point = |tips: &Vec<[f64; 2]>| tips.iter().map(|tips| tips.map(down)).collect();
        Self { tips_mm: self.tips_mm.iter().map(point).collect(), weights: self.weights.clone() }
    }

    /// The first limit that does not hold to a nanometre, in words: for tests, and before a plan leaves.
    pub fn fault(&self, field: &ArcField, bounds: &Bounds) -> Option<String> {
        const LEAST_MM: f64 = 1e-6;
        for (point, tips) in self.tips_mm.iter().enumerate() {
            for (row, [low, high]) in tips.iter().enumerate() {
                if high - low < bounds.gap_mm - LEAST_MM {
                    return Some(format!("control point {point}, row {row}: tips at {low} and {high} mm"));
                }
                let [of_low, of_high] = bounds.ends_mm[point][row];
                let is_within =
                    |[least, most]: [f64; 2], mm: f64| (least - LEAST_MM..=most + LEAST_MM).contains(&mm);
                if !(is_within(of_low, *low) && is_within(of_high, *high)) {
                    return Some(format!(
                        "control point {point}, row {row}: tips at {low} and {high} mm are out of reach"
                    ));
                }
            }
        }
        for (number, interval) in field.intervals.iter().enumerate() {
            let (travel_mm, most_mm) = (self.travel_mm(interval), bounds.travel_mm[number]);
            if travel_mm > most_mm + LEAST_MM {
                return Some(format!(
                    "interval {number}: a tip travels {travel_mm} mm (allowed: {most_mm} mm)"
                ));
            }
            let ([least, most], weight) = (bounds.weights[number], self.weights[number]);
            if !(least * (1.0 - 1e-6)..=most * (1.0 + 1e-6)).contains(&weight) {
                return Some(format!("interval {number}: a weight of {weight} (allowed: {least} to {most})"));
            }
        }
        None
    }
}
