//! A corner to a part of a pixel: the place that the gradients around it point across.
//!
//! On an edge through the corner, the gradient is across the line to the corner; within a square it is 0. So the corner has
//! the least sum of `w (g . (q - p))^2` over the pixels `q` around (Foerstner and Guelch, ISPRS Interlaken (1987) 281). Under any
//! response of the sensor a corner looks the same from opposite sides, so blur and response leave it where it is.

use nalgebra::{Matrix2, Vector2};

use super::picture::Picture;

/// How far pixels count, in sides of a square.
const REACH: f64 = 0.85;
/// Steps at most.
const STEPS: usize = 20;
/// A step shorter than this is the last one, px.
const STILL: f64 = 1e-4;
/// Farthest from the start, in the shorter side of a square.
const FARTHEST: f64 = 0.3;

/// The corner near a place, with the sides of a square there.
pub(super) fn refine(
    picture: &Picture,
    start: Vector2<f64>,
    sides: [Vector2<f64>; 2],
) -> Option<Vector2<f64>> {
    let squares = Matrix2::from_columns(&sides).try_inverse()?;
    let reach = sides.map(|side| side.abs()).iter().sum::<Vector2<f64>>() * REACH;
    let shorter = sides[0].norm().min(sides[1].norm());
    let mut at = start;
    for _ in 0..STEPS {
        let (mut across, mut right) = (Matrix2::zeros(), Vector2::zeros());
        let rows = (at.y - reach.y).ceil() as isize..=(at.y + reach.y).floor() as isize;
        for y in rows {
            for x in (at.x - reach.x).ceil() as isize..=(at.x + reach.x).floor() as isize {
                let off = Vector2::new(x as f64, y as f64) - at;
                let parts = squares * off / REACH;
                let weigh = |part: f64| (1.0 - part * part).max(0.0).powi(2);
                let weight = weigh(parts.x) * weigh(parts.y);
                if weight > 0.0 {
                    let gradient = picture.gradient(x, y);
                    let sum = weight * gradient * gradient.transpose();
                    across += sum;
                    right += sum * off;
                }
            }
        }
        let step = across.try_inverse()? * right;
        at += step;
        let is_near = (at - start).norm() < FARTHEST * shorter;
        if !is_near {
            return None;
        }
        if step.norm() < STILL {
            break;
        }
    }
    Some(at)
}
