//! The view from the radiation source at a gantry angle: the isocentre plane, and the target's aperture on it.

use stillpoint_patient::case::Case;
use stillpoint_patient::couch::patient_from_couch;
use stillpoint_plan::dose::Machine;

use crate::lattice::{Boxed, Lattice};
use crate::volume::Volume;

/// Width of the cells by which the target's aperture is drawn on the isocentre plane, mm; cells on each side of its middle.
const CELL_MM: f64 = 9.0;
const CELLS: i32 = 40;
/// Attenuation of the beam in water, 1/mm: that of 6 MV photons, about.
const ATTENUATION: f64 = 0.0045;

/// The direction of the source, and the axes of the beam's eye, in the patient's frame.
pub struct BeamView {
    source_mm: [f64; 3],
    /// To the source.
    pub toward: [f64; 3],
    /// Across the couch, on the isocentre plane.
    pub across: [f64; 3],
    /// Along the couch.
    pub along: [f64; 3],
}

impl BeamView {
    /// From angle `a` of so many equal steps around the isocentre of a case.
    pub fn new(case: &Case, machine: &Machine, a: usize, angles: usize) -> Self {
        let (sin, cos) = libm::sincos(core::f64::consts::TAU * a as f64 / angles as f64);
        let m = patient_from_couch(case.position());
        let turned = |couch: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|row| (0..3).map(|column| m[(row, column)] * couch[column]).sum())
        };
        let toward = turned([sin, 0.0, cos]);
        let sad_mm = machine.file().sad_mm;
        let source_mm = std::array::from_fn(|axis| case.isocentre_mm()[axis] + sad_mm * toward[axis]);
        Self { source_mm, toward, across: turned([cos, 0.0, -sin]), along: turned([0.0, 1.0, 0.0]) }
    }
}

/// The target on the isocentre plane, with a margin of a cell.
pub struct Aperture {
    open: Vec<bool>,
    /// Spread of the target across the couch, mm.
    pub width_mm: f64,
}

const ROW: i32 = 2 * CELLS + 1;

impl Aperture {
    /// Of the points of the target.
    pub fn of(view: &BeamView, machine: &Machine, target_mm: &[[f64; 3]]) -> Self {
        let mut open = vec![false; (ROW * ROW) as usize];
        let places: Vec<[f64; 2]> = target_mm.iter().map(|p| view.on_plane(machine, *p)).collect();
        for place in &places {
            let [x, z] = place.map(|mm| (mm / CELL_MM).round() as i32);
            for (dx, dz) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dz| (dx, dz))) {
                if let Some(cell) = cell(x + dx, z + dz) {
                    open[cell] = true;
                }
            }
        }
        let count = places.len().max(1) as f64;
        let middle_mm: [f64; 2] =
            std::array::from_fn(|axis| places.iter().map(|p| p[axis]).sum::<f64>() / count);
        let square = |p: &[f64; 2]| (p[0] - middle_mm[0]) * (p[0] - middle_mm[0]);
        let width_mm = libm::sqrt(places.iter().map(square).sum::<f64>() / count);
        Self { open, width_mm }
    }

    /// What an open field through the aperture brings to a point: the inverse square and the attenuation of the primary.
    pub fn fluence(&self, volume: &Volume, view: &BeamView, machine: &Machine, at_mm: [f64; 3]) -> f64 {
        let [x, z] = view.on_plane(machine, at_mm).map(|mm| (mm / CELL_MM).round() as i32);
        if !cell(x, z).is_some_and(|cell| self.open[cell]) {
            return 0.0;
        }
        let (toward, distance) = view.toward_source(at_mm);
        let nearer = machine.file().sad_mm / distance;
        nearer * nearer * libm::exp(-ATTENUATION * volume.water_mm(at_mm, toward))
    }

    /// Open cells.
    pub fn area(&self) -> f64 {
        self.open.iter().filter(|open| **open).count() as f64
    }
}

fn cell(x: i32, z: i32) -> Option<usize> {
    (x.abs() <= CELLS && z.abs() <= CELLS).then(|| ((z + CELLS) * ROW + x + CELLS) as usize)
}

impl BeamView {
    /// A point of the patient on the isocentre plane: across the couch and along it, mm.
    pub fn on_plane(&self, machine: &Machine, at_mm: [f64; 3]) -> [f64; 2] {
        let from: [f64; 3] = std::array::from_fn(|axis| at_mm[axis] - self.source_mm[axis]);
        let depth = -dot(from, self.toward);
        let scale = machine.file().sad_mm / depth.max(1.0);
        [scale * dot(from, self.across), scale * dot(from, self.along)]
    }

    /// How the bixels fit the silhouette of these voxels of the image.
    pub fn lattice(&self, case: &Case, machine: &Machine, voxels_mm: &[[f64; 3]], bixel_mm: f64) -> Lattice {
        let half = case.grid().spacing_mm.map(|spacing| 0.5 * spacing);
        // A voxel is as wide as its box is seen, on the isocentre plane.
        let reach = |axis: [f64; 3]| (0..3).map(|i| axis[i].abs() * half[i]).sum::<f64>();
        let half_mm = [reach(self.across), reach(self.along)];
        let boxes: Vec<Boxed> = voxels_mm.iter().map(|at| (self.on_plane(machine, *at), half_mm)).collect();
        Lattice::of(&boxes, bixel_mm)
    }

    /// Of the voxels of an organ: how much bixels of the target hit them, and how much bixels that the target fills in part.
    pub fn mixed(&self, machine: &Machine, voxels_mm: &[[f64; 3]], bixels: &Lattice) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for at in voxels_mm {
            let filled = bixels.at(self.on_plane(machine, *at));
            sums[0] += filled;
            sums[1] += 4.0 * filled * (1.0 - filled);
        }
        sums.map(|sum| sum / voxels_mm.len().max(1) as f64)
    }

    /// The direction from a point to the source, and the distance, mm.
    pub fn toward_source(&self, at_mm: [f64; 3]) -> ([f64; 3], f64) {
        let direction: [f64; 3] = std::array::from_fn(|axis| self.source_mm[axis] - at_mm[axis]);
        let distance = libm::sqrt(dot(direction, direction)).max(1.0);
        (direction.map(|w| w / distance), distance)
    }
}

/// The product of two directions.
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
