//! Finds faces in grey images: the optional 2-D stage of the dissertation (4.2.2), which used Haar cascades.
//!
//! - `view`: an image turned upright, made smaller, and back.
//! - `detector`: where a view shows faces.
//! - `operator`, `detect.face`.
//!
//! The detector is the crate `rustface` with the model that it ships; see `data/README.md`.

mod detector;
mod operator;
mod view;

pub use detector::{DetectParams, Face, FaceDetector};
pub use view::Top;

use stillpoint_operator::Stage;

/// The operators of this family.
pub const STAGES: &[Stage] = &[Stage::of::<operator::DetectFace>()];
