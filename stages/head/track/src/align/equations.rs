//! The normal equations of an alignment.

use nalgebra::{Matrix6, Vector6};

/// The normal equations at one place.
pub(super) struct Equations {
    pub information: Matrix6<f64>,
    pub right: Vector6<f64>,
    pub weight: f64,
    pub squares: f64,
    /// Sum of the derivative of the weighted distance by the distance, over the sum of the weights.
    pub slope: f64,
    pub close: usize,
    pub used: usize,
}

/// Sums of the normal equations; the symmetric matrix is kept by its lower half.
#[derive(Debug, Clone, Default)]
pub(super) struct Sums {
    lower: [f64; 21],
    pub right: Vector6<f64>,
    pub weight: f64,
    pub squares: f64,
}

impl Sums {
    #[inline]
    pub fn add(&mut self, row: &Vector6<f64>, distance: f64, weight: f64) {
        let mut place = 0;
        for i in 0..6 {
            let weighted = weight * row[i];
            for j in 0..=i {
                self.lower[place] += weighted * row[j];
                place += 1;
            }
            // The movement has to undo the distance.
            self.right[i] -= weighted * distance;
        }
        self.weight += weight;
        self.squares += weight * distance * distance;
    }

    pub fn information(&self) -> Matrix6<f64> {
        Matrix6::from_fn(|i, j| {
            let (i, j) = (i.max(j), i.min(j));
            self.lower[i * (i + 1) / 2 + j]
        })
    }
}
