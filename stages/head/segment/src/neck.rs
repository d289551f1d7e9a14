//! Which way the neck lies, and what that says of the surface around a head.
//!
//! The ball that fits a head best is that of its cranium. A neck may have a ball of its own, lower and beside it. If it
//! has none, the face sticks out of the cranium towards the neck. So the patches that stick out above the centre of the
//! cranium, and belong to no other object, show the direction of the neck. Then a neck can be separated from a pad: it
//! lies in this direction and is no broader than a neck. Other patches that face up beside the head, lower than the
//! middle of its cranium, are not the head.

use crate::ball::Ball;
use crate::head::HeadParams;
use crate::plane::Plane;
use crate::surface::Patch;
use nalgebra::Vector3;
use std::ops::RangeInclusive;

/// In radii of the ball: what is farther from its centre sticks out of it ...
const OUTSIDE: f64 = 1.15;
/// ... as far as this, in radii of the adult head.
const FACE: f64 = 1.8;
/// So high over the centre, in radii of the adult head: a pad is seldom.
const OVER: f64 = 0.15;
/// Radius of the ball of a cranium; it depends on the side that is seen.
const CRANIUM: f64 = 0.93;
/// Patches of a face at least, and how much of their distance from the axis is one way.
const PATCHES: usize = 12;
const ONE_SIDED: f64 = 0.915;
// Lengths from here on are in radii of the adult head, from the centre of the ball.

/// The ball that fits a neck: its radius at most, how far it lies lower than the head's and away from it, and where it
/// is from the cranium.
const THICK: f64 = 0.8;
const LOWER: RangeInclusive<f64> = 0.1..=0.95;
const AWAY_FROM: RangeInclusive<f64> = 0.75..=1.9;
const MIDDLE: f64 = 1.59;
/// Where the neck begins, its half width, how far below the centre its sides are seen, and where it ends.
const NECK: f64 = 0.6;
const HALF_WIDTH: f64 = 0.62;
const SIDES: f64 = -0.5;
const END: f64 = 2.4;
/// The same of the part that cannot be anything else.
const CORE_WIDTH: f64 = 0.4;
const CORE_SIDES: f64 = -0.4;
const CORE_END: f64 = 2.0;
/// Beyond this, all beside the neck is shoulder.
const SHOULDER: f64 = 1.7;
/// What faces up is this far beside the centre, and no higher: it is not the head.
const ASIDE: f64 = 0.8;
const HIGHEST: f64 = 0.05;
/// Cosine of the angle to the plane's normal from which a surface faces up.
const UP: f64 = 0.7;
/// No head is broader than this on either side, nor longer beyond the middle of its cranium.
const BREADTH: f64 = 1.15;
const CROWN: f64 = -1.3;
/// How much the neck leans to the head, and what is none of it away from it: more than a crease in the way can cost.
const NECK_LEANS: f64 = 4.0;
const AWAY: f64 = -4.0;

/// A head's middle, what is up, and which way its neck lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Neck {
    centre: Vector3<f64>,
    up: Vector3<f64>,
    along: Vector3<f64>,
    radius: f64,
}

impl Neck {
    /// From what sticks out of the ball, of the patches that may be the head's: those of no other summit. `radius` is that of the adult head in metres.
    pub fn of_face<'a>(
        patches: impl Iterator<Item = &'a Patch> + Clone,
        ball: &Ball,
        plane: &Plane,
        radius: f64,
    ) -> Option<Self> {
        let (centre, up) = (ball.centre, plane.normal);
        let (mut sum, mut lengths, mut count) = (Vector3::zeros(), 0.0, 0);
        for patch in patches {
            let from_centre = patch.place - centre;
            let (distance, height) = (from_centre.norm(), up.dot(&from_centre));
            if distance < OUTSIDE * ball.radius || distance > FACE * radius || height < OVER * radius {
                continue;
            }
            let lateral = from_centre - height * up;
            sum += lateral;
            lengths += lateral.norm();
            count += 1;
        }
        if count < PATCHES || sum.norm() < ONE_SIDED * lengths {
            return None;
        }
        Some(Self { centre, up, along: sum.normalize(), radius: scale(ball, radius) })
    }

    /// From a ball that fits the neck itself, among those that were found.
    pub fn of_balls(balls: &[Ball], ball: &Ball, plane: &Plane, params: &HeadParams) -> Option<Self> {
        let (up, radius) = (plane.normal, params.radius);
        let lateral = |other: &Ball| {
            let offset = other.centre - ball.centre;
            offset - up.dot(&offset) * up
        };
        let is_neck = |other: &&Ball| {
            let lower = up.dot(&(ball.centre - other.centre)) / radius;
            let away = lateral(other).norm() / radius;
            other.radius < THICK * radius
                && LOWER.contains(&lower)
                && AWAY_FROM.contains(&away)
                && params.is_shown(other)
        };
        let neck = balls.iter().find(is_neck)?;
        let along = lateral(neck).normalize();
        let radius = scale(ball, radius);
        let centre = ball.centre + lateral(neck) - MIDDLE * radius * along;
        Some(Self { centre, up, along, radius })
    }

    /// Where a patch is: along the neck, beside its axis, above it; in radii of the adult head.
    fn place(&self, patch: &Patch) -> [f64; 3] {
        let from_centre = (patch.place - self.centre) / self.radius;
        let height = self.up.dot(&from_centre);
        let along = self.along.dot(&from_centre);
        [along, (from_centre - height * self.up - along * self.along).norm(), height]
    }

    /// Whether a patch is where the neck is.
    pub fn holds(&self, patch: &Patch) -> bool {
        let [along, across, height] = self.place(patch);
        (NECK..END).contains(&along) && across < HALF_WIDTH && height > SIDES
    }

    /// Whether a patch can only be the neck.
    pub fn is_core(&self, patch: &Patch) -> bool {
        let [along, across, height] = self.place(patch);
        (NECK..CORE_END).contains(&along) && across < CORE_WIDTH && height > CORE_SIDES
    }

    /// The weight of a patch for the head, from the place of the neck.
    pub fn lean(&self, patch: &Patch) -> Option<f64> {
        let [along, across, height] = self.place(patch);
        if self.holds(patch) {
            return Some(NECK_LEANS * (2.5 * (END - along)).min(1.0));
        }
        let is_up = patch.normal.dot(&self.up) > UP && height < HIGHEST && along.hypot(across) > ASIDE;
        let is_beyond = across > BREADTH || along < CROWN || (along > SHOULDER && across > HALF_WIDTH);
        (is_up || is_beyond).then_some(AWAY)
    }
}

/// Radius of the head in `ball`: that of an adult head, in metres, as far as the ball agrees.
fn scale(ball: &Ball, radius: f64) -> f64 {
    (radius + ball.radius / CRANIUM) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Above a couch, a cranium and a face that sticks out of it along x, 1 m before a camera that looks down.
    fn head(broad: f64) -> (Vec<Patch>, Ball, Plane) {
        let patch = |x: f64, y: f64, z: f64| Patch {
            place: Vector3::new(x, y, 1.0 - z),
            normal: -Vector3::z(),
            bend: 0.0,
            voxels: 1,
        };
        let mut patches = Vec::new();
        for i in -12..=24 {
            for j in -8..=8 {
                let (x, y) = (f64::from(i) * 0.01, f64::from(j) * 0.01);
                let rise = 0.083 * 0.083 - x * x - y * y;
                let cranium = if rise > 0.0 { rise.sqrt() } else { -0.1 };
                let face = if (0.0..0.15).contains(&x) && y.abs() < broad { 0.05 } else { -0.1 };
                patches.push(patch(x, y, cranium.max(face)));
            }
        }
        let ball = Ball { centre: Vector3::z(), radius: 0.083, voters: 200 };
        (patches, ball, Plane { normal: -Vector3::z(), offset: 1.13 })
    }

    #[test]
    fn the_neck_lies_where_the_face_sticks_out() {
        let (patches, ball, plane) = head(0.04);
        let neck = Neck::of_face(patches.iter(), &ball, &plane, 0.09).unwrap();
        assert!(neck.along.x > 0.99, "{neck:?}");
        let at = |x: f64, y: f64, z: f64| Patch { place: Vector3::new(x, y, 1.0 - z), ..patches[0] };
        // Its top, a pad at the head's side, and the chest.
        assert!(neck.lean(&at(0.15, 0.0, 0.0)).unwrap() > 1.0 && neck.is_core(&at(0.15, 0.0, 0.0)));
        assert!(neck.lean(&at(0.0, 0.1, -0.03)).unwrap() < -1.0);
        assert!(neck.lean(&at(0.25, 0.1, 0.0)).unwrap() < -1.0);
        // Of the top of the head it says nothing.
        assert_eq!(neck.lean(&at(0.0, 0.0, 0.08)), None);
    }

    #[test]
    fn a_bare_ball_has_no_neck() {
        let (patches, ball, plane) = head(0.0);
        assert!(Neck::of_face(patches.iter(), &ball, &plane, 0.09).is_none());
    }

    #[test]
    fn a_ball_lower_than_the_head_and_beside_it_is_the_neck() {
        let (_, head, plane) = head(0.0);
        let params = HeadParams { radius: 0.09, leaf: 0.005, height_min: 0.015, identity: None };
        let at = |x: f64, z: f64| Ball { centre: Vector3::new(x, 0.0, 1.0 - z), radius: 0.06, voters: 200 };
        let found = |ball| Neck::of_balls(&[head, ball], &head, &plane, &params);
        assert!(found(at(0.135, -0.05)).is_some_and(|neck| neck.along.x > 0.99));
        assert!(found(at(0.135, 0.0)).is_none() && found(at(0.3, -0.05)).is_none());
    }
}
