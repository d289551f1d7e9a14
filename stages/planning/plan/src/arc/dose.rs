//! The dose of arcs that is reported: at angles that are closer to each other than those of the search for leaves.
//!
//! The dose of an interval is the mean of two: that of every second of its angles, and that of the others. How far they are from each
//! other shows what the spacing of angles does.

use std::num::NonZeroUsize;

use super::ArcError;
use super::beam::{ArcBeam, parts_of};
use super::weights::ArcColumns;
use crate::dose::{BixelSpec, Collimator, DoseEngine, DoseError, EngineName};
use crate::fluence::Goals;
use crate::recompute::BeamFluence;
use crate::threads::on_threads;

/// Largest distance between the angles of a dose that is reported, degrees.
pub const REPORTED_DEG: f64 = 1.0;
/// Width of its squares, in bixels: that of the cells of the search.
pub const REPORTED_BIXELS: f64 = 0.5;

/// Doses of all intervals at the points of an engine.
#[derive(Clone, Debug)]
pub struct ArcDose {
    /// For each interval, gray for a weight of 1: of every second angle, and of the others.
    halves: [Vec<Vec<f64>>; 2],
}

/// How far doses of half as many angles are from the reported one, over the points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpacingError {
    /// Root of the mean square, gray.
    pub rms_gy: f64,
    /// The largest, gray.
    pub largest_gy: f64,
}

impl ArcDose {
    /// Computes them by the method of the engine. Any number of threads gives the same bytes. `on_interval` is called after each.
    ///
    /// # Errors
    /// A dose cannot be computed.
    pub fn new(
        engine: &DoseEngine,
        goals: &Goals,
        collimator: &Collimator,
        beams: &[ArcBeam],
        threads: NonZeroUsize,
        on_interval: impl Fn() + Sync,
    ) -> Result<Self, ArcError> {
        let width_mm = REPORTED_BIXELS * engine.params().bixels.width_mm;
        let fine = engine.with_bixels(BixelSpec { width_mm, ..engine.params().bixels });
        let numbers: Vec<(usize, usize)> = beams
            .iter()
            .enumerate()
            .flat_map(|(beam, arc)| (0..arc.points.len() - 1).map(move |number| (beam, number)))
            .collect();
        let both = on_threads(&numbers, threads, |(beam, number)| {
            let arc = &beams[*beam];
            let degrees = (arc.points[number + 1].gantry_deg - arc.points[*number].gantry_deg).abs();
            let parts = parts_of(degrees, REPORTED_DEG).next_multiple_of(2);
            let mut halves = [vec![0.0; goals.voxels().len()], vec![0.0; goals.voxels().len()]];
            for (part, fluence) in
                arc.fluence_between(*number, parts, collimator, width_mm).into_iter().enumerate()
            {
                let dose = dose_of(&fine, &fluence)?;
                let half = halves[part % 2].iter_mut().zip(goals.voxels());
                half.for_each(|(sum, voxel)| *sum += 2.0 * f64::from(dose[*voxel as usize]));
            }
            on_interval();
            Ok::<_, ArcError>(halves)
        })?;
        let (mut first, mut second) = (Vec::new(), Vec::new());
        for [a, b] in both {
            first.push(a);
            second.push(b);
        }
        Ok(Self { halves: [first, second] })
    }

    /// The columns of the intervals: the mean of both halves.
    ///
    /// # Errors
    /// They make no matrix.
    pub fn columns(&self, goals: &Goals) -> Result<ArcColumns, ArcError> {
        let mut columns = ArcColumns::default();
        let [first, second] = &self.halves;
        for (a, b) in first.iter().zip(second) {
            columns.push(a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect(), goals)?;
        }
        Ok(columns)
    }

    /// How far each half is from the mean of both at these weights.
    pub fn spacing_error(&self, weights: &[f64]) -> SpacingError {
        let rows = self.halves[0].first().map_or(0, Vec::len);
        let mut off = vec![0.0; rows];
        let [first, second] = &self.halves;
        for ((a, b), weight) in first.iter().zip(second).zip(weights).filter(|(_, weight)| **weight != 0.0) {
            off.iter_mut().zip(a.iter().zip(b)).for_each(|(off, (a, b))| *off += 0.5 * weight * (a - b));
        }
        let squares: f64 = off.iter().map(|off| off * off).sum();
        SpacingError {
            rms_gy: libm::sqrt(squares / (rows as f64).max(1.0)),
            largest_gy: off.iter().map(|off| off.abs()).fold(0.0, f64::max),
        }
    }
}

/// Dose of a fluence at the points of an engine. Few points are quickest by the matrix of the squares.
fn dose_of(engine: &DoseEngine, fluence: &BeamFluence) -> Result<Vec<f32>, DoseError> {
    let BeamFluence { angles, bixels_mm, weights } = fluence;
    if engine.params().engine == EngineName::Superposition {
        return engine.weighted_bixels(*angles, bixels_mm, weights);
    }
    let beam = engine.squares_of(*angles, bixels_mm.clone())?;
    let matrix = beam.dose.view();
    let mut dose = vec![0.0; engine.rows()];
    for (column, weight) in weights.iter().enumerate() {
        let (rows, values) = matrix.column(column);
        for (row, value) in rows.iter().zip(values) {
            dose[*row as usize] += *weight as f32 * value;
        }
    }
    Ok(dose)
}
