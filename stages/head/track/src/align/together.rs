//! Whether a piece of a surface was seen to move as the rest does: the slope of its movements over those of the rest, with
//! free means. 1 is a piece of the same body, 0 one that stands still.

use nalgebra::{Matrix3, Vector3};

/// Slopes of a piece that moves with the rest: surely within the first bounds, and not surely outside of the second. A
/// piece that holds points of both has a slope between 0 and 1.
const WITHIN: [f64; 2] = [0.5, 2.0];
const OUTSIDE: [f64; 2] = [0.75, 1.33];
/// Standard deviations of the slope between it and a bound, where one is sure.
const SURE: f64 = 3.0;
/// Least movement along the normals of the piece that counts, root mean square over the frames, m. Below it are errors of
/// a fit that are not noise.
const LEAST: f64 = 0.04e-3;

/// What the movements of parts of a surface tell so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Verdict {
    /// Not enough of them yet.
    #[default]
    Open,
    /// They are those of one body.
    With,
    /// They are not.
    Against,
}

/// Sums over the frames of a piece. Movements count along the normals of the piece, as its points tell no others.
#[derive(Debug, Clone, Default)]
pub(super) struct Together {
    /// Information on translations of the piece, and its products with the movements of the rest and of the piece.
    along: Matrix3<f64>,
    rest: Vector3<f64>,
    own: Vector3<f64>,
    rest_by_rest: f64,
    rest_by_own: f64,
    /// What noise alone adds to `rest_by_rest`.
    feigned: f64,
}

impl Together {
    /// Adds a frame: how far the `rest` has moved at the place of the piece, and the piece itself, m; the information
    /// on translations `along` the normals of the piece, and the covariance of `rest`, m2.
    pub fn add(
        &mut self,
        along: &Matrix3<f64>,
        rest: &Vector3<f64>,
        own: &Vector3<f64>,
        covariance: &Matrix3<f64>,
    ) {
        let (by_rest, by_own) = (along * rest, along * own);
        self.along += along;
        self.rest += by_rest;
        self.own += by_own;
        self.rest_by_rest += rest.dot(&by_rest);
        self.rest_by_own += rest.dot(&by_own);
        self.feigned += (along * covariance).trace();
    }

    /// The verdict on points with this noise (standard deviation along the normals, m).
    pub fn verdict(&self, noise: f64) -> Verdict {
        let Some((slope, sd)) = self.slope(noise) else { return Verdict::Open };
        let sure = SURE * sd;
        if OUTSIDE[0] - slope > sure || slope - OUTSIDE[1] > sure {
            Verdict::Against
        } else if slope - WITHIN[0] > sure && WITHIN[1] - slope > sure {
            Verdict::With
        } else {
            Verdict::Open
        }
    }

    /// The slope and its standard deviation; `None` while the rest has not moved by more than its noise, or by too little.
    fn slope(&self, noise: f64) -> Option<(f64, f64)> {
        // Directions without a normal have no information, and no movements.
        let hold = 1e-6 * self.along.trace() / 3.0;
        let held = (self.along + Matrix3::from_diagonal_element(hold.max(f64::MIN_POSITIVE))).cholesky()?;
        let mean = held.solve(&self.rest);
        let squares = self.rest_by_rest - self.rest.dot(&mean);
        let product = self.rest_by_own - self.own.dot(&mean);
        let left = squares - self.feigned;
        (left > LEAST * LEAST * self.along.trace()).then(|| (product / left, noise * squares.sqrt() / left))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The verdict after frames of 0.1 s of a breath of 0.3 mm, on 100 points whose normals are near to z, for a piece
    /// that moves by `slope` of it.
    fn after(frames: u32, slope: f64, noise: f64) -> Verdict {
        let mut together = Together::default();
        let along = Matrix3::from_diagonal(&Vector3::new(5.0, 5.0, 90.0));
        let covariance = Matrix3::from_diagonal_element(noise * noise / 1000.0);
        // A sum of sines stands for the noise: bounded, and the same in each run.
        let err = |frame: f64, by: f64| noise * (1.7 * by * frame).sin() * (2.0 / 100.0_f64).sqrt();
        for frame in (0..frames).map(f64::from) {
            let breath = 0.3e-3 * (std::f64::consts::TAU * 0.25 * 0.1 * frame).sin();
            let rest = Vector3::new(0.0, 0.0, breath);
            let own = slope * rest + Vector3::new(2e-3, 0.0, 1e-3 + err(frame, 1.0));
            together.add(&along, &rest, &own, &covariance);
        }
        together.verdict(noise)
    }

    #[test]
    fn a_piece_of_the_head_moves_with_it_and_a_hand_or_a_tube_does_not() {
        assert_eq!(after(40, 1.0, 0.1e-3), Verdict::With);
        assert_eq!(after(40, 1.0, 1e-3), Verdict::With);
        assert_eq!(after(40, 0.0, 0.1e-3), Verdict::Against);
        assert_eq!(after(40, 0.0, 1e-3), Verdict::Against);
        assert_eq!(after(40, -1.0, 0.1e-3), Verdict::Against);
        assert_eq!(after(40, 4.0, 0.1e-3), Verdict::Against);
    }

    #[test]
    fn what_did_not_move_beyond_its_noise_tells_nothing() {
        assert_eq!(after(3, 1.0, 1e-3), Verdict::Open);
        assert_eq!(after(3, 0.0, 1e-3), Verdict::Open);
        assert_eq!(Together::default().verdict(1e-3), Verdict::Open);
        let mut still = Together::default();
        for _ in 0..100 {
            let noise = Matrix3::identity() * 1e-9;
            still.add(&Matrix3::identity(), &Vector3::zeros(), &Vector3::zeros(), &noise);
        }
        assert_eq!(still.verdict(1e-4), Verdict::Open);
    }
}
