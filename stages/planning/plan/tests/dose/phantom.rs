//! Boxes of water, and what a field gives on its axis there.

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::dose::{
    Anatomy, BeamInfluence, DoseEngine, DoseError, DoseParams, Machine, MachineFile,
};

/// A cube of `voxels` of `spacing_mm` along each axis around the patient frame's origin.
pub fn cube(voxels: usize, spacing_mm: f64) -> Grid {
    let origin = -0.5 * (voxels as f64 - 1.0) * spacing_mm;
    Grid { counts: [voxels; 3], spacing_mm: [spacing_mm; 3], origin_mm: [origin; 3] }
}

/// Dose in a box that is all patient, on its own grid; the target is a cube around `isocentre_mm`.
pub struct Phantom {
    pub grid: Grid,
    pub hu: Vec<i16>,
    pub isocentre_mm: [f64; 3],
    pub target_half_mm: f64,
}

impl Phantom {
    pub fn water(grid: Grid) -> Self {
        Self { grid, hu: vec![0; grid.len()], isocentre_mm: [0.0; 3], target_half_mm: 12.0 }
    }

    pub fn params(&self) -> DoseParams {
        DoseParams { grid: self.grid, ..DoseParams::over(&self.grid, 5.0) }
    }

    pub fn engine(&self, machine: Machine, params: DoseParams) -> DoseEngine {
        self.engine_or_fault(machine, params).unwrap()
    }

    pub fn engine_or_fault(&self, machine: Machine, params: DoseParams) -> Result<DoseEngine, DoseError> {
        let grid = self.grid;
        let in_target = |voxel| {
            let centre = grid.centre_mm(grid.voxel(voxel));
            (0..3).all(|axis| (centre[axis] - self.isocentre_mm[axis]).abs() <= self.target_half_mm)
        };
        let anatomy = Anatomy {
            grid,
            hu: &self.hu,
            external: &Mask::from_fn(grid.len(), |_| true),
            target: &Mask::from_fn(grid.len(), in_target),
            isocentre_mm: self.isocentre_mm,
        };
        DoseEngine::new(&anatomy, machine, params)
    }
}

/// Dose of the bixel at this place to every voxel.
pub fn column(beam: &BeamInfluence, bixel_mm: [f64; 2]) -> Vec<f64> {
    let place = beam.bixels_mm.iter().position(|&bixel| bixel == bixel_mm).unwrap();
    let mut dose = vec![0.0; beam.dose.view().rows];
    let (rows, values) = beam.dose.view().column(place);
    rows.iter().zip(values).for_each(|(&row, &value)| dose[row as usize] = f64::from(value));
    dose
}

/// Dose of all bixels with weight 1 to every voxel.
pub fn ones(beam: &BeamInfluence) -> Vec<f64> {
    let dose = beam.dose.view();
    let mut sum = vec![0.0; dose.rows];
    dose.row.iter().zip(dose.value).for_each(|(&row, &value)| sum[row as usize] += f64::from(value));
    sum
}

/// Dose on the axis of a field in water, straight from the machine's tables: the sum of the kernels over the field, cell
/// by cell of 0.5 mm, with the depth dose and the inverse square. The penumbra changes nothing in the middle of a field.
pub fn on_axis(machine: &MachineFile, field_mm: [f64; 2], ssd_mm: f64, depths_mm: &[f64]) -> Vec<f64> {
    const CELL_MM: f64 = 0.5;
    let ssd = machine.ssd_mm.iter().position(|&s| (s - ssd_mm).abs() < 1.0).unwrap_or(0);
    let in_field = |kernel: &[f64]| {
        let cells = field_mm.map(|side| (side / CELL_MM) as i64);
        let mut sum = 0.0;
        for x in 0..cells[0] {
            for z in 0..cells[1] {
                // The fluence is sampled in the middle of its cells, the kernel on their corners.
                let [x, z] = [x - cells[0] / 2, z - cells[1] / 2].map(|i| CELL_MM * i as f64);
                let r = libm::hypot(x, z);
                let after = machine.kernel_pos_mm.partition_point(|&p| p <= r);
                if let Some(&next) = machine.kernel_pos_mm.get(after) {
                    let last = machine.kernel_pos_mm[after - 1];
                    sum +=
                        kernel[after - 1] + (kernel[after] - kernel[after - 1]) * (r - last) / (next - last);
                }
            }
        }
        sum * CELL_MM * CELL_MM
    };
    let lateral: Vec<f64> =
        machine.kernels_per_mm2.iter().map(|component| in_field(&component[ssd])).collect();
    let m = machine.m_per_mm;
    let dose = |depth: f64| {
        let parts = machine.betas_per_mm.iter().zip(&lateral);
        let water: f64 =
            parts.map(|(b, l)| l * b / (b - m) * (libm::exp(-m * depth) - libm::exp(-b * depth))).sum();
        water * machine.sad_mm * machine.sad_mm / ((ssd_mm + depth) * (ssd_mm + depth))
    };
    depths_mm.iter().map(|&depth| dose(depth)).collect()
}
