//! Where the leaves of a segment stand, and what passes them.

use super::engel::Shape;
use super::map::{LeafMap, overlap};
use crate::dose::Collimator;

/// One segment of a beam.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Tips of every leaf pair, those at lower x first, mm on the isocentre plane.
    pub tips_mm: Vec<[f64; 2]>,
    /// Edges of the jaws along x and z, mm: nothing passes beside them.
    pub field_mm: [[f64; 2]; 2],
    /// Fluence of its open part, in the unit of bixel weights.
    pub weight: f64,
}

impl Segment {
    /// Part of a bixel's fluence that passes: all of it where the segment is open, the leaves' transmission behind them, nothing
    /// beside the jaws.
    pub fn passed(&self, collimator: &Collimator, bixel_mm: [f64; 2], width_mm: f64) -> f64 {
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
            let open = overlap(self.tips_mm[pair], xs);
            across * (open + collimator.transmission * (within_x - open))
        };
        pairs.map(of_pair).sum::<f64>() / (width_mm * width_mm)
    }
}

/// The segments of a beam.
#[derive(Clone, Debug, PartialEq)]
pub struct LeafBeam {
    /// Edges of the smallest rectangle around the jaws of its segments along x and z, mm.
    pub field_mm: [[f64; 2]; 2],
    /// Its segments, in the order in which they are given.
    pub segments: Vec<Segment>,
}

impl LeafBeam {
    /// The segments of these shapes on a map, behind jaws that stand around all that any of them opens or follow each, as the
    /// collimator can. Nothing where none opens anything. A segment that opens nothing has the jaws of the beam.
    pub fn new(collimator: &Collimator, map: &LeafMap, shapes: &[(f64, Shape)]) -> Option<Self> {
        let opened: Vec<Option<[[f64; 2]; 2]>> =
            shapes.iter().map(|(_, shape)| opened_mm(collimator, map, shape)).collect();
        let all = opened.iter().flatten().copied().reduce(hull)?;
        let jaws = |open: &[[f64; 2]; 2]| collimator.jaws_mm(*open, all);
        let field_mm = opened.iter().flatten().map(jaws).reduce(hull)?;
        let segments = shapes.iter().zip(&opened).map(|((weight, shape), open)| Segment {
            tips_mm: tips_mm(collimator, map, shape, field_mm),
            field_mm: open.as_ref().map_or(field_mm, jaws),
            weight: *weight,
        });
        Some(Self { field_mm, segments: segments.collect() })
    }

    /// The fluence of all segments on bixels of this width that lie on its multiples: centres, and weights.
    pub fn fluence(&self, collimator: &Collimator, width_mm: f64) -> (Vec<[f64; 2]>, Vec<f64>) {
        let steps = |axis: usize| {
            let [low, high] = self.field_mm[axis];
            (libm::floor(low / width_mm) as i64)..=(libm::ceil(high / width_mm) as i64)
        };
        let places = steps(0).flat_map(|x| steps(1).map(move |z| [x as f64 * width_mm, z as f64 * width_mm]));
        let weight = |place: [f64; 2]| {
            let of = |s: &Segment| s.weight * s.passed(collimator, place, width_mm);
            self.segments.iter().map(of).sum::<f64>()
        };
        places.map(|place| (place, weight(place))).filter(|(_, weight)| *weight > 0.0).unzip()
    }
}

/// Edges of the smallest rectangle around what a shape opens; nothing where it opens nothing.
fn opened_mm(collimator: &Collimator, map: &LeafMap, shape: &Shape) -> Option<[[f64; 2]; 2]> {
    let open = shape.iter().enumerate().filter(|(_, [from, to])| from < to);
    let of = |(pair, [from, to]): (usize, &[usize; 2])| {
        [[map.edge_mm(*from), map.edge_mm(*to)], collimator.pair_mm(map.first_pair + pair)]
    };
    open.map(of).reduce(hull)
}

/// The smallest rectangle around two.
fn hull(a: [[f64; 2]; 2], b: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    [0, 1].map(|axis| [a[axis][0].min(b[axis][0]), a[axis][1].max(b[axis][1])])
}

/// Tips of all pairs. Closed pairs meet at the lower jaw of the beam, as far as their travel allows.
fn tips_mm(collimator: &Collimator, map: &LeafMap, shape: &Shape, field_mm: [[f64; 2]; 2]) -> Vec<[f64; 2]> {
    let over = collimator.over_travel_mm;
    let closed = [field_mm[0][0].clamp(-over, over); 2];
    let of = |pair: usize| match pair.checked_sub(map.first_pair).and_then(|at| shape.get(at)) {
        Some([from, to]) if from < to => [map.edge_mm(*from), map.edge_mm(*to)],
        _ => closed,
    };
    (0..collimator.pairs()).map(of).collect()
}
