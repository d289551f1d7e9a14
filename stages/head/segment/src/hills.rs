//! Other things beside a head: pads, pillows and shoulders have summits of their own.

use crate::ball::Ball;
use crate::plane::Plane;
use crate::summit::Summits;
use crate::surface::Patch;
use nalgebra::Vector3;
use std::ops::RangeInclusive;

// Lengths are in radii of the adult head.

/// A summit from which the way up leads down this far is of something else ...
const SUMMIT: f64 = 0.2;
/// ... where it is this far beside the ball's centre.
const ASIDE: f64 = 1.0;
/// In radii of the ball: so far over the centre and so far beside it, lower than its top, a head has no summit but that of
/// its neck; a chin is higher. There the way up needs to lead down only this far, as it does between a face and the pad
/// that it is turned to.
const HIGH: RangeInclusive<f64> = 0.4..=0.95;
const HIGH_ASIDE: f64 = 0.87;
const HIGH_SUMMIT: f64 = 0.05;
/// Such a summit has at least this many patches. Flying pixels have fewer.
const PATCHES: u32 = 12;

/// The summits of a frame with their buffers; after the first frames of a size they allocate nothing.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hills {
    summits: Summits,
    /// For each patch whether it belongs to the summit of another object.
    is_other: Vec<bool>,
}

impl Hills {
    /// Measures the heights of `patches` over `plane`.
    pub fn measure(&mut self, patches: &[Patch], plane: &Plane) {
        self.summits.measure(patches.iter().map(|patch| plane.normal.dot(&patch.place) + plane.offset));
    }

    /// Height of each patch over the plane in metres.
    pub fn heights(&self) -> &[f64] {
        self.summits.heights()
    }

    /// Finds the summits of what hangs together by `edges`.
    pub fn find(&mut self, edges: &[[u32; 2]]) {
        self.summits.find(edges, PATCHES);
    }

    /// Parts the patches among the summits. `radius` is that of the adult head in metres.
    pub fn part(&mut self, radius: f64) {
        self.summits.part(HIGH_SUMMIT * radius);
    }

    /// Separates the summits of other objects from those of the head in `ball`. If the ball may be that of the
    /// `cranium`, a high summit beside it belongs to another object; beside the ball of a face, it may be the crown.
    /// `radius` is that of the adult head in metres.
    pub fn separate(&mut self, patches: &[Patch], ball: &Ball, plane: &Plane, radius: f64, cranium: bool) {
        self.is_other.clear();
        let all = patches.iter().zip(self.summits.prominence());
        self.is_other.extend(all.map(|(patch, &prominence)| {
            if prominence <= HIGH_SUMMIT * ball.radius {
                return false;
            }
            let over = plane.normal.dot(&(patch.place - ball.centre));
            let lateral = lateral(&patch.place, ball, plane);
            let is_high =
                cranium && HIGH.contains(&(over / ball.radius)) && lateral > HIGH_ASIDE * ball.radius;
            is_high || (prominence > SUMMIT * radius && lateral > ASIDE * radius)
        }));
    }

    /// Whether the summit of this patch belongs to another object.
    pub fn are_others(&self, patch: usize) -> bool {
        self.is_other[self.summits.basins()[patch] as usize]
    }

    /// The patches that belong to none of the summits of other things.
    pub fn own<'a>(&'a self, patches: &'a [Patch]) -> impl Iterator<Item = &'a Patch> + Clone {
        (0..).zip(patches).filter(|(number, _)| !self.are_others(*number)).map(|(_, patch)| patch)
    }
}

/// How far a place is beside the ball's centre, along the plane, in metres.
pub(crate) fn lateral(place: &Vector3<f64>, ball: &Ball, plane: &Plane) -> f64 {
    let offset = place - ball.centre;
    (offset - plane.normal.dot(&offset) * plane.normal).norm()
}
