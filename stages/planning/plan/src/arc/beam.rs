//! The leaves of an arc as a machine gets them: tips of all pairs at each control point, and the monitor units given until there.

use super::field::{ArcField, LeafRow};
use super::spec::ArcSpec;
use super::trajectory::Trajectory;
use super::window::nearest;
use crate::dose::{ArcLimits, BeamAngles, Collimator, Stretch, farthest_mm};
use crate::leaves::Segment;
use crate::recompute::BeamFluence;

/// How far a tip may move while it counts as standing still, mm.
const MOST_TRAVEL_MM: f64 = 2.5;

/// An arc.
#[derive(Clone, Debug, PartialEq)]
pub struct ArcBeam {
    /// Which way it goes.
    pub spec: ArcSpec,
    /// Edges of the jaws along x and z, mm: nothing passes beside them.
    pub field_mm: [[f64; 2]; 2],
    /// Its control points, at least two.
    pub points: Vec<ArcPoint>,
}

/// A control point of an arc.
#[derive(Clone, Debug, PartialEq)]
pub struct ArcPoint {
    /// Gantry angle (IEC 61217), degrees; it runs on beyond 0 and 360.
    pub gantry_deg: f64,
    /// Monitor units of one fraction that were given up to here.
    pub units: f64,
    /// Tips of every leaf pair, those at lower x first, mm on the isocentre plane.
    pub tips_mm: Vec<[f64; 2]>,
}

impl ArcBeam {
    /// The arcs of a trajectory, with the jaws around all that each opens; an arc that opens nothing is left out. Pairs that have
    /// no part in it stand this gap apart behind the lower jaw.
    pub fn all(
        field: &ArcField,
        trajectory: &Trajectory,
        collimator: &Collimator,
        arcs: &[ArcSpec],
        mu_per_weight: f64,
        gap_mm: f64,
    ) -> Vec<Self> {
        let of = |(arc, spec): (usize, &ArcSpec)| {
            let points: Vec<usize> =
                (0..field.points.len()).filter(|at| field.points[*at].arc == arc).collect();
            let field_mm = jaws(field, trajectory, &points)?;
            let parked = parked(collimator, field_mm[0][0], gap_mm);
            let mut units = 0.0;
            let mut all = Vec::with_capacity(points.len());
            for point in points {
                if let Some(interval) = field.points[point].before {
                    units += trajectory.weights[interval] * mu_per_weight;
                }
                all.push(ArcPoint {
                    gantry_deg: field.points[point].gantry_deg,
                    units,
                    tips_mm: all_pairs(&field.rows, &trajectory.tips_mm[point], collimator, parked),
                });
            }
            Some(Self { spec: *spec, field_mm, points: all })
        };
        arcs.iter().enumerate().filter_map(of).collect()
    }

    /// The same with the monitor units of another one, control point by control point.
    #[must_use]
    pub fn with_units(mut self, other: &Self) -> Self {
        self.points.iter_mut().zip(&other.points).for_each(|(point, of)| point.units = of.units);
        self
    }

    /// Monitor units of one fraction.
    pub fn units(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.units)
    }

    /// The stretches between its control points.
    pub fn stretches(&self) -> Vec<Stretch> {
        let of = |(number, pair): (usize, &[ArcPoint])| Stretch {
            degrees: (pair[1].gantry_deg - pair[0].gantry_deg).abs(),
            travel_mm: self.travel_mm(number),
            units: pair[1].units - pair[0].units,
        };
        self.points.windows(2).enumerate().map(of).collect()
    }

    /// Seconds from the first control point to the last.
    pub fn seconds(&self, limits: &ArcLimits) -> f64 {
        self.stretches().iter().map(|stretch| limits.seconds(stretch)).sum()
    }

    /// The first limit of a machine that does not hold for all pairs to a nanometre, in words.
    pub fn fault(&self, limits: &ArcLimits, collimator: &Collimator) -> Option<String> {
        const LEAST: f64 = 1e-6;
        let (reach, over) = (collimator.reach_mm + LEAST, collimator.over_travel_mm + LEAST);
        for (number, point) in self.points.iter().enumerate() {
            for (pair, [low, high]) in point.tips_mm.iter().enumerate() {
                let is_within = (-reach..=over).contains(low) && (-over..=reach).contains(high);
                if !is_within || high - low < limits.least_gap_mm - LEAST {
                    return Some(format!(
                        "arc {}, control point {number}, pair {pair}: tips at {low} and {high} mm",
                        self.spec
                    ));
                }
            }
        }
        for (number, stretch) in self.stretches().iter().enumerate() {
            if let Some(fault) = limits.fault(stretch) {
                return Some(format!("arc {}, after control point {number}: {fault}", self.spec));
            }
        }
        None
    }

    /// The fluence between two control points for a weight of 1: as so many static beams, each at the middle of its part of the
    /// angle, with the leaves moving as they do within it. Squares of this width tile the field from its lower edges on, so that rows of leaves
    /// that are as wide begin and end with squares.
    pub fn fluence_between(
        &self,
        number: usize,
        parts: usize,
        collimator: &Collimator,
        width_mm: f64,
    ) -> Vec<BeamFluence> {
        let (from, to) = (&self.points[number], &self.points[number + 1]);
        let centres = |[low, high]: [f64; 2]| {
            let count = libm::ceil((high - low) / width_mm - 1e-9).max(1.0) as u32;
            (0..count).map(move |at| low + (f64::from(at) + 0.5) * width_mm)
        };
        let [x, z] = self.field_mm;
        let bixels_mm: Vec<[f64; 2]> = centres(x).flat_map(|x| centres(z).map(move |z| [x, z])).collect();
        let mix = |a: f64, b: f64, part: f64| a + part * (b - a);
        let at = |part: f64| Segment {
            tips_mm: from
                .tips_mm
                .iter()
                .zip(&to.tips_mm)
                .map(|(a, b)| [0, 1].map(|bank| mix(a[bank], b[bank], part)))
                .collect(),
            field_mm: self.field_mm,
            weight: 1.0,
        };
        let moments = parts_of(self.travel_mm(number) / parts as f64, MOST_TRAVEL_MM);
        let of_part = |part: usize| {
            let middle = (part as f64 + 0.5) / parts as f64;
            let segments: Vec<Segment> = (0..moments)
                .map(|moment| at((part as f64 + (moment as f64 + 0.5) / moments as f64) / parts as f64))
                .collect();
            let passed = |place: &[f64; 2]| {
                let each = segments.iter().map(|segment| segment.passed(collimator, *place, width_mm));
                each.sum::<f64>() / (moments * parts) as f64
            };
            BeamFluence {
                angles: BeamAngles::from(mix(from.gantry_deg, to.gantry_deg, middle)).wrapped(),
                weights: bixels_mm.iter().map(passed).collect(),
                bixels_mm: bixels_mm.clone(),
            }
        };
        (0..parts).map(of_part).collect()
    }

    /// The longest way of a tip between two control points, mm.
    fn travel_mm(&self, number: usize) -> f64 {
        farthest_mm(&self.points[number].tips_mm, &self.points[number + 1].tips_mm)
    }

    /// The fluence of all of it, in angles of at most `most_deg`; `weight_per_unit` is the fluence, over all fractions, of a
    /// monitor unit in each.
    pub fn fluence(
        &self,
        collimator: &Collimator,
        weight_per_unit: f64,
        width_mm: f64,
        most_deg: f64,
    ) -> Vec<BeamFluence> {
        let mut beams = Vec::new();
        for (number, stretch) in self.stretches().iter().enumerate().filter(|(_, s)| s.units > 0.0) {
            let parts = parts_of(stretch.degrees, most_deg);
            for mut beam in self.fluence_between(number, parts, collimator, width_mm) {
                beam.weights.iter_mut().for_each(|weight| *weight *= stretch.units * weight_per_unit);
                beams.push(beam);
            }
        }
        beams
    }
}

/// Into how many parts of at most this length a length is divided.
pub fn parts_of(length: f64, most: f64) -> usize {
    libm::ceil(length / most - 1e-9).max(1.0) as usize
}

/// Edges of the jaws along x and z around all that control points open while anything is given; nothing where they open nothing.
fn jaws(field: &ArcField, trajectory: &Trajectory, points: &[usize]) -> Option<[[f64; 2]; 2]> {
    let is_on = |at: &usize| {
        let of = &field.points[*at];
        let next = of.before.into_iter().chain(of.after);
        next.into_iter().any(|interval| trajectory.weights[interval] > 0.0)
    };
    let mut edges: Option<[[f64; 2]; 2]> = None;
    for point in points.iter().filter(|at| is_on(at)) {
        for (row, tips) in
            field.rows.iter().zip(&trajectory.tips_mm[*point]).filter(|(_, [low, high])| low < high)
        {
            let [x, z] = edges.unwrap_or([*tips, row.edges_mm]);
            let around = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a.min(c), b.max(d)];
            edges = Some([around(x, *tips), around(z, row.edges_mm)]);
        }
    }
    edges
}

/// Where pairs without a part stand: the gap ends at the lower jaw, as far as the travel of both banks allows.
fn parked(collimator: &Collimator, jaw_mm: f64, gap_mm: f64) -> [f64; 2] {
    let (reach, over) = (collimator.reach_mm, collimator.over_travel_mm);
    let high = jaw_mm.min(reach).min(over + gap_mm).max(-over).max(gap_mm - reach);
    [high - gap_mm, high].map(nearest)
}

/// Tips of all pairs: those of a row for its pairs, and of the others where they stand.
fn all_pairs(
    rows: &[LeafRow],
    tips: &[[f64; 2]],
    collimator: &Collimator,
    parked: [f64; 2],
) -> Vec<[f64; 2]> {
    let mut all = vec![parked; collimator.pairs()];
    for (row, tips) in rows.iter().zip(tips) {
        all[row.pairs.clone()].fill(*tips);
    }
    all
}
