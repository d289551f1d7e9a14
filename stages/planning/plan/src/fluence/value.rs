//! The objective of a plan at any weights, with its slope: for optimisers of others.

use super::goals::PlanProblem;
use super::problem::ProblemError;

/// The objective at some weights.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectiveValue {
    /// The objective.
    pub cost: f64,
    /// Its slope in each weight.
    pub slope: Vec<f64>,
}

impl PlanProblem {
    /// Number of bixels, and so of weights.
    pub fn bixels(&self) -> usize {
        self.bixels
    }

    /// The objective at these weights, one for each bixel, and its slope in each: DVH points and the modulation of the
    /// fluence included. Where voxels of a DVH point have the same dose, it is the slope on one side.
    ///
    /// # Errors
    /// There is not one weight for each bixel.
    pub fn value(&self, weights: &[f64]) -> Result<ObjectiveValue, ProblemError> {
        if weights.len() != self.bixels {
            return Err(ProblemError::Length {
                what: "the weights",
                found: weights.len(),
                expected: self.bixels,
            });
        }
        let matrix = self.convex.matrix();
        let mut x = weights.to_vec();
        x.resize(matrix.columns(), 0.0);
        let mut dose = vec![0.0; matrix.rows()];
        self.convex.doses(&x, &mut dose);
        let means = self.best_means(&dose);
        self.subtract(&means, &mut dose);
        let mut cost = self.convex.objective(&dose);
        let mut pull = vec![0.0; dose.len()];
        self.convex.dose_gradient(&dose, &mut pull);
        for point in &self.dvh {
            let rows = point.costing(&dose);
            for term in point.terms(&rows) {
                let dose = dose[term.row as usize];
                cost += term.cost(dose);
                pull[term.row as usize] += term.slope(dose);
            }
        }
        let mut slope = vec![0.0; x.len()];
        self.convex.slopes(&pull, &mut slope);
        slope.truncate(self.bixels);
        Ok(ObjectiveValue { cost, slope })
    }

    /// The best values of the means of homogeneity objectives. At them the objective is flat in the means, so the slope in
    /// the weights is that of fixed means.
    pub(super) fn best_means(&self, dose: &[f64]) -> Vec<f64> {
        let means = self.convex.matrix().columns() - self.bixels;
        let mut sums = vec![(0.0, 0.0); means];
        for (row, mean, weight) in self.spread() {
            sums[mean].0 += weight * dose[row];
            sums[mean].1 += weight;
        }
        sums.into_iter().map(|(sum, weight)| if weight > 0.0 { sum / weight } else { 0.0 }).collect()
    }

    fn subtract(&self, means: &[f64], dose: &mut [f64]) {
        self.spread().for_each(|(row, mean, _)| dose[row] -= means[mean]);
    }

    /// Rows that a homogeneity objective judges, with the number of its mean and the weight of the row.
    fn spread(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let matrix = self.convex.matrix();
        (self.voxel_rows..matrix.rows()).filter_map(move |row| {
            let column = *matrix.row(row).0.last()? as usize;
            let weight: f64 = self.convex.terms_of(row).iter().map(|term| term.weight).sum();
            Some((row, column.checked_sub(self.bixels)?, weight))
        })
    }
}
