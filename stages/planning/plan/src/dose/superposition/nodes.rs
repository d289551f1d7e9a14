//! Bixels on a lattice of the isocentre plane, so that what a voxel gathers is filed once for all bixels.
//!
//! What comes from a voxel is shared by the four nodes around the place where the source sees it, linearly. The fluence of
//! a bixel is then a sum over nodes; its coefficients are the least squares fit of such a piecewise linear function to the
//! bixel's fluence, blurred by the penumbra and the width of a voxel.

use super::fluence::BixelShape;

/// Distance between nodes, mm.
pub(super) const NODE_MM: f64 = 1.5;
/// Samples of a node's distance in the integrals of the fit.
const SAMPLES: usize = 16;
/// Nodes beyond a bixel's fluence that the fit goes on.
const BEYOND: usize = 4;

/// Bixels of one axis, over nodes.
#[derive(Clone, Debug)]
pub(super) struct Profiles {
    /// By bixel: its first node, and the coefficients from there on.
    pub of: Vec<(usize, Vec<f32>)>,
}

impl Profiles {
    /// Of bixels with these centres (mm), seen by voxels of this width, over nodes from `first_mm` on.
    pub fn new(centres_mm: &[f64], shape: &BixelShape, side_mm: f64, first_mm: f64) -> Self {
        let reach_mm = shape.reach_mm() + 0.5 * side_mm;
        let of = |&centre: &f64| {
            let low = ((centre - reach_mm - first_mm) / NODE_MM).floor() as usize - BEYOND;
            let nodes = (2.0 * reach_mm / NODE_MM).ceil() as usize + 2 * BEYOND + 2;
            let from_mm = first_mm + low as f64 * NODE_MM - centre;
            let fluence = |x: f64| shape.mean(x - 0.5 * side_mm, x + 0.5 * side_mm);
            (low, fitted(nodes, from_mm, fluence))
        };
        Self { of: centres_mm.iter().map(of).collect() }
    }

    /// Distance from a bixel's centre to the farthest node that it may use, mm.
    pub fn reach_mm(shape: &BixelShape, side_mm: f64) -> f64 {
        shape.reach_mm() + 0.5 * side_mm + (BEYOND + 3) as f64 * NODE_MM
    }
}

/// Coefficients of the piecewise linear function on nodes from `from_mm` on that is nearest to a function which is 0 at both
/// ends: the normal equations of the hat functions are tridiagonal.
fn fitted(nodes: usize, from_mm: f64, fluence: impl Fn(f64) -> f64) -> Vec<f32> {
    let step = 1.0 / SAMPLES as f64;
    let mut right = vec![0.0; nodes];
    for cell in 0..nodes - 1 {
        for sample in 0..SAMPLES {
            let part = (sample as f64 + 0.5) * step;
            let value = step * fluence(from_mm + (cell as f64 + part) * NODE_MM);
            right[cell] += (1.0 - part) * value;
            right[cell + 1] += part * value;
        }
    }
    // Diagonal 2/3 (1/3 at the ends), 1/6 beside it: Thomas's elimination.
    let diagonal = |node: usize| if node == 0 || node == nodes - 1 { 1.0 / 3.0 } else { 2.0 / 3.0 };
    let neighbour = 1.0 / 6.0;
    let mut upper = vec![0.0; nodes];
    for node in 0..nodes {
        let before = if node > 0 { upper[node - 1] } else { 0.0 };
        let pivot = diagonal(node) - if node > 0 { neighbour * before } else { 0.0 };
        upper[node] = neighbour / pivot;
        let carried = if node > 0 { neighbour * right[node - 1] } else { 0.0 };
        right[node] = (right[node] - carried) / pivot;
    }
    for node in (0..nodes - 1).rev() {
        right[node] -= upper[node] * right[node + 1];
    }
    right.into_iter().map(|value| value as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fit_follows_a_bixel_and_neighbours_sum_to_an_even_field() {
        let shape = BixelShape::new(5.0, 5.0);
        let centres: Vec<f64> = (-5..=5).map(|i| 5.0 * f64::from(i)).collect();
        let first_mm = -80.0;
        let profiles = Profiles::new(&centres, &shape, 2.5, first_mm);
        let at = |bixel: usize, x: f64| {
            let (low, coefficients) = &profiles.of[bixel];
            let place = (x - first_mm) / NODE_MM - *low as f64;
            let whole = place.floor();
            let of = |node: f64| {
                let is_inside = node >= 0.0 && node < coefficients.len() as f64;
                if is_inside { f64::from(coefficients[node as usize]) } else { 0.0 }
            };
            of(whole) * (1.0 - place + whole) + of(whole + 1.0) * (place - whole)
        };
        for step in -80..=80 {
            let x = 0.37 * f64::from(step);
            let error = at(5, x) - shape.mean(x - 1.25, x + 1.25);
            assert!(error.abs() < 0.02, "{x}: {error}");
            if x.abs() < 15.0 {
                let sum: f64 = (0..centres.len()).map(|bixel| at(bixel, x)).sum();
                assert!((sum - 1.0).abs() < 2e-3, "{x}: {sum}");
            }
        }
    }
}
