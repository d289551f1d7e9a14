//! Patients drawn by chance, for tests and campaigns: the same number is the same patient.
//!
//! - [`drawn`]: body, surroundings and view of a number
//! - [`view`]: the cameras, and how they look
//! - [`worn`]: what moves with the head: hair, a cap, a beard; and the mask, which does not

pub mod drawn;
pub mod view;
pub mod worn;

use crate::camera::PinholeError;
use crate::head::HeadError;
use crate::noise::NoiseError;
use crate::render::RenderError;
use crate::sensor::SenseError;
use crate::shape::ShapeError;

/// Why a patient cannot be built or seen.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PatientError {
    /// A head that cannot be.
    #[error(transparent)]
    Head(#[from] HeadError),
    /// A thing that cannot be.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// A camera that cannot be.
    #[error(transparent)]
    Camera(#[from] PinholeError),
    /// A noise that cannot be.
    #[error(transparent)]
    Noise(#[from] NoiseError),
    /// A pose that cannot be.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// An image that cannot be.
    #[error(transparent)]
    Sense(#[from] SenseError),
}
