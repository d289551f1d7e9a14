//! The cameras of a session with their chosen images.

use std::collections::BTreeMap;

use stillpoint_samples::AlignedBytes;

use super::overlay::PictureView;

/// A camera, and the operator that detects a face, a plane and a hull in its images.
#[derive(Clone, Debug)]
pub struct Camera {
    pub stage: String,
    /// The topic of its images; if there are no images, of its clouds.
    pub image: String,
    /// Topics of the results, by name of their kind.
    pub results: BTreeMap<&'static str, String>,
    /// Number of images that it received.
    pub looked_at: usize,
    /// Number of images that it refused.
    pub refused: usize,
    pub views: Vec<PictureView>,
    /// Whether the results come from a replay.
    pub recomputed_views: bool,
    /// Why there are no chosen images, or fewer than requested.
    pub missing: Option<String>,
}

/// Samples by topic and origin.
pub type Found = BTreeMap<(String, u64), AlignedBytes>;
