//! The outline of a case: where its CT passes from body to air.

use thiserror::Error;

use super::{Mesh, march};
use crate::Grid;
use crate::case::{Case, Mask};

/// Half way from air to water, HU: a voxel that the skin halves.
const SKIN_HU: f32 = -500.0;
const AIR_HU: f32 = -1000.0;
const BODY_HU: f32 = 0.0;

/// A case without the structure of its outline.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error(
    "the case has no outline of the patient: name the structure (`External` or `Body`) in a names table when it is imported"
)]
pub struct NoOutline;

/// The outline of a case, mm in the DICOM patient frame.
///
/// The structure of the outline says where the patient is: what lies outside (the couch, a mask) and cavities inside do
/// not count. The CT of the voxels at its border says where in them the skin is.
///
/// # Errors
/// A case without that structure.
pub fn outline(case: &Case) -> Result<Mesh, NoOutline> {
    let external = case.external().ok_or(NoOutline)?;
    let grid = case.grid();
    let (deep, near) =
        (border(grid, &external.mask, Border::Within), border(grid, &external.mask, Border::Around));
    let value = |(i, hu): (usize, &i16)| {
        let hu = f32::from(*hu).clamp(AIR_HU, BODY_HU);
        match (external.mask.contains(i), deep[i], near[i]) {
            (true, true, _) => BODY_HU,
            (true, false, _) => hu,
            // What touches the patient ends where the structure does.
            (false, _, true) => hu.min(SKIN_HU - 5.0),
            (false, _, false) => AIR_HU,
        }
    };
    let values: Vec<f32> = case.hu().iter().enumerate().map(value).collect();
    Ok(march(grid, &values, SKIN_HU))
}

#[derive(Clone, Copy, PartialEq)]
enum Border {
    /// Voxels of the mask whose neighbours are all of it.
    Within,
    /// Voxels that are of the mask or have a neighbour that is.
    Around,
}

/// Erosion or dilation by one voxel, over all 26 neighbours: axis by axis.
fn border(grid: &Grid, mask: &Mask, border: Border) -> Vec<bool> {
    let mut now: Vec<bool> = (0..grid.len()).map(|i| mask.contains(i)).collect();
    let strides = [1, grid.counts[0], grid.counts[0] * grid.counts[1]];
    for (stride, count) in strides.into_iter().zip(grid.counts) {
        let join = |i: usize| {
            let at = i / stride % count;
            let low = (at > 0).then(|| now[i - stride]);
            let high = (at + 1 < count).then(|| now[i + stride]);
            // The patient goes on beyond the images.
            let [low, high] = [low, high].map(|side| side.unwrap_or(now[i]));
            match border {
                Border::Within => now[i] && low && high,
                Border::Around => now[i] || low || high,
            }
        };
        now = (0..now.len()).map(join).collect();
    }
    now
}
