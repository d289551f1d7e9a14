//! Where the leaves of a segment stand, and what passes them.

use super::engel::Shape;
use super::map::{LeafMap, overlap};
use crate::dose::Collimator;

/// One segment of a beam.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Tips of every leaf pair, those at lower x first, mm on the isocentre plane.
    pub tips_mm: Vec<[f64; 2]>,
    /// Fluence of its open part, in the unit of bixel weights.
    pub weight: f64,
}

/// The segments of a beam.
#[derive(Clone, Debug, PartialEq)]
pub struct LeafBeam {
    /// Edges of the jaws along x and z, mm: nothing passes beside them.
    pub field_mm: [[f64; 2]; 2],
    /// Its segments, in the order in which they are given.
    pub segments: Vec<Segment>,
}

impl LeafBeam {
    /// The segments of these shapes on a map; the jaws stand around all that any of them opens. Nothing where none opens
    /// anything.
    pub fn new(collimator: &Collimator, map: &LeafMap, shapes: &[(f64, Shape)]) -> Option<Self> {
        let open = || {
            let all = shapes.iter().flat_map(|(_, shape)| shape.iter().enumerate());
            all.filter(|(_, [from, to])| from < to)
        };
        let (low, high) = (open().map(|(_, o)| o[0]).min()?, open().map(|(_, o)| o[1]).max()?);
        let (first, last) = (open().map(|(pair, _)| pair).min()?, open().map(|(pair, _)| pair).max()?);
        let along_x = [map.edge_mm(low), map.edge_mm(high)];
        let along_z =
            [collimator.pair_mm(map.first_pair + first)[0], collimator.pair_mm(map.first_pair + last)[1]];
        let mut beam = Self { field_mm: [along_x, along_z], segments: Vec::new() };
        for (weight, shape) in shapes {
            let tips_mm = beam.tips_mm(collimator, map, shape);
            beam.segments.push(Segment { tips_mm, weight: *weight });
        }
        Some(beam)
    }

    /// Tips of all pairs. Closed pairs meet at the lower jaw, as far as their travel allows.
    pub(super) fn tips_mm(&self, collimator: &Collimator, map: &LeafMap, shape: &Shape) -> Vec<[f64; 2]> {
        let over = collimator.over_travel_mm;
        let closed = [self.field_mm[0][0].clamp(-over, over); 2];
        let of = |pair: usize| match pair.checked_sub(map.first_pair).and_then(|at| shape.get(at)) {
            Some([from, to]) if from < to => [map.edge_mm(*from), map.edge_mm(*to)],
            _ => closed,
        };
        (0..collimator.pairs()).map(of).collect()
    }

    /// Part of a bixel's fluence that passes a segment: all of it where it is open, the leaves' transmission behind them,
    /// nothing beside the jaws.
    pub fn passed(
        &self,
        collimator: &Collimator,
        segment: &Segment,
        bixel_mm: [f64; 2],
        width_mm: f64,
    ) -> f64 {
        let half = 0.5 * width_mm;
        let [xs, zs] = [0, 1].map(|axis| {
            let [low, high] = self.field_mm[axis];
            [low.max(bixel_mm[axis] - half), high.min(bixel_mm[axis] + half)]
        });
        let within_x = (xs[1] - xs[0]).max(0.0);
        let first = collimator.leaf_edges_mm.partition_point(|edge| *edge <= zs[0]).saturating_sub(1);
        let pairs = (first..collimator.pairs()).take_while(|pair| collimator.leaf_edges_mm[*pair] < zs[1]);
        let of_pair = |pair: usize| {
            let across = overlap(collimator.pair_mm(pair), zs);
            let open = overlap(segment.tips_mm[pair], xs);
            across * (open + collimator.transmission * (within_x - open))
        };
        pairs.map(of_pair).sum::<f64>() / (width_mm * width_mm)
    }

    /// The fluence of all segments on bixels of this width that lie on its multiples: centres, and weights.
    pub fn fluence(&self, collimator: &Collimator, width_mm: f64) -> (Vec<[f64; 2]>, Vec<f64>) {
        let steps = |axis: usize| {
            let [low, high] = self.field_mm[axis];
            (libm::floor(low / width_mm) as i64)..=(libm::ceil(high / width_mm) as i64)
        };
        let places = steps(0).flat_map(|x| steps(1).map(move |z| [x as f64 * width_mm, z as f64 * width_mm]));
        let weight = |place: [f64; 2]| {
            let of = |s: &Segment| s.weight * self.passed(collimator, s, place, width_mm);
            self.segments.iter().map(of).sum::<f64>()
        };
        places.map(|place| (place, weight(place))).filter(|(_, weight)| *weight > 0.0).unzip()
    }
}
