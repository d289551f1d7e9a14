//! What can be wrong with what the engine is given.

use super::angles::BeamAngles;
use crate::{CscError, RowsError};
use thiserror::Error;

/// Why dose cannot be computed.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum DoseError {
    /// A volume does not belong to the image's grid.
    #[error("{volume} has {found} values, but the image's grid has {expected} voxels")]
    Length {
        /// Name of the volume.
        volume: &'static str,
        /// Voxels of the grid.
        expected: usize,
        /// Values of the volume.
        found: usize,
    },
    /// A grid has no voxels, or more than can be numbered.
    #[error(
        "{what} has {counts:?} voxels along x, y, z; it must have at least one and at most {most} in all"
    )]
    Voxels {
        /// Which grid.
        what: &'static str,
        /// Voxels along its axes.
        counts: [usize; 3],
        /// The most in all.
        most: usize,
    },
    /// A number is out of its range.
    #[error("the {what} is {value}; it must be from {least} to {most} (lengths in mm, angles in degrees)")]
    Number {
        /// Name of the quantity.
        what: &'static str,
        /// Value of the quantity.
        value: f64,
        /// The least that it may be.
        least: f64,
        /// The most that it may be.
        most: f64,
    },
    /// The source would be in the dose grid, or too near to it.
    #[error(
        "the dose grid reaches {reach_mm:.0} mm from the isocentre, too near to the source; it may reach {most_mm:.0} mm: check the isocentre, or take a smaller grid"
    )]
    Far {
        /// Farthest voxel from the isocentre's axis, mm.
        reach_mm: f64,
        /// The most that it may be, mm.
        most_mm: f64,
    },
    /// A beam passes through a part of the patient that the images lack.
    #[error(
        "the beam at {angles} degrees comes to the patient by the end of the images with {by_end} of {bixels} bixels, and what it \
         crosses before is not known: take images of more of the patient, or another couch angle"
    )]
    CutEnd {
        /// The angles of the beam.
        angles: BeamAngles,
        /// Bixels of the beam.
        bixels: usize,
        /// Those that enter by an end.
        by_end: usize,
    },
    /// A case does not say where the patient is.
    #[error("the case has no outline of the patient: name it in a names table, or contour it")]
    NoOutline,
    /// There is nothing to aim at.
    #[error("the target has no voxel; there is nothing to place bixels on")]
    NoTarget,
    /// The target and the patient are in different places.
    #[error(
        "no voxel of the target is inside the outline of the patient: check that both are drawn on the same images"
    )]
    TargetOutside,
    /// The machine file has no point kernels.
    #[error(
        "the machine file has no section `superposition`, so dose cannot be computed by superposition: make one with \
         `tools/research/kernels`, or take `--engine pencil`"
    )]
    NoKernels,
    /// There is nothing that stops a beam.
    #[error(
        "the outline of the patient holds nothing but air: its greatest density is {greatest:.3} of water (allowed: above 0.1); check the Hounsfield units of the images"
    )]
    Air {
        /// The greatest density inside the outline.
        greatest: f32,
    },
    /// There is nobody to give dose to.
    #[error("the external contour holds no voxel of the dose grid; check that both are in the same place")]
    NoPatient,
    /// No ray of a beam crosses both the target and the patient.
    #[error(
        "no bixel of the beam at {angles} degrees meets the patient: the target is outside of the outline, or at its \
         edge; check the outline and the target, or allow bixels that miss the patient with `--flash`"
    )]
    NoBixel {
        /// Where the beam comes from.
        angles: BeamAngles,
    },
    /// A beam has too many bixels.
    #[error("the beam at {angles} degrees has {found} bixels; it may have {most}: take wider ones")]
    Bixels {
        /// Where the beam comes from.
        angles: BeamAngles,
        /// Its bixels.
        found: usize,
        /// The most that there may be.
        most: usize,
    },
    /// Weights do not belong to the bixels of a beam.
    #[error("{found} weights are given for the {expected} bixels of the beam at {angles} degrees")]
    Weights {
        /// Where the beam comes from.
        angles: BeamAngles,
        /// Bixels of the beam.
        expected: usize,
        /// Weights given.
        found: usize,
    },
    /// What was computed is no matrix.
    #[error("the dose of the beam at {angles} degrees is not a matrix: {fault}; check the machine's kernels")]
    Matrix {
        /// Where the beam comes from.
        angles: BeamAngles,
        /// What is wrong with it.
        fault: CscError,
    },
    /// What was computed is too large to be kept.
    #[error(
        "the dose of the beam at {angles} degrees cannot be stored: {fault}; take wider bixels or a coarser grid"
    )]
    Rows {
        /// Where the beam comes from.
        angles: BeamAngles,
        /// What is wrong with it.
        fault: RowsError,
    },
}
