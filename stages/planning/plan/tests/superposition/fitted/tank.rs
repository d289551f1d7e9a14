//! A water tank that the dose engine itself scans.

use std::fmt::Write as _;

use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;
use stillpoint_plan::dose::{
    Anatomy, BixelSpec, DoseEngine, DoseParams, EngineName, Machine, MachineFile, Superposition,
};

/// Width of a voxel, mm.
const VOXEL_MM: f64 = 3.0;
/// Half of the tank's width, voxels on each side of the axis.
const HALF: usize = 38;
/// Voxels along the beam.
const DEPTHS: usize = 100;

/// The tank under a square field of the machine's open field.
pub struct Tank {
    engine: DoseEngine,
    bixels: Vec<[f64; 2]>,
    weights: Vec<f64>,
}

/// A scan: places in mm with doses in Gy for a weight of 1.
pub type Scan = Vec<(f64, f64)>;

impl Tank {
    /// A field of multiples of 10 mm, with the surface at this distance from the source.
    pub fn new(machine: &Machine, field_mm: f64, ssd_mm: f64) -> Self {
        let side = -(HALF as f64) * VOXEL_MM;
        let surface = ssd_mm - machine.file().sad_mm;
        let grid = Grid {
            counts: [2 * HALF + 1, DEPTHS, 2 * HALF + 1],
            spacing_mm: [VOXEL_MM; 3],
            origin_mm: [side, surface + 0.5 * VOXEL_MM, side],
        };
        let all = Mask::from_fn(grid.len(), |_| true);
        let target =
            Mask::from_fn(grid.len(), |v| grid.centre_mm(grid.voxel(v)).iter().all(|mm| mm.abs() < 10.0));
        let hu = vec![0; grid.len()];
        let anatomy = Anatomy { grid, hu: &hu, external: &all, target: &target, isocentre_mm: [0.0; 3] };
        let params = DoseParams {
            grid,
            bixels: BixelSpec::of_width(10.0),
            engine: EngineName::Superposition,
            ..DoseParams::over(&grid, VOXEL_MM)
        };
        let engine = DoseEngine::new(&anatomy, machine.clone(), params).unwrap();
        let count = (field_mm / 10.0).round() as i32;
        let places = || (0..count).map(|i| 10.0 * f64::from(i) + 5.0 - 0.5 * field_mm);
        let bixels: Vec<[f64; 2]> = places().flat_map(|x| places().map(move |z| [x, z])).collect();
        let weights = bixels.iter().map(|[x, z]| machine.primary_fluence(x.hypot(*z))).collect();
        Self { engine, bixels, weights }
    }

    fn doses(&self, voxels: &[[usize; 3]]) -> Vec<f64> {
        let grid = self.engine.params().grid;
        let mut rows: Vec<u32> = voxels.iter().map(|voxel| grid.index(*voxel) as u32).collect();
        rows.sort_unstable();
        let dose = self.engine.within(&rows).weighted_bixels(0.0, &self.bixels, &self.weights).unwrap();
        voxels.iter().map(|voxel| f64::from(dose[grid.index(*voxel)])).collect()
    }

    /// Along the axis.
    pub fn depth_dose(&self) -> Scan {
        let voxels: Vec<[usize; 3]> = (0..DEPTHS).map(|y| [HALF, y, HALF]).collect();
        let depth = |y: usize| (y as f64 + 0.5) * VOXEL_MM;
        self.doses(&voxels).into_iter().enumerate().map(|(y, dose)| (depth(y), dose)).collect()
    }

    /// Across it along x or z, with the depth.
    pub fn profile(&self, is_x: bool, depth_mm: f64, reach_mm: f64) -> (f64, Scan) {
        let y = (depth_mm / VOXEL_MM) as usize;
        let reach = (reach_mm / VOXEL_MM) as usize;
        let range = HALF - reach..=HALF + reach;
        let voxels: Vec<[usize; 3]> =
            range.clone().map(|i| if is_x { [i, y, HALF] } else { [HALF, y, i] }).collect();
        let off = |i: usize| (i as f64 - HALF as f64) * VOXEL_MM;
        let scan = range.zip(self.doses(&voxels)).map(|(i, dose)| (off(i), dose)).collect();
        ((y as f64 + 0.5) * VOXEL_MM, scan)
    }
}

/// The shipped machine whose photons are multiplied by `(E / 1 MeV)^power`.
pub fn machine_of(power: f64, change: impl FnOnce(&mut MachineFile)) -> Machine {
    let mut file = Machine::shipped().unwrap().file().clone();
    let section: &mut Superposition = file.superposition.as_mut().unwrap();
    for (photons, energy) in section.photons.iter_mut().zip(&section.energy_mev) {
        *photons *= energy.powf(power);
    }
    let sum: f64 = section.photons.iter().sum();
    section.photons.iter_mut().for_each(|photons| *photons /= sum);
    change(&mut file);
    Machine::new(file).unwrap()
}

/// The header of a table.
pub const HEADER: &str = "kind,field_x_mm,field_y_mm,ssd_mm,depth_mm,off_mm,value\n";

/// The lines of a depth dose.
pub fn depth_dose_lines(field_mm: f64, ssd_mm: f64, scan: &Scan) -> String {
    let mut text = String::new();
    for (depth, dose) in scan {
        writeln!(text, "depth_dose,{field_mm},{field_mm},{ssd_mm},{depth},0,{dose}").unwrap();
    }
    text
}

/// The lines of a profile.
pub fn profile_lines(is_x: bool, field_mm: f64, ssd_mm: f64, (depth, scan): &(f64, Scan)) -> String {
    let mut text = String::new();
    let kind = if is_x { "profile_x" } else { "profile_y" };
    for (off, dose) in scan {
        writeln!(text, "{kind},{field_mm},{field_mm},{ssd_mm},{depth},{off},{dose}").unwrap();
    }
    text
}
