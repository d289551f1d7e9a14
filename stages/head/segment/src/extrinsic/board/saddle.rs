//! Places where four squares may meet: saddles of the brightness with two bright and two dark sectors around.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};

use super::picture::Picture;

/// Points on the circle around a saddle.
const RING: usize = 24;
/// Radius of this circle, in standard deviations of the smoothing.
const RADIUS: f64 = 2.5;
/// Share of the strength of a typical corner that a saddle needs: the product of contrasts counts.
const LEAST: f64 = 0.02;
/// Most of the power that brightness around a corner has where opposite points differ, in that of two bright sectors.
const UNEVEN: f64 = 0.3;
/// Saddles at most.
const MOST: usize = 4000;

/// A saddle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Saddle {
    /// Where, px.
    pub at: Vector2<f64>,
    /// A direction through the bright sectors.
    pub bright: Vector2<f64>,
    /// Half of the contrast.
    pub contrast: f64,
}

/// The saddles of a smoothed image, the strongest first. A board has this many corners.
pub(super) fn saddles(smooth: &Picture, sigma: f64, corners: usize) -> Vec<Saddle> {
    let (width, height) = (smooth.width as isize, smooth.height as isize);
    let strength = |x: isize, y: isize| {
        let [xx, xy, yy] = smooth.curvature(x, y);
        xy * xy - xx * yy
    };
    let mut all = vec![0.0; smooth.width * smooth.height];
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            all[(y * width + x) as usize] = strength(x, y);
        }
    }
    let is_most = |x: isize, y: isize, own: f64| {
        let near = (-2..=2).flat_map(|row| (-2..=2).map(move |column| (row, column)));
        near.filter(|off| *off != (0, 0)).all(|(row, column)| {
            let other = all[((y + row) * width + x + column) as usize];
            // Of equal ones, the first.
            if (row, column) < (0, 0) { own > other } else { own >= other }
        })
    };
    let mut most: Vec<(f64, isize, isize)> = Vec::new();
    for y in 3..height - 3 {
        for x in 3..width - 3 {
            let own = all[(y * width + x) as usize];
            if own > 0.0 && is_most(x, y, own) {
                most.push((own, x, y));
            }
        }
    }
    most.sort_by(|a, b| b.0.total_cmp(&a.0));
    let typical = most.get((corners / 2).min(most.len().saturating_sub(1))).map_or(0.0, |(own, ..)| *own);
    most.retain(|(own, ..)| *own > LEAST * typical);
    most.truncate(MOST);
    most.iter().filter_map(|(_, x, y)| saddle(smooth, sigma, *x, *y)).collect()
}

fn saddle(smooth: &Picture, sigma: f64, x: isize, y: isize) -> Option<Saddle> {
    let [xx, xy, yy] = smooth.curvature(x, y);
    let off = -(Matrix2::new(xx, xy, xy, yy).try_inverse()? * smooth.gradient(x, y));
    let is_near = off.norm() < 1.5;
    if !is_near {
        return None;
    }
    let at = Vector2::new(x as f64, y as f64) + off;
    let (bright, contrast) = sectors(smooth, at, RADIUS * sigma)?;
    Some(Saddle { at, bright, contrast })
}

/// The direction of two bright sectors around a place, and half of their contrast; `None` if there are not two and two.
pub(super) fn sectors(smooth: &Picture, at: Vector2<f64>, radius: f64) -> Option<(Vector2<f64>, f64)> {
    let mut waves = [Vector2::zeros(); 4];
    for step in 0..RING {
        let angle = 2.0 * PI * step as f64 / RING as f64;
        let value = smooth.sample(at + radius * Vector2::new(libm::cos(angle), libm::sin(angle)));
        for (times, wave) in waves.iter_mut().enumerate().skip(1) {
            let angle = times as f64 * angle;
            *wave += value * Vector2::new(libm::cos(angle), libm::sin(angle)) * (2.0 / RING as f64);
        }
    }
    let [_, first, second, third] = waves;
    let is_even = first.norm_squared() + third.norm_squared() < UNEVEN * second.norm_squared();
    let angle = 0.5 * libm::atan2(second.y, second.x);
    is_even.then(|| (Vector2::new(libm::cos(angle), libm::sin(angle)), second.norm()))
}
