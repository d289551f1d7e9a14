//! The plane that a search ends with, fitted to its inliers.

use crate::plane::{Plane, PlaneSums};

/// A plane and the points on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneFit {
    /// Least-squares plane of its inliers.
    pub plane: Plane,
    /// Points within the tolerance.
    pub inliers: usize,
    /// Points that are used.
    pub points: usize,
    /// Root mean square of the inliers' distances, in metres.
    pub rms: f64,
    /// Where the search began.
    pub origin: Origin,
    pub hypotheses: u32,
}

/// Where a plane came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The plane given was at least as likely as any drawn.
    Retained,
    /// It was drawn from this cloud.
    Searched,
}

/// Fits to the inliers at most, each with the inliers of the one before.
const REFINEMENTS: usize = 5;

/// The inliers of a plane: their sums, and the sum of their squared distances.
struct Inliers {
    sums: PlaneSums,
    squares: f64,
}

impl Inliers {
    /// Of all `points` in their order, those within `tolerance` metres of `plane`.
    fn of(points: &[[f32; 3]], plane: &Plane, tolerance: f64) -> Self {
        let mut inliers = Self { sums: PlaneSums::default(), squares: 0.0 };
        for &point in points {
            let height = plane.height(point);
            if height.abs() <= tolerance {
                inliers.sums.add(point);
                inliers.squares += height * height;
            }
        }
        inliers
    }
}

/// Fits a plane to its inliers among `points` until they stay the same in number. `None` where the inliers make no
/// plane.
pub(super) fn refine(
    points: &[[f32; 3]],
    start: &Plane,
    tolerance: f64,
    origin: Origin,
    hypotheses: u32,
) -> Option<PlaneFit> {
    let mut inliers = Inliers::of(points, start, tolerance);
    let mut plane = *start;
    for _ in 0..REFINEMENTS {
        plane = inliers.sums.plane()?;
        let before = inliers.sums.count();
        inliers = Inliers::of(points, &plane, tolerance);
        if inliers.sums.count() == before {
            break;
        }
    }
    let count = inliers.sums.count();
    let rms = (inliers.squares / count.max(1) as f64).sqrt();
    Some(PlaneFit { plane, inliers: count, points: points.len(), rms, origin, hypotheses })
}
