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
        self.subtract_means(&mut dose);
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

    /// Gives the means of homogeneity objectives their best value. At it the objective is flat in them, so the slope in
    /// the weights is that of fixed means.
    fn subtract_means(&self, dose: &mut [f64]) {
        let matrix = self.convex.matrix();
        let means = matrix.columns() - self.bixels;
        let mut sums = vec![(0.0, 0.0); means];
        let of = |row: usize| {
            let column = *matrix.row(row).0.last()? as usize;
            let weight: f64 = self.convex.terms_of(row).iter().map(|term| term.weight).sum();
            Some((column.checked_sub(self.bixels)?, weight))
        };
        let spread: Vec<(usize, usize, f64)> = (self.voxel_rows..matrix.rows())
            .filter_map(|row| of(row).map(|(mean, weight)| (row, mean, weight)))
            .collect();
        for (row, mean, weight) in &spread {
            sums[*mean].0 += weight * dose[*row];
            sums[*mean].1 += weight;
        }
        for (row, mean, _) in spread {
            let (sum, weight) = sums[mean];
            if weight > 0.0 {
                dose[row] -= sum / weight;
            }
        }
    }
}
