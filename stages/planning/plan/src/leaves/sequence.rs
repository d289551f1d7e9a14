//! Leaf sequencing of the beams of a plan.

use super::engel::{Shape, divide};
use super::influence::{Passed, SegmentDose, of_segments, side_by_side};
use super::map::{LeafMap, LeavesError};
use super::price::{slopes, steepest};
use super::segment::{LeafBeam, Segment};
use crate::dose::Collimator;
use crate::fluence::{Goals, Options, Plan, solve_plan};
use crate::{Rows, RowsError, Setups};

/// Accuracy of the weights of segments.
const ACCURACY: Options = Options { tolerance: 1e-6, ..Options::DEFAULT };

/// A beam with its fluence.
#[derive(Clone, Debug)]
pub struct FluenceBeam<'a> {
    /// Its dose matrices, one for each set-up.
    pub doses: Setups<'a>,
    /// Centres of its bixels, mm.
    pub bixels_mm: &'a [[f64; 2]],
    /// Their weights.
    pub weights: &'a [f64],
}

/// Steps in which segments that are too light are left out.
const THINNING: u32 = 4;
/// What a round of segments by price lessens the objective at least, as a part of it.
const LEAST_GAIN: f64 = 1e-3;

/// How fluences are sequenced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafOptions {
    /// Width of a bixel, mm.
    pub width_mm: f64,
    /// Levels of each beam.
    pub levels: u32,
    /// Segments are added by price until the objective is this part above that of the fluence.
    pub loss: f64,
    /// Most segments of a beam.
    pub most_segments: usize,
    /// Least weight of a segment; lighter ones are left out.
    pub least_weight: f64,
}

impl LeafOptions {
    /// Those of plans with bixels of 10 mm, without a least weight.
    pub const PLAN: Self =
        Self { width_mm: 10.0, levels: 20, loss: 0.02, most_segments: 60, least_weight: 0.0 };
}

/// A plan in segments.
#[derive(Clone, Debug)]
pub struct Sequenced {
    /// The segments of each beam; nothing for a beam without fluence.
    pub beams: Vec<Option<LeafBeam>>,
    /// The weights of all segments, with doses and certificate.
    pub plan: Plan,
    /// Objective of the segments of the levels with optimised weights, behind leaves that let nothing through.
    pub divided: f64,
    /// The same after segments were added by price.
    pub opaque: f64,
    /// Segments that were added by price.
    pub added: usize,
}

/// A beam while its segments change.
#[derive(Clone)]
struct Growing<'a> {
    beam: &'a FluenceBeam<'a>,
    map: LeafMap,
    shapes: Vec<(f64, Shape)>,
    /// Doses that were computed last, with their segment (of weight 1) and the transmission of the leaves.
    doses: Vec<(f64, Segment, SegmentDose)>,
}

/// The fluences as segments of the collimator; `objective` is that of the fluences.
pub fn sequence(
    goals: &Goals,
    beams: &[FluenceBeam<'_>],
    collimator: &Collimator,
    objective: f64,
    options: LeafOptions,
) -> Result<Sequenced, LeavesError> {
    let mut growing = Vec::new();
    for beam in beams {
        let map = LeafMap::new(collimator, beam.bixels_mm, beam.weights, options.width_mm)?;
        growing.push(map.map(|map| Growing::new(beam, map, options.levels)).transpose()?);
    }
    let closed = Collimator { transmission: 0.0, ..collimator.clone() };
    let mut plan = solved(goals, &mut growing, &closed)?;
    let divided = plan.certificate.objective;
    let most = (1.0 + options.loss) * objective;
    let mut added = grown(goals, &mut growing, &mut plan, (&closed, most), options.most_segments)?;
    let opaque = plan.certificate.objective;
    growing.iter_mut().flatten().for_each(|beam| {
        beam.thin(0.0);
    });
    if collimator.transmission > 0.0 {
        plan = solved(goals, &mut growing, collimator)?;
    }
    thinned(goals, &mut growing, &mut plan, (collimator, options.least_weight))?;
    // By price once more with the transmission, as long as what is added lessens the objective and is heavy enough to stay.
    while collimator.transmission > 0.0 && plan.certificate.objective > most {
        let before = (growing.clone(), plan.clone());
        let now = grow_all(goals, &mut growing, &plan, (collimator, options.most_segments));
        if now > 0 {
            plan = solved(goals, &mut growing, collimator)?;
            thinned(goals, &mut growing, &mut plan, (collimator, options.least_weight))?;
        }
        if plan.certificate.objective > before.1.certificate.objective * (1.0 - LEAST_GAIN) {
            (growing, plan) = before;
            break;
        }
        added += now;
    }
    let beams =
        growing.iter().map(|beam| LeafBeam::new(collimator, &beam.as_ref()?.map, &beam.as_ref()?.shapes));
    Ok(Sequenced { beams: beams.collect(), plan, divided, opaque, added })
}

/// Adds segments by price until the objective is at most `most`, or until that brings nothing; says how many.
fn grown(
    goals: &Goals,
    growing: &mut [Option<Growing<'_>>],
    plan: &mut Plan,
    (collimator, most): (&Collimator, f64),
    most_segments: usize,
) -> Result<usize, LeavesError> {
    let mut added = 0;
    while plan.certificate.objective > most {
        let before = plan.certificate.objective;
        let now = grow_all(goals, growing, plan, (collimator, most_segments));
        if now == 0 {
            break;
        }
        added += now;
        *plan = solved(goals, growing, collimator)?;
        if plan.certificate.objective > before * (1.0 - 1e-4) {
            break;
        }
    }
    Ok(added)
}

/// Adds to each beam the segment of the steepest slope, at weight 0, and says how many beams have one.
fn grow_all(
    goals: &Goals,
    growing: &mut [Option<Growing<'_>>],
    plan: &Plan,
    (collimator, most_segments): (&Collimator, usize),
) -> usize {
    let beams = growing.iter_mut().flatten();
    beams.map(|beam| usize::from(beam.grow(goals, plan, collimator, most_segments))).sum()
}

/// Leaves out segments that are too light. The lightest go first: what they gave goes to those that are nearly as light, and
/// these may then stay. Each round leaves at least one segment out, so it ends.
fn thinned(
    goals: &Goals,
    growing: &mut [Option<Growing<'_>>],
    plan: &mut Plan,
    (collimator, least_weight): (&Collimator, f64),
) -> Result<(), LeavesError> {
    for step in 1..=THINNING {
        let least = least_weight * f64::from(step) / f64::from(THINNING);
        while growing.iter_mut().flatten().map(|beam| beam.thin(least)).sum::<usize>() > 0 {
            *plan = solved(goals, growing, collimator)?;
        }
    }
    Ok(())
}

impl<'a> Growing<'a> {
    fn new(beam: &'a FluenceBeam<'a>, map: LeafMap, levels: u32) -> Result<Self, LeavesError> {
        let levels = map.levels(levels)?;
        let shapes = divide(&levels.levels, levels.columns);
        let shapes =
            shapes.into_iter().map(|(units, shape)| (f64::from(units) * levels.unit, shape)).collect();
        Ok(Self { beam, map, shapes, doses: Vec::new() })
    }

    /// Adds the segment of the steepest slope, at weight 0; false where none lessens the objective or there are enough.
    fn grow(&mut self, goals: &Goals, plan: &Plan, collimator: &Collimator, most: usize) -> bool {
        let carrying = self.shapes.iter().filter(|(weight, _)| *weight > 0.0).count();
        if carrying >= most {
            return false;
        }
        let slopes = slopes(goals, plan, &self.beam.doses);
        let steepest = steepest(collimator, &self.map, self.beam.bixels_mm, &slopes);
        let Some((_, shape)) = steepest.filter(|(_, shape)| self.shapes.iter().all(|(_, s)| s != shape))
        else {
            return false;
        };
        self.shapes.push((0.0, shape));
        true
    }

    /// Leaves out the segments of less weight, and says how many.
    fn thin(&mut self, least: f64) -> usize {
        let before = self.shapes.len();
        self.shapes.retain(|(weight, _)| *weight > 0.0 && *weight >= least);
        before - self.shapes.len()
    }

    /// Dose of its segments by weight. Segments that stand where they stood keep their dose.
    fn doses(&mut self, goals: &Goals, collimator: &Collimator) -> Result<Rows, RowsError> {
        let beam = LeafBeam::new(collimator, &self.map, &self.shapes);
        // Without a beam no shape opens anything, and there are none.
        let segments = beam.map_or_else(Vec::new, |beam| beam.segments);
        let segments: Vec<Segment> = segments.into_iter().map(|s| Segment { weight: 1.0, ..s }).collect();
        let before = std::mem::take(&mut self.doses);
        let known = |segment: &Segment| {
            let mut of_same = before.iter().filter(|(through, ..)| *through == collimator.transmission);
            of_same.find(|(_, other, _)| other == segment).map(|(.., dose)| dose.clone())
        };
        let doses: Vec<Option<SegmentDose>> = segments.iter().map(known).collect();
        let new: Vec<&Segment> = segments
            .iter()
            .zip(&doses)
            .filter(|(_, dose)| dose.is_none())
            .map(|(segment, _)| segment)
            .collect();
        let mut parts = Vec::with_capacity(new.len() * self.beam.bixels_mm.len());
        for bixel in self.beam.bixels_mm {
            parts.extend(new.iter().map(|s| s.passed(collimator, *bixel, self.map.width_mm) as f32));
        }
        let passed = Passed { segments: new.len(), parts };
        let mut computed = of_segments(&self.beam.doses, goals.voxels(), &passed).into_iter();
        let doses: Vec<SegmentDose> =
            doses.into_iter().filter_map(|dose| dose.or_else(|| computed.next())).collect();
        let joined = side_by_side(&doses, goals.voxels(), self.beam.doses.rows());
        let remembered =
            segments.into_iter().zip(doses).map(|(segment, dose)| (collimator.transmission, segment, dose));
        self.doses = remembered.collect();
        joined
    }
}

/// Solves for the weights of all segments from those that they have, and gives them theirs.
fn solved(
    goals: &Goals,
    growing: &mut [Option<Growing<'_>>],
    collimator: &Collimator,
) -> Result<Plan, LeavesError> {
    let matrices: Result<Vec<Rows>, RowsError> =
        growing.iter_mut().flatten().map(|beam| beam.doses(goals, collimator)).collect();
    let matrices = matrices?;
    let setups: Vec<Setups<'_>> = matrices.iter().map(|m| m.view().into()).collect();
    let start: Vec<f64> =
        growing.iter().flatten().flat_map(|beam| beam.shapes.iter().map(|(weight, _)| *weight)).collect();
    let plan = solve_plan(&goals.problem(&setups)?, Some(&start), ACCURACY)?;
    let shapes = growing.iter_mut().flatten().flat_map(|beam| beam.shapes.iter_mut());
    shapes.zip(&plan.weights).for_each(|((weight, _), solved)| *weight = *solved);
    Ok(plan)
}
