//! Axes of the cones.

use super::section::PointKernels;

/// The axis of a cone, in the beam's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    /// Where energy goes: a unit vector.
    pub towards: [f64; 3],
    /// The ring of the cone.
    pub ring: usize,
}

/// Turn of a ring beside the one before: the golden angle, so that axes of neighbouring rings lie apart.
const TURN: f64 = 2.399_963_229_728_653;

/// The axes of all cones: each ring at the middle of its solid angle, the first ring of one cone along the beam.
pub(super) fn axes(kernels: &PointKernels) -> Vec<Axis> {
    let mut axes = Vec::new();
    for (ring, (edges, &cones)) in kernels.edges_deg.windows(2).zip(&kernels.cones).enumerate() {
        let [low, high] = [edges[0], edges[1]].map(|deg| libm::cos(deg.to_radians()));
        let is_cap = cones == 1 && ring == 0;
        let cos = if is_cap { 1.0 } else { 0.5 * (low + high) };
        let sin = libm::sqrt((1.0 - cos * cos).max(0.0));
        for cone in 0..cones {
            let azimuth = std::f64::consts::TAU * cone as f64 / cones as f64 + TURN * ring as f64;
            axes.push(Axis { towards: [sin * libm::cos(azimuth), cos, sin * libm::sin(azimuth)], ring });
        }
    }
    axes
}
