//! Balls on the couch, and whether they determine a place.

use nalgebra::Vector3;

use super::error::ExtrinsicError;

/// Least width of the triangle of the balls, m.
const LEAST_WIDTH_M: f64 = 0.04;
/// Distances must change by more than this when balls of one size are exchanged, m.
pub(super) const ALIKE_M: f64 = 0.012;
/// Diameters that differ by less are of one size, m.
const SAME_SIZE_M: f64 = 0.004;

/// A ball of known size and place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Its centre in the couch's frame, m.
    pub at: Vector3<f64>,
    /// Its diameter, m.
    pub diameter: f64,
}

/// Three balls or more that determine where a camera is.
#[derive(Clone, Debug, PartialEq)]
pub struct Targets(Vec<Ball>);

impl Targets {
    /// Balls that are not in line and cannot be exchanged.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn new(balls: Vec<Ball>) -> Result<Self, ExtrinsicError> {
        if balls.len() < 3 {
            return Err(ExtrinsicError::FewTargets { found: balls.len() });
        }
        for (number, ball) in balls.iter().enumerate() {
            let numbers = [
                ("x", ball.at.x, [-2.0, 2.0]),
                ("y", ball.at.y, [-3.0, 3.0]),
                ("z", ball.at.z, [-1.0, 2.0]),
                ("diameter", ball.diameter, [0.02, 0.3]),
            ];
            for (what, value, [least, most]) in numbers {
                if !(least..=most).contains(&value) {
                    let [value_mm, least_mm, most_mm] = [value, least, most].map(|m| 1e3 * m);
                    return Err(ExtrinsicError::Target {
                        ball: number + 1,
                        what,
                        value_mm,
                        least_mm,
                        most_mm,
                    });
                }
            }
        }
        let width = width(&balls);
        if width < LEAST_WIDTH_M {
            return Err(ExtrinsicError::InLine { width_mm: 1e3 * width, least_mm: 1e3 * LEAST_WIDTH_M });
        }
        if can_be_exchanged(&balls, &mut Vec::new()) {
            return Err(ExtrinsicError::Alike { most_mm: 1e3 * ALIKE_M });
        }
        Ok(Self(balls))
    }

    /// The balls.
    pub fn balls(&self) -> &[Ball] {
        &self.0
    }
}

/// Whether two balls have one size.
fn is_same_size(a: &Ball, b: &Ball) -> bool {
    (a.diameter - b.diameter).abs() < SAME_SIZE_M
}

/// Largest distance of a ball from the line of the two that are farthest apart.
fn width(balls: &[Ball]) -> f64 {
    let mut widest: f64 = 0.0;
    for (i, a) in balls.iter().enumerate() {
        for b in &balls[..i] {
            let along = b.at - a.at;
            let off = |c: &Ball| (c.at - a.at).cross(&along).norm() / along.norm().max(1e-9);
            // Of the farthest pair this is the height of the triangle; of others it is more.
            let height = balls.iter().map(off).fold(0.0, f64::max);
            let is_farthest =
                balls.iter().all(|c| balls.iter().all(|d| (c.at - d.at).norm() <= along.norm() + 1e-9));
            if is_farthest {
                widest = widest.max(height);
            }
        }
    }
    widest
}

/// Whether a permutation other than the identity keeps sizes and distances.
fn can_be_exchanged(balls: &[Ball], chosen: &mut Vec<usize>) -> bool {
    if chosen.len() == balls.len() {
        return chosen.iter().enumerate().any(|(place, ball)| place != *ball);
    }
    let place = chosen.len();
    for ball in 0..balls.len() {
        let keeps = |(other, image): (usize, &usize)| {
            let before = (balls[place].at - balls[other].at).norm();
            let after = (balls[ball].at - balls[*image].at).norm();
            (before - after).abs() <= ALIKE_M
        };
        let fits = !chosen.contains(&ball)
            && is_same_size(&balls[place], &balls[ball])
            && chosen.iter().enumerate().all(keeps);
        if fits {
            chosen.push(ball);
            if can_be_exchanged(balls, chosen) {
                return true;
            }
            chosen.pop();
        }
    }
    false
}
