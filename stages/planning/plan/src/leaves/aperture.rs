//! The fluence of beams whose gantry, collimator, couch, jaws and leaves move while the meterset is given.
//!
//! Between two control points all changes linearly with the meterset. An interval is divided until nothing moves by more
//! than [`MOST_TRAVEL_MM`] or turns by more than [`MOST_TURN_DEG`], and each part stands where it is at its middle.

use std::collections::BTreeMap;

use super::segment::Segment;
use crate::dose::{BeamAngles, Collimator};
use crate::recompute::BeamFluence;

/// How far a leaf or a jaw may move within a part of an interval, mm.
const MOST_TRAVEL_MM: f64 = 2.5;
/// How far gantry, collimator and couch may turn within a part, degrees.
const MOST_TURN_DEG: f64 = 2.0;
/// How far beyond the outermost tips the transmission of the leaves counts where no jaws end the field there, mm.
const MARGIN_MM: f64 = 20.0;
/// Angles that differ by less are the same beam, degrees.
const SAME_DEG: f64 = 1e-6;

/// Where all stands at a moment of a beam; the z of the beam's axes is y of IEC 61217.
#[derive(Clone, Debug, PartialEq)]
pub struct Aperture {
    /// Part of the meterset that was given up to here, 0 to 1.
    pub given: f64,
    /// IEC 61217 gantry angle, degrees, which runs on beyond 0 and 360.
    pub gantry_deg: f64,
    /// IEC 61217 collimator angle, degrees, which runs on in the same way.
    pub collimator_deg: f64,
    /// IEC 61217 couch angle (patient support), degrees, which runs on in the same way.
    pub couch_deg: f64,
    /// Edges of the jaws along x, then z of the collimator, mm on the isocentre plane; none where the leaves alone limit the
    /// field.
    pub jaws_mm: [Option<[f64; 2]>; 2],
    /// Tips of every leaf pair, those at the lower coordinate first, mm; empty without leaves.
    pub tips_mm: Vec<[f64; 2]>,
}

/// The leaf pairs of a beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafPairs<'a> {
    /// Whether they travel along z of the collimator, and not along x.
    pub along_z: bool,
    /// Edges of the pairs across their travel, rising, mm.
    pub edges_mm: &'a [f64],
}

/// Fluence of the open beam, in the unit of bixel weights, on bixels of this width. Directions that turn are as many beams
/// as the parts of their intervals. `transmission` is that of the leaves; nothing passes beside the jaws.
pub fn moving_fluence(
    points: &[Aperture],
    leaves: Option<LeafPairs<'_>>,
    transmission: f64,
    weight: f64,
    width_mm: f64,
) -> Vec<BeamFluence> {
    let mut directions: Vec<Direction> = Vec::new();
    for pair in points.windows(2) {
        let [from, to] = [&pair[0], &pair[1]];
        let share = to.given - from.given;
        if share <= 0.0 {
            continue;
        }
        let parts = parts(from, to);
        for part in 0..parts {
            let at = between(from, to, (f64::from(part) + 0.5) / f64::from(parts));
            let is_same = |d: &Direction| {
                (d.gantry_deg - at.gantry_deg).abs() < SAME_DEG
                    && (d.couch_deg - at.couch_deg).abs() < SAME_DEG
                    && (d.collimator_deg - at.collimator_deg).abs() < SAME_DEG
            };
            if !directions.last().is_some_and(is_same) {
                directions.push(Direction::new(&at));
            }
            if let Some(direction) = directions.last_mut() {
                direction.add(&at, leaves, transmission, weight * share / f64::from(parts), width_mm);
            }
        }
    }
    let beams = directions.iter().map(|direction| direction.beam(width_mm));
    beams.filter(|beam| !beam.weights.is_empty()).collect()
}

/// Into how many parts an interval is divided.
fn parts(from: &Aperture, to: &Aperture) -> u32 {
    let moved = |a: &[f64; 2], b: &[f64; 2]| (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
    let tips = from.tips_mm.iter().zip(&to.tips_mm).map(|(a, b)| moved(a, b));
    let jaws = from.jaws_mm.iter().flatten().zip(to.jaws_mm.iter().flatten()).map(|(a, b)| moved(a, b));
    let travel = tips.chain(jaws).fold(0.0, f64::max);
    let angles = |at: &Aperture| [at.gantry_deg, at.collimator_deg, at.couch_deg];
    let turn = angles(from).iter().zip(angles(to)).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
    (travel / MOST_TRAVEL_MM).max(turn / MOST_TURN_DEG).ceil().max(1.0) as u32
}

fn between(from: &Aperture, to: &Aperture, part: f64) -> Aperture {
    let at = |a: f64, b: f64| a + part * (b - a);
    let ends = |a: [f64; 2], b: [f64; 2]| [at(a[0], b[0]), at(a[1], b[1])];
    Aperture {
        given: at(from.given, to.given),
        gantry_deg: at(from.gantry_deg, to.gantry_deg),
        collimator_deg: at(from.collimator_deg, to.collimator_deg),
        couch_deg: at(from.couch_deg, to.couch_deg),
        jaws_mm: [0, 1].map(|axis| from.jaws_mm[axis].zip(to.jaws_mm[axis]).map(|(a, b)| ends(a, b))),
        tips_mm: from.tips_mm.iter().zip(&to.tips_mm).map(|(a, b)| ends(*a, *b)).collect(),
    }
}

/// What is given in a direction, on bixels along the axes of the collimator that lie on multiples of their width.
struct Direction {
    gantry_deg: f64,
    collimator_deg: f64,
    couch_deg: f64,
    weights: BTreeMap<[i32; 2], f64>,
}

impl Direction {
    fn new(at: &Aperture) -> Self {
        let Aperture { gantry_deg, collimator_deg, couch_deg, .. } = *at;
        Self { gantry_deg, collimator_deg, couch_deg, weights: BTreeMap::new() }
    }

    fn add(
        &mut self,
        at: &Aperture,
        leaves: Option<LeafPairs<'_>>,
        transmission: f64,
        weight: f64,
        width_mm: f64,
    ) {
        let along_z = leaves.is_some_and(|leaves| leaves.along_z);
        let Some(Opening { field_mm, edges_mm, tips_mm }) = opening(at, leaves) else { return };
        let collimator = Collimator { leaf_edges_mm: edges_mm, transmission, ..Collimator::generic() };
        let segment = Segment { tips_mm, field_mm, weight: 1.0 };
        let steps =
            |[low, high]: [f64; 2]| ((low / width_mm).floor() as i32)..=((high / width_mm).ceil() as i32);
        for u in steps(field_mm[0]) {
            for v in steps(field_mm[1]) {
                let place = [f64::from(u) * width_mm, f64::from(v) * width_mm];
                let passed = segment.passed(&collimator, place, width_mm);
                if passed > 0.0 {
                    let key = if along_z { [v, u] } else { [u, v] };
                    *self.weights.entry(key).or_default() += weight * passed;
                }
            }
        }
    }

    fn beam(&self, width_mm: f64) -> BeamFluence {
        let (sin, cos) = libm::sincos(self.collimator_deg.to_radians());
        let place = |[x, z]: &[i32; 2]| {
            let [x, z] = [f64::from(*x) * width_mm, f64::from(*z) * width_mm];
            [x * cos - z * sin, x * sin + z * cos]
        };
        BeamFluence {
            angles: BeamAngles { gantry_deg: self.gantry_deg, couch_deg: self.couch_deg }.wrapped(),
            bixels_mm: self.weights.keys().map(place).collect(),
            weights: self.weights.values().copied().collect(),
        }
    }
}

/// What an aperture leaves open: the field along the travel and across it, the edges of the pairs, and their tips.
struct Opening {
    field_mm: [[f64; 2]; 2],
    edges_mm: Vec<f64>,
    tips_mm: Vec<[f64; 2]>,
}

/// Nothing where jaws meet, and where neither jaws nor open leaves end the field along the travel.
fn opening(at: &Aperture, leaves: Option<LeafPairs<'_>>) -> Option<Opening> {
    let [x, z] = at.jaws_mm;
    let (along, across) = if leaves.is_some_and(|leaves| leaves.along_z) { (z, x) } else { (x, z) };
    let (edges_mm, tips_mm) = match leaves {
        Some(leaves) => (leaves.edges_mm.to_vec(), at.tips_mm.clone()),
        None => (across?.to_vec(), vec![along?]),
    };
    let along = along.or_else(|| {
        let open = || tips_mm.iter().filter(|tips| tips[0] < tips[1]);
        let low = open().map(|tips| tips[0]).reduce(f64::min)?;
        let high = open().map(|tips| tips[1]).reduce(f64::max)?;
        Some([low - MARGIN_MM, high + MARGIN_MM])
    })?;
    let across = across.unwrap_or([*edges_mm.first()?, *edges_mm.last()?]);
    let is_open = along[0] < along[1] && across[0] < across[1];
    is_open.then_some(Opening { field_mm: [along, across], edges_mm, tips_mm })
}

#[cfg(test)]
mod tests {
    use super::*;

    const EDGES: [f64; 5] = [-20.0, -10.0, 0.0, 10.0, 20.0];

    fn aperture(given: f64, tips: [f64; 2]) -> Aperture {
        Aperture {
            given,
            gantry_deg: 30.0,
            collimator_deg: 0.0,
            couch_deg: 0.0,
            jaws_mm: [Some([-50.0, 50.0]), Some([-20.0, 20.0])],
            tips_mm: vec![tips; 4],
        }
    }

    fn pairs(along_z: bool) -> Option<LeafPairs<'static>> {
        Some(LeafPairs { along_z, edges_mm: &EDGES })
    }

    /// Fluence times area over that of an open field.
    fn whole(beams: &[BeamFluence], width_mm: f64) -> f64 {
        beams.iter().flat_map(|beam| &beam.weights).sum::<f64>() * width_mm * width_mm
    }

    /// The mean place, weighted.
    fn middle(beam: &BeamFluence) -> [f64; 2] {
        let sum: f64 = beam.weights.iter().sum();
        [0, 1]
            .map(|axis| beam.bixels_mm.iter().zip(&beam.weights).map(|(b, w)| b[axis] * w).sum::<f64>() / sum)
    }

    #[test]
    fn a_field_that_stands_still_has_its_area_and_its_weight() {
        let points = [aperture(0.0, [-10.0, 30.0]), aperture(1.0, [-10.0, 30.0])];
        let beams = moving_fluence(&points, pairs(false), 0.0, 3.0, 2.5);
        assert_eq!((beams.len(), beams[0].angles), (1, 30.0.into()));
        assert!((whole(&beams, 2.5) - 3.0 * 40.0 * 40.0).abs() < 1e-9);
        let [x, z] = middle(&beams[0]);
        assert!((x - 10.0).abs() < 1e-9 && z.abs() < 1e-9, "{x} {z}");
        // What passes the leaves counts within the jaws; without jaws, up to 20 mm beyond the tips.
        let through = moving_fluence(&points, pairs(false), 0.02, 3.0, 2.5);
        assert!((whole(&through, 2.5) - 3.0 * 40.0 * (40.0 + 0.02 * 60.0)).abs() < 1e-9);
        let bare = points.map(|point| Aperture { jaws_mm: [None; 2], ..point });
        let through = moving_fluence(&bare, pairs(false), 0.02, 3.0, 2.5);
        assert!((whole(&through, 2.5) - 3.0 * 40.0 * (40.0 + 0.02 * 40.0)).abs() < 1e-9);
    }

    #[test]
    fn a_window_that_slides_gives_each_place_the_time_that_it_is_open() {
        // A slit of 10 mm slides over 60 mm: in the middle each place is open for a sixth of the meterset.
        let points = [aperture(0.0, [-35.0, -25.0]), aperture(1.0, [25.0, 35.0])];
        let [beam] = &moving_fluence(&points, pairs(false), 0.0, 6.0, 2.5)[..] else {
            panic!("one direction")
        };
        for (place, weight) in beam.bixels_mm.iter().zip(&beam.weights).filter(|(p, _)| p[1].abs() < 15.0) {
            if place[0].abs() < 20.0 {
                assert!((weight - 1.0).abs() < 0.13, "{place:?}: {weight}");
            }
        }
        assert!((whole(std::slice::from_ref(beam), 2.5) - 6.0 * 10.0 * 40.0).abs() < 1e-6);
    }

    #[test]
    fn an_arc_is_a_beam_every_two_degrees_with_its_part_of_the_weight() {
        let last = Aperture { gantry_deg: 370.0, ..aperture(1.0, [-10.0, 10.0]) };
        let first = Aperture { gantry_deg: 350.0, ..aperture(0.0, [-10.0, 10.0]) };
        let beams = moving_fluence(&[first, last], pairs(false), 0.0, 1.0, 5.0);
        let angles: Vec<f64> = beams.iter().map(|beam| beam.angles.gantry_deg.round()).collect();
        assert_eq!(angles, [351.0, 353.0, 355.0, 357.0, 359.0, 1.0, 3.0, 5.0, 7.0, 9.0]);
        assert!(beams.iter().all(|beam| (whole(std::slice::from_ref(beam), 5.0) - 80.0).abs() < 1e-9));
    }

    #[test]
    fn a_collimator_turns_the_field_and_leaves_along_z_are_leaves_along_x_a_quarter_turn_on() {
        let field = |collimator_deg, along_z| {
            let at = |given| Aperture {
                collimator_deg,
                jaws_mm: [Some([-50.0, 50.0]); 2],
                ..aperture(given, [0.0, 30.0])
            };
            let beams = moving_fluence(&[at(0.0), at(1.0)], pairs(along_z), 0.0, 1.0, 2.5);
            middle(&beams[0])
        };
        // Along x at 0 degrees the field lies at x of 15 mm; the collimator turns counter-clockwise as the source sees it.
        let is = |[x, z]: [f64; 2], [a, b]: [f64; 2]| (x - a).abs() < 1e-9 && (z - b).abs() < 1e-9;
        assert!(is(field(0.0, false), [15.0, 0.0]));
        assert!(is(field(90.0, false), [0.0, 15.0]));
        assert!(is(field(0.0, true), [0.0, 15.0]));
        assert!(is(field(90.0, true), [-15.0, 0.0]));
    }

    #[test]
    fn jaws_alone_are_a_field_and_closed_leaves_are_none() {
        let open = |given| Aperture { tips_mm: Vec::new(), ..aperture(given, [0.0; 2]) };
        let beams = moving_fluence(&[open(0.0), open(1.0)], None, 0.02, 1.0, 2.5);
        assert!((whole(&beams, 2.5) - 100.0 * 40.0).abs() < 1e-9);
        let closed = [aperture(0.0, [5.0, 5.0]), aperture(1.0, [5.0, 5.0])];
        assert!(moving_fluence(&closed, pairs(false), 0.0, 1.0, 2.5).is_empty());
        let bare = closed.map(|point| Aperture { jaws_mm: [None; 2], ..point });
        assert!(moving_fluence(&bare, pairs(false), 0.02, 1.0, 2.5).is_empty());
    }
}
