//! Which of the six directions of a movement a surface constrains.
//!
//! A small movement m = (translation, rotation times length) about a centre moves a point of the surface along its
//! normal by J m with J = (n, a x n / length), a from the centre to the point. So the eigenvalues of the mean of J^T J say
//! how much the surface moves, in mean square, per unit of movement in each eigenvector's direction: 1 for a plane along
//! its normal, 0 for a sphere's turn. A direction with less than a least sensitivity is refused: only noise would
//! decide about it. (Zhang, Kaess and Singh 2016 call this the degeneracy of the problem.)

use nalgebra::{Matrix6, Vector6};

/// Directions of movement with what the surface says about each. The largest sensitivity comes first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observability {
    /// Mean square of the surface's movement along its normals per unit of movement, from 0 to 1 + reach^2 / length^2.
    pub sensitivity: [f64; 6],
    /// The directions as columns: translation, then rotation times length.
    pub directions: Matrix6<f64>,
    /// How many of them, from the first, the surface constrains. The rest is refused.
    pub constrained: usize,
}

impl Observability {
    /// Of the sum of w J^T J, `information`, and the sum of the weights. Directions below `least` are refused.
    #[must_use]
    pub fn new(information: &Matrix6<f64>, weight: f64, least: f64) -> Self {
        let eigen = (information / weight.max(f64::MIN_POSITIVE)).symmetric_eigen();
        let mut order = [0, 1, 2, 3, 4, 5];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let sensitivity = order.map(|i| eigen.eigenvalues[i].max(0.0));
        let mut directions = Matrix6::zeros();
        for (to, from) in order.into_iter().enumerate() {
            let column: Vector6<f64> = eigen.eigenvectors.column(from).into_owned();
            // An eigenvector has no sign of its own: its largest component is taken to be positive.
            let sign = if column[column.iamax()] < 0.0 { -1.0 } else { 1.0 };
            directions.set_column(to, &(column * sign));
        }
        Self { sensitivity, directions, constrained: sensitivity.iter().filter(|&&s| s >= least).count() }
    }

    /// The movement m of least squares, information m = right, with none in the refused directions.
    #[must_use]
    pub fn solve(&self, right: &Vector6<f64>, weight: f64) -> Vector6<f64> {
        let mut movement = Vector6::zeros();
        for i in 0..self.constrained {
            let direction = self.directions.column(i);
            movement += direction * (direction.dot(right) / (self.sensitivity[i] * weight));
        }
        movement
    }

    /// Inverse of the information in the constrained directions, zero in the others.
    #[must_use]
    pub fn inverse(&self, weight: f64) -> Matrix6<f64> {
        let mut inverse = Matrix6::zeros();
        for i in 0..self.constrained {
            let direction = self.directions.column(i);
            inverse += direction * direction.transpose() / (self.sensitivity[i] * weight);
        }
        inverse
    }
}
