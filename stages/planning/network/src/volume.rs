//! Density and structures of a case on the image's own voxels, and rays through them.

use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Mask};
use stillpoint_plan::dose::Machine;

/// Length of a step along a ray, mm.
const STEP_MM: f64 = 5.0;
/// Relative electron density above which tissue counts as bone, and as metal.
const BONE: f32 = 1.25;
const METAL: f32 = 2.0;
/// Structures that a volume can tell apart.
pub const MOST_STRUCTURES: usize = 32;

/// A case as rays see it.
#[derive(Clone, Debug)]
pub struct Volume {
    grid: Grid,
    /// Relative electron density; 0 outside of the outline.
    density: Vec<f32>,
    /// One bit for each structure that was given.
    labels: Vec<u32>,
}

/// What a ray passes from a point to its end, mm.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Passed {
    /// Length in water of the same stopping.
    pub water_mm: f64,
    /// Length in the patient.
    pub length_mm: f64,
    /// Length in bone.
    pub bone_mm: f64,
    /// Length in metal.
    pub metal_mm: f64,
    /// Length in each structure.
    pub structures_mm: Vec<f64>,
}

impl Volume {
    /// The density inside the outline, by the machine's table, and the bits of these structures (at most 32 count).
    pub fn new(case: &Case, machine: &Machine, structures: &[&Mask]) -> Self {
        let len = case.grid().len();
        let (mut density, mut labels) = (vec![0.0; len], vec![0; len]);
        if let Some(outline) = case.external() {
            for voxel in outline.mask.indices() {
                density[voxel] = machine.density(f64::from(case.hu()[voxel])) as f32;
            }
        }
        for (bit, mask) in structures.iter().take(MOST_STRUCTURES).enumerate() {
            mask.indices().for_each(|voxel| labels[voxel] |= 1 << bit);
        }
        Self { grid: *case.grid(), density, labels }
    }

    /// The voxel at a point, mm.
    fn voxel(&self, at_mm: [f64; 3]) -> Option<usize> {
        let mut voxel = [0; 3];
        for axis in 0..3 {
            let place = ((at_mm[axis] - self.grid.origin_mm[axis]) / self.grid.spacing_mm[axis]).round();
            if !(0.0..self.grid.counts[axis] as f64).contains(&place) {
                return None;
            }
            voxel[axis] = place as usize;
        }
        Some(self.grid.index(voxel))
    }

    /// The bits of the structures at a point, mm.
    pub fn labels_at(&self, at_mm: [f64; 3]) -> u32 {
        self.voxel(at_mm).map_or(0, |voxel| self.labels[voxel])
    }

    /// What a ray passes from a point (mm) along a direction of length 1, up to the end of the image.
    pub fn pass(&self, from_mm: [f64; 3], direction: [f64; 3], structures: usize) -> Passed {
        let mut passed = Passed { structures_mm: vec![0.0; structures], ..Passed::default() };
        self.each(from_mm, direction, |density, labels| {
            passed.water_mm += STEP_MM * f64::from(density);
            if density > 0.0 {
                passed.length_mm += STEP_MM;
            }
            if density > METAL {
                passed.metal_mm += STEP_MM;
            } else if density > BONE {
                passed.bone_mm += STEP_MM;
            }
            let mut left = labels;
            while left != 0 {
                if let Some(mm) = passed.structures_mm.get_mut(left.trailing_zeros() as usize) {
                    *mm += STEP_MM;
                }
                left &= left - 1;
            }
        });
        passed
    }

    /// The water that a ray passes from a point (mm) along a direction of length 1, mm.
    pub fn water_mm(&self, from_mm: [f64; 3], direction: [f64; 3]) -> f64 {
        let mut water = 0.0;
        self.each(from_mm, direction, |density, _| water += STEP_MM * f64::from(density));
        water
    }

    /// Calls this for each step of a ray, in the middle of the step, until the ray leaves the image.
    fn each(&self, from_mm: [f64; 3], direction: [f64; 3], mut step: impl FnMut(f32, u32)) {
        let place = |axis: usize, along: f64| {
            (from_mm[axis] + along * direction[axis] - self.grid.origin_mm[axis]) / self.grid.spacing_mm[axis]
                + 0.5
        };
        let begin: [f64; 3] = std::array::from_fn(|axis| place(axis, 0.5 * STEP_MM));
        let to_source: [f64; 3] =
            std::array::from_fn(|axis| STEP_MM * direction[axis] / self.grid.spacing_mm[axis]);
        let ends = self.grid.counts.map(|n| n as f64);
        for number in 0_u32.. {
            let n = f64::from(number);
            let at: [f64; 3] = std::array::from_fn(|axis| begin[axis] + n * to_source[axis]);
            if (0..3).any(|axis| !(at[axis] >= 0.0 && at[axis] < ends[axis])) {
                return;
            }
            let voxel = self.grid.index(at.map(|place| place as usize));
            step(self.density[voxel], self.labels[voxel]);
        }
    }
}
