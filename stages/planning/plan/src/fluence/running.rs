//! The objective of a plan while the doses of some voxels change: what it costs is known after each change, and a change is
//! weighed before it is made.
//!
//! Rows that average voxels and regions follow the voxels. The voxels of DVH points and the means of homogeneity objectives are
//! those that cost least at the doses of the beginning; so the cost is never below the objective, and equals it there.

use super::goals::PlanProblem;
use super::problem::Term;
use super::region::RegionTerm;

/// A change of the doses of some voxel rows, gray.
#[derive(Clone, Debug)]
pub struct DoseChange {
    gray: Vec<f64>,
    is_touched: Vec<bool>,
    touched: Vec<u32>,
}

impl DoseChange {
    /// No change of so many rows.
    pub fn new(rows: usize) -> Self {
        Self { gray: vec![0.0; rows], is_touched: vec![false; rows], touched: Vec::new() }
    }

    /// Adds to a row.
    #[inline]
    pub fn add(&mut self, row: u32, gray: f64) {
        let at = row as usize;
        if !self.is_touched[at] {
            self.is_touched[at] = true;
            self.touched.push(row);
        }
        self.gray[at] += gray;
    }

    /// No change again.
    pub fn clear(&mut self) {
        for row in self.touched.drain(..) {
            self.gray[row as usize] = 0.0;
            self.is_touched[row as usize] = false;
        }
    }
}

/// A row that averages voxels, with what it costs.
#[derive(Clone, Debug)]
struct Mean {
    gray: f64,
    terms: Vec<Term>,
}

/// The objective at doses that change.
#[derive(Clone, Debug)]
pub struct RunningCost {
    dose: Vec<f64>,
    /// The same, but for rows of a change that is being weighed.
    trial: Vec<f64>,
    /// Terms of voxel rows, ordered by row.
    terms: Vec<Term>,
    starts: Vec<usize>,
    means: Vec<Mean>,
    /// For each voxel row the means that it is a part of, with its share.
    mean_starts: Vec<usize>,
    mean_shares: Vec<(u32, f64)>,
    regions: Vec<RegionTerm>,
    cost: f64,
}

impl PlanProblem {
    /// The objective at doses of the voxel rows, without the modulation of a fluence.
    pub fn running(&self, dose: Vec<f64>) -> RunningCost {
        let rows = self.voxel_rows;
        let mut terms: Vec<Term> = Vec::new();
        let mut means: Vec<Mean> = Vec::new();
        let mut shares: Vec<Vec<(u32, f64)>> = vec![Vec::new(); rows];
        let even = self.even_means(&dose);
        for row in 0..rows {
            terms.extend(self.convex.terms_of(row));
        }
        for (extra, averaged) in self.averages.iter().enumerate() {
            let own = self.convex.terms_of(rows + extra);
            match (self.even_column(extra), &averaged[..]) {
                (Some(column), [(row, _)]) => {
                    terms.extend(own.iter().map(|t| Term { row: *row, goal: t.goal + even[column], ..*t }));
                }
                _ => {
                    let number = means.len() as u32;
                    averaged.iter().for_each(|(row, share)| shares[*row as usize].push((number, *share)));
                    let gray = averaged.iter().map(|(row, share)| share * dose[*row as usize]).sum();
                    means.push(Mean { gray, terms: own.to_vec() });
                }
            }
        }
        for point in &self.dvh {
            terms.extend(point.terms(&point.costing(&dose)));
        }
        terms.sort_by_key(|term| term.row);
        let starts = starts(rows, terms.iter().map(|term| term.row as usize));
        let mut mean_starts = vec![0];
        let mut mean_shares = Vec::new();
        for row in shares {
            mean_shares.extend(row);
            mean_starts.push(mean_shares.len());
        }
        let regions = self.convex.regions().to_vec();
        let trial = dose.clone();
        let mut running =
            RunningCost { dose, trial, terms, starts, means, mean_starts, mean_shares, regions, cost: 0.0 };
        running.cost = running.whole();
        running
    }

    /// The column of the mean from which an extra row is a difference.
    fn even_column(&self, extra: usize) -> Option<usize> {
        let column = *self.convex.matrix().row(self.voxel_rows + extra).0.last()? as usize;
        column.checked_sub(self.bixels)
    }

    /// The means of homogeneity objectives that cost least.
    fn even_means(&self, dose: &[f64]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0.0); self.convex.matrix().columns() - self.bixels];
        for (extra, averaged) in self.averages.iter().enumerate() {
            let (Some(column), [(row, _)]) = (self.even_column(extra), &averaged[..]) else { continue };
            let weight: f64 = self.convex.terms_of(self.voxel_rows + extra).iter().map(|t| t.weight).sum();
            sums[column].0 += weight * dose[*row as usize];
            sums[column].1 += weight;
        }
        sums.into_iter().map(|(sum, weight)| if weight > 0.0 { sum / weight } else { 0.0 }).collect()
    }
}

impl RunningCost {
    /// What the doses cost now.
    pub fn cost(&self) -> f64 {
        self.cost
    }

    /// Doses of the voxel rows, Gy.
    pub fn dose(&self) -> &[f64] {
        &self.dose
    }

    /// Slope of the cost in the dose of each voxel row.
    pub fn pull(&self) -> Vec<f64> {
        let mut pull = vec![0.0; self.dose.len()];
        for term in &self.terms {
            pull[term.row as usize] += term.slope(self.dose[term.row as usize]);
        }
        let of_means: Vec<f64> =
            self.means.iter().map(|mean| mean.terms.iter().map(|t| t.slope(mean.gray)).sum()).collect();
        for (row, pull) in pull.iter_mut().enumerate() {
            for (mean, share) in self.shares_of(row) {
                *pull += share * of_means[*mean as usize];
            }
        }
        for region in &self.regions {
            let Some(around) = region.around(&self.dose) else { continue };
            for ((row, _), slope) in region.rows.iter().zip(around.mean_slopes) {
                pull[*row as usize] += around.slope * slope;
            }
        }
        pull
    }

    /// First and second derivative of the cost along a change.
    pub fn along(&self, change: &DoseChange) -> [f64; 2] {
        let (mut slope, mut curvature) = (0.0, 0.0);
        let mut of_means = vec![0.0; self.means.len()];
        for row in &change.touched {
            let (row, by) = (*row as usize, change.gray[*row as usize]);
            for term in self.terms_of(row) {
                slope += by * term.slope(self.dose[row]);
                curvature += by * by * term.curvature(self.dose[row]);
            }
            self.shares_of(row).iter().for_each(|(mean, share)| of_means[*mean as usize] += share * by);
        }
        for (mean, by) in self.means.iter().zip(of_means) {
            for term in &mean.terms {
                slope += by * term.slope(mean.gray);
                curvature += by * by * term.curvature(mean.gray);
            }
        }
        for region in &self.regions {
            let (first, second) = region.along(&self.dose, &change.gray);
            slope += first;
            curvature += second.max(0.0);
        }
        [slope, curvature]
    }

    /// What a change adds to the cost.
    pub fn added(&mut self, change: &DoseChange) -> f64 {
        let mut added = 0.0;
        let mut of_means = vec![0.0; self.means.len()];
        for row in &change.touched {
            let (row, by) = (*row as usize, change.gray[*row as usize]);
            let (before, after) = (self.dose[row], self.dose[row] + by);
            for term in self.terms_of(row) {
                added += term.cost(after) - term.cost(before);
            }
            self.shares_of(row).iter().for_each(|(mean, share)| of_means[*mean as usize] += share * by);
        }
        for (mean, by) in self.means.iter().zip(of_means) {
            for term in &mean.terms {
                added += term.cost(mean.gray + by) - term.cost(mean.gray);
            }
        }
        if !self.regions.is_empty() {
            for row in &change.touched {
                self.trial[*row as usize] = self.dose[*row as usize] + change.gray[*row as usize];
            }
            for region in &self.regions {
                added += region.cost(&self.trial) - region.cost(&self.dose);
            }
            for row in &change.touched {
                self.trial[*row as usize] = self.dose[*row as usize];
            }
        }
        added
    }

    /// Makes a change that adds this to the cost.
    pub fn make(&mut self, change: &DoseChange, added: f64) {
        for row in &change.touched {
            let (at, by) = (*row as usize, change.gray[*row as usize]);
            self.dose[at] += by;
            self.trial[at] = self.dose[at];
            for (mean, share) in &self.mean_shares[self.mean_starts[at]..self.mean_starts[at + 1]] {
                self.means[*mean as usize].gray += share * by;
            }
        }
        self.cost += added;
    }

    fn whole(&self) -> f64 {
        let of_rows: f64 = self.terms.iter().map(|term| term.cost(self.dose[term.row as usize])).sum();
        let of_mean = |mean: &Mean| mean.terms.iter().map(|term| term.cost(mean.gray)).sum::<f64>();
        let of_means: f64 = self.means.iter().map(of_mean).sum();
        let of_regions: f64 = self.regions.iter().map(|region| region.cost(&self.dose)).sum();
        of_rows + of_means + of_regions
    }

    #[inline]
    fn terms_of(&self, row: usize) -> &[Term] {
        &self.terms[self.starts[row]..self.starts[row + 1]]
    }

    #[inline]
    fn shares_of(&self, row: usize) -> &[(u32, f64)] {
        &self.mean_shares[self.mean_starts[row]..self.mean_starts[row + 1]]
    }
}

/// Where the items of each row start, which are ordered by row.
fn starts(rows: usize, of: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut starts = vec![0; rows + 1];
    of.for_each(|row| starts[row + 1] += 1);
    (0..rows).for_each(|row| starts[row + 1] += starts[row]);
    starts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fluence::{
        Bound, DvhAtMost, Geud, Goals, Homogeneity, MeanDose, Overdose, StructureObjectives, Underdose,
    };

    /// Every kind of row: voxels, a mean, a homogeneity, a DVH point and a region.
    fn goals() -> Goals {
        let objectives = vec![
            Underdose { dose: 50.0, weight: 3.0 }.into(),
            Overdose { dose: 30.0, weight: 0.5 }.into(),
            MeanDose { dose: 20.0, weight: 2.0 }.into(),
            Homogeneity { weight: 0.7 }.into(),
            DvhAtMost { dose: 25.0, volume: 0.4, weight: 1.5 }.into(),
            Geud { a: 6.0, bound: Bound::AtMost, dose: 28.0, weight: 4.0 }.into(),
        ];
        let structure = StructureObjectives {
            name: "all".into(),
            voxels: (0..8).collect(),
            volumes: vec![1.0, 2.0, 1.0, 0.5, 1.0, 1.0, 3.0, 1.0],
            to_target_mm: Vec::new(),
            objectives,
        };
        Goals::new(vec![structure], 8).unwrap()
    }

    fn dose() -> Vec<f64> {
        (0..8).map(|i| 18.0 + 5.3 * f64::from(i)).collect()
    }

    fn change(scale: f64) -> DoseChange {
        let mut change = DoseChange::new(8);
        [(1, 0.4), (5, -0.9), (6, 0.2), (1, 0.3)]
            .into_iter()
            .for_each(|(row, by)| change.add(row, scale * by));
        change
    }

    #[test]
    fn it_costs_what_the_goals_cost_and_a_change_adds_what_it_is_said_to_add() {
        let goals = goals();
        let problem = goals.problem(&[]).unwrap();
        let mut running = problem.running(dose());
        assert!((running.cost() / goals.cost(&dose()).unwrap() - 1.0).abs() < 1e-12);
        let (before, change) = (running.cost(), change(1.0));
        let added = running.added(&change);
        running.make(&change, added);
        // Afterwards the voxels of the DVH point and the mean may be chosen better, never worse.
        let after = goals.cost(running.dose()).unwrap();
        assert!(running.cost() >= after - 1e-9 && (running.cost() - before - added).abs() < 1e-9);
        assert!((running.whole() / running.cost() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn its_slope_and_curvature_are_those_of_small_changes() {
        let goals = goals();
        let mut running = goals.problem(&[]).unwrap().running(dose());
        let [slope, curvature] = running.along(&change(1.0));
        let h = 1e-4;
        let [up, down] = [h, -h].map(|scale| running.added(&change(scale)));
        assert!(((up - down) / (2.0 * h) / slope - 1.0).abs() < 1e-6);
        assert!(
            ((up + down) / (h * h) / curvature - 1.0).abs() < 1e-2,
            "{} {curvature}",
            (up + down) / (h * h)
        );
        let pull = running.pull();
        let by_pull = 0.7 * pull[1] - 0.9 * pull[5] + 0.2 * pull[6];
        assert!((by_pull / slope - 1.0).abs() < 1e-9);
        let mut cleared = change(1.0);
        cleared.clear();
        assert_eq!(running.added(&cleared), 0.0);
    }
}
