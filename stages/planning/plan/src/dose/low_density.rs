//! Where beams cross lung or air before they leave the target: there, pencil beams are wrong.

use super::angles::BeamAngles;
use super::engine::DoseEngine;
use super::error::DoseError;
use super::frame::BeamFrame;
use super::siddon::segments;

/// Tissue of less than this density counts as lung or air.
const LOW_DENSITY: f32 = 0.5;
/// Length of lung or air from which on a bixel crosses some, mm: skin that voxels cut counts for less.
pub const LEAST_LOW_DENSITY_MM: f64 = 10.0;

/// Lung and air on the rays of bixels, from the skin to the far side of the target.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LowDensity {
    /// Bixels.
    pub bixels: usize,
    /// Those whose ray crosses at least [`LEAST_LOW_DENSITY_MM`] of lung or air.
    pub crossing: usize,
    /// The most that a ray crosses, mm.
    pub longest_mm: f64,
}

impl LowDensity {
    /// Of the bixels of both.
    pub fn and(self, other: Self) -> Self {
        Self {
            bixels: self.bixels + other.bixels,
            crossing: self.crossing + other.crossing,
            longest_mm: self.longest_mm.max(other.longest_mm),
        }
    }

    /// Part of the bixels whose ray crosses lung or air.
    pub fn share(&self) -> f64 {
        self.crossing as f64 / self.bixels.max(1) as f64
    }

    /// What a person should know of doses by pencil beams there; nothing where no bixel crosses lung or air.
    pub fn caution(&self) -> Option<String> {
        (self.crossing > 0).then(|| {
            format!(
                "dose by pencil beams, which do not know lung and air: {} of {} bixels cross up to {:.0} mm of it before they \
                 leave the target. In a field of 2 cm, pencil beams give about 40 % too much in lung, 20 % too much at the \
                 edge of a tumour in lung, and 60 % too much on a wall behind 2 cm of air; the engine `superposition` knows both",
                self.crossing, self.bixels, self.longest_mm
            )
        })
    }
}

impl DoseEngine {
    /// Lung and air on the rays of these bixels (centres on the isocentre plane, mm).
    ///
    /// # Errors
    /// An angle out of range.
    pub fn low_density(
        &self,
        angles: impl Into<BeamAngles>,
        bixels_mm: &[[f64; 2]],
    ) -> Result<LowDensity, DoseError> {
        let sad_mm = self.machine.file().sad_mm;
        let isocentre_mm = std::array::from_fn(|axis| self.isocentre_mm[axis] - self.shift_mm[axis]);
        let frame = BeamFrame::new(self.checked_angles(angles)?, self.position, isocentre_mm, sad_mm);
        let depths = self.target_mm.iter().map(|point| frame.beam_from_patient(*point)[1]);
        let far_mm = depths.fold(0.0, f64::max);
        let lengths: Vec<f64> = bixels_mm.iter().map(|bixel| self.low_mm(&frame, *bixel, far_mm)).collect();
        Ok(LowDensity {
            bixels: lengths.len(),
            crossing: lengths.iter().filter(|mm| **mm >= LEAST_LOW_DENSITY_MM).count(),
            longest_mm: lengths.iter().copied().fold(0.0, f64::max),
        })
    }

    /// Length of lung and air inside of the outline on the ray of a bixel, as far as a depth of the beam, mm.
    fn low_mm(&self, frame: &BeamFrame, [x, z]: [f64; 2], far_mm: f64) -> f64 {
        let part = far_mm / frame.sad_mm();
        let (from, to) = (frame.source_mm(), frame.patient_from_beam([part * x, far_mm, part * z]));
        let length_mm =
            libm::sqrt((0..3).map(|axis| (to[axis] - from[axis]) * (to[axis] - from[axis])).sum());
        let is_low = |begin: f64, end: f64, voxel: usize| {
            let middle = 0.5 * (begin + end);
            let place = std::array::from_fn(|axis| from[axis] + middle * (to[axis] - from[axis]));
            self.density[voxel] < LOW_DENSITY && self.outline.contains(place)
        };
        let crossed = segments(&self.params.grid, from, to).filter(|s| is_low(s.begin, s.end, s.voxel));
        length_mm * crossed.map(|s| s.end - s.begin).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dose::{Anatomy, DoseParams, Machine};
    use stillpoint_patient::Grid;
    use stillpoint_patient::case::Mask;

    #[test]
    fn a_block_of_lung_before_the_target_counts_from_its_side_alone() {
        let grid = Grid { counts: [40, 40, 20], spacing_mm: [5.0; 3], origin_mm: [-97.5, -97.5, -47.5] };
        let hu: Vec<i16> = (0..grid.len())
            .map(
                |voxel| if (-60.0..-20.0).contains(&grid.centre_mm(grid.voxel(voxel))[1]) { -750 } else { 0 },
            )
            .collect();
        let all = Mask::from_fn(grid.len(), |_| true);
        let target =
            Mask::from_fn(grid.len(), |v| grid.centre_mm(grid.voxel(v)).iter().all(|mm| mm.abs() < 12.0));
        let anatomy = Anatomy { grid, hu: &hu, external: &all, target: &target, isocentre_mm: [0.0; 3] };
        let params = DoseParams { grid, ..DoseParams::over(&grid, 5.0) };
        let engine = DoseEngine::new(&anatomy, Machine::shipped().unwrap(), params).unwrap();
        let bixels = [[0.0, 0.0], [10.0, 0.0]];
        let front = engine.low_density(0.0, &bixels).unwrap();
        assert!(front.crossing == 2 && (39.0..42.0).contains(&front.longest_mm), "{front:?}");
        assert!(front.caution().unwrap().contains("2 of 2 bixels cross up to 40 mm"));
        let back = engine.low_density(180.0, &bixels).unwrap();
        assert_eq!((back.crossing, back.caution()), (0, None));
    }
}
