//! Where the bixels of a beam stand.

use super::frame::BeamFrame;
use super::outline::Outline;
use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

/// Size and place of bixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BixelSpec {
    /// Width and distance on the isocentre plane, mm.
    pub width_mm: f64,
    /// How far beyond the target bixels are placed, mm; whole voxels, and never less than one.
    pub margin_mm: f64,
    /// Where a bixel's fluence lies around its position.
    pub centre: BixelCentre,
    /// How far within the edge of the patient, as the source sees him, the rays of a bixel run at least, mm on the isocentre
    /// plane. Negative: how far beside that edge they may run (flash).
    pub inside_mm: f64,
}

impl BixelSpec {
    /// Bixels of this width with a margin of as much, whose rays all cross the patient.
    pub fn of_width(width_mm: f64) -> Self {
        Self { width_mm, margin_mm: width_mm, centre: BixelCentre::Centred, inside_mm: 0.0 }
    }
}

/// Where a bixel's fluence lies around its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BixelCentre {
    /// Around its position.
    Centred,
    /// As pyRadPlan 0.5.0 places it, for comparison: -0.25 mm along both axes for widths of whole millimetres.
    Offset,
}

impl BixelCentre {
    /// Where the centre is from the position along both axes, mm.
    pub(crate) fn offset_mm(self, width_mm: f64) -> f64 {
        const SAMPLING_MM: f64 = 0.5;
        match self {
            Self::Centred => 0.0,
            Self::Offset => {
                let samples = (width_mm / SAMPLING_MM).floor();
                SAMPLING_MM * ((samples - 1.0) / 2.0 - (width_mm / (2.0 * SAMPLING_MM)).ceil())
            }
        }
    }
}

/// Centres of the target's voxels after a margin around it, mm: each voxel grows to a box.
pub(crate) fn with_margin(grid: &Grid, target: &Mask, margin_mm: f64) -> Vec<[f64; 3]> {
    let mut grown: Vec<bool> = (0..target.len()).map(|voxel| target.contains(voxel)).collect();
    let mut stride = 1;
    for axis in 0..3 {
        let spacing = grid.spacing_mm[axis];
        let reach = (margin_mm.max(spacing) / spacing).ceil() as usize;
        let before = grown.clone();
        for (voxel, _) in before.iter().enumerate().filter(|(_, inside)| **inside) {
            let place = voxel / stride % grid.counts[axis];
            for other in place.saturating_sub(reach)..(place + reach + 1).min(grid.counts[axis]) {
                grown[voxel - place * stride + other * stride] = true;
            }
        }
        stride *= grid.counts[axis];
    }
    (0..grown.len()).filter(|&voxel| grown[voxel]).map(|voxel| grid.centre_mm(grid.voxel(voxel))).collect()
}

/// Bixel centres on the isocentre plane of a beam, x and z in mm, by x and then z: all those that a point projects on and
/// whose rays cross the patient.
///
/// Where bixels are narrower than the voxels (`voxel_mm`), the neighbours between the points are filled in.
pub(crate) fn positions(
    frame: &BeamFrame,
    points_mm: &[[f64; 3]],
    spec: &BixelSpec,
    voxel_mm: f64,
    outline: &Outline,
) -> Vec<[f64; 2]> {
    let width_mm = spec.width_mm;
    let mut steps: Vec<[i64; 2]> = points_mm
        .iter()
        .map(|&point| {
            frame
                .on_isocentre_plane(frame.beam_from_patient(point))
                .map(|mm| (mm / width_mm).round_ties_even() as i64)
        })
        .collect();
    steps.sort_unstable();
    steps.dedup();
    if width_mm < voxel_mm {
        let reach = (voxel_mm / width_mm).floor() as i64;
        let around = |[x, z]: [i64; 2]| {
            (-reach..=reach).flat_map(move |dx| (-reach..=reach).map(move |dz| [x + dx, z + dz]))
        };
        steps = steps.into_iter().flat_map(around).collect();
        steps.sort_unstable();
        steps.dedup();
    }
    let places = steps.into_iter().map(|step| step.map(|s| s as f64 * width_mm));
    places.filter(|place| outline.holds(frame, *place, width_mm, spec.inside_mm)).collect()
}
