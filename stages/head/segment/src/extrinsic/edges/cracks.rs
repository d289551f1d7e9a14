//! Places between a pixel on the plane and one beyond its edge.

use nalgebra::{Vector2, Vector3};

use super::super::still::Still;
use super::plane::Top;

/// Pixels beyond a place that are looked through for something in front of the couch.
const BEYOND: isize = 4;

/// A place on the plane between two pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crack {
    /// In the plane's axes, m.
    pub at: Vector2<f64>,
    /// One pixel outwards on the plane, m.
    pub step: Vector2<f64>,
    /// Column or row of the pixel across which the place is, px.
    pub line: isize,
}

/// All places, in the axes `u` and `v` of the plane about the foot of the camera.
pub(super) fn cracks(still: &Still, top: &Top, [u, v]: [Vector3<f64>; 2]) -> Vec<Crack> {
    let (width, height) = (still.width as isize, still.height() as isize);
    let point = |x: isize, y: isize| {
        let is_in = (0..width).contains(&x) && (0..height).contains(&y);
        is_in.then(|| still.at(x as usize, y as usize)).flatten()
    };
    let is_on = |point: &Vector3<f64>| top.height(point).abs() < top.near;
    // Where the ray of a point meets the plane.
    let foot = |point: &Vector3<f64>| {
        let along = -top.plane.offset / top.plane.normal.dot(point);
        let at = point * along;
        Vector2::new(u.dot(&at), v.dot(&at))
    };
    let mut found = Vec::new();
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let Some(here) = point(x, y).filter(is_on) else { continue };
            for (right, down) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                if point(x + right, y + down).is_some_and(|next| is_on(&next)) {
                    continue;
                }
                let Some(back) = point(x - right, y - down).filter(is_on) else { continue };
                let beyond = (1..=BEYOND).filter_map(|far| point(x + far * right, y + far * down));
                let is_out = (1..=BEYOND).any(|far| {
                    !(0..width).contains(&(x + far * right)) || !(0..height).contains(&(y + far * down))
                });
                // Something in front of the couch, a hole in it, or the edge of the image.
                let mut beyond = beyond.map(|point| top.height(&point));
                if is_out || beyond.any(|height| height > -top.near) {
                    continue;
                }
                let step = foot(&here) - foot(&back);
                found.push(Crack {
                    at: foot(&here) + 0.5 * step,
                    step,
                    line: if right != 0 { x } else { y },
                });
            }
        }
    }
    found
}
