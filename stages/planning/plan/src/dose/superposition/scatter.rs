//! Dose of scattered photons: smooth, so it is gathered on a coarser grid.

use super::field::{Field, is_near};
use super::fluence::FluenceMap;
use super::gather::{Cell, Gather, Start};
use super::section::Superposition;
use crate::dose::engine::DoseEngine;
use crate::dose::frame::BeamFrame;
use stillpoint_patient::Grid;

/// Distance beside the fluence within which there is scatter, mm on the isocentre plane.
const MARGIN_MM: f64 = 100.0;
/// Longest way of a scattered photon, mm.
const REACH_MM: f64 = 400.0;
/// Spacing of the coarse grid, about, mm.
const COARSE_MM: f64 = 5.0;

/// Adds the dose of a fluence to the rows of the engine, MeV/g.
pub(super) fn add(
    engine: &DoseEngine,
    frame: &BeamFrame,
    section: &Superposition,
    field: &Field,
    (map, bounds): (&FluenceMap, [[f64; 2]; 2]),
    dose: &mut [f32],
) {
    let fine = &engine.params.grid;
    let coarse = Coarse::over(fine);
    let cells = coarse.cells(engine, field, map);
    let gather = Gather::new(&coarse.grid, frame, &section.scatter, REACH_MM, bounds);
    let rows: Vec<u32> = engine
        .voxels
        .iter()
        .copied()
        .filter(|voxel| {
            let beam_mm = frame.beam_from_patient(fine.centre_mm(fine.voxel(*voxel as usize)));
            is_near(frame.on_isocentre_plane(beam_mm), bounds, MARGIN_MM)
        })
        .collect();
    let mut is_needed = vec![false; coarse.grid.len()];
    for voxel in &rows {
        coarse.around(fine.voxel(*voxel as usize), |place, _| is_needed[place] = true);
    }
    let of = |place: usize| {
        if !is_needed[place] {
            return 0.0;
        }
        let voxel = coarse.grid.voxel(place);
        let beam_mm = frame.beam_from_patient(coarse.grid.centre_mm(voxel)).map(|mm| mm as f32);
        gather.at(&cells, &Start { voxel, beam_mm, level: 0 })
    };
    let gathered: Vec<f32> = (0..coarse.grid.len()).map(of).collect();
    for voxel in rows {
        let mut sum = 0.0;
        coarse.around(fine.voxel(voxel as usize), |place, weight| sum += weight * gathered[place]);
        dose[engine.row_of(voxel) as usize] += sum;
    }
}

/// The coarse grid over a fine one.
struct Coarse {
    grid: Grid,
    fine: Grid,
    /// Fine voxels in a coarse one along each axis.
    every: [usize; 3],
}

impl Coarse {
    fn over(fine: &Grid) -> Self {
        let every = fine.spacing_mm.map(|spacing| (COARSE_MM / spacing).round().max(1.0) as usize);
        let grid = Grid {
            counts: std::array::from_fn(|axis| fine.counts[axis].div_ceil(every[axis])),
            spacing_mm: std::array::from_fn(|axis| fine.spacing_mm[axis] * every[axis] as f64),
            origin_mm: std::array::from_fn(|axis| {
                fine.origin_mm[axis] + 0.5 * (every[axis] - 1) as f64 * fine.spacing_mm[axis]
            }),
        };
        Self { grid, fine: *fine, every }
    }

    /// Mean density, and the TERMA of the mass in it.
    fn cells(&self, engine: &DoseEngine, field: &Field, map: &FluenceMap) -> Vec<Cell> {
        let mut cells = vec![[0.0, 0.0]; self.grid.len()];
        let place = |voxel: usize| {
            let [x, y, z] = self.fine.voxel(voxel);
            self.grid.index([x / self.every[0], y / self.every[1], z / self.every[2]])
        };
        for (voxel, density) in engine.density.iter().enumerate().filter(|(_, density)| **density > 0.0) {
            cells[place(voxel)][0] += density;
        }
        for voxel in &field.voxels {
            let density = engine.density[voxel.voxel as usize];
            if density > 0.0 {
                let fluence = map.mean(voxel.plane_mm.map(f64::from), f64::from(voxel.side_mm));
                cells[place(voxel.voxel as usize)][1] += density * voxel.terma[1] * fluence as f32;
            }
        }
        let parts = self.every.iter().product::<usize>() as f32;
        for [density, terma] in cells.iter_mut().filter(|[density, _]| *density > 0.0) {
            *terma /= *density;
            *density /= parts;
        }
        cells
    }

    /// The coarse voxels around a fine one, with their weights: linear between their centres.
    fn around(&self, voxel: [usize; 3], mut visit: impl FnMut(usize, f32)) {
        let axis = |axis: usize| {
            let every = self.every[axis] as f32;
            let last = (self.grid.counts[axis] - 1) as f32;
            let place = ((voxel[axis] as f32 - 0.5 * (every - 1.0)) / every).clamp(0.0, last);
            let low = place as usize;
            (low, (low + 1).min(self.grid.counts[axis] - 1), place - low as f32)
        };
        let [x, y, z] = [axis(0), axis(1), axis(2)];
        for (z, back) in [(z.0, 1.0 - z.2), (z.1, z.2)] {
            for (y, down) in [(y.0, 1.0 - y.2), (y.1, y.2)] {
                for (x, right) in [(x.0, 1.0 - x.2), (x.1, x.2)] {
                    let weight = right * down * back;
                    if weight > 0.0 {
                        visit(self.grid.index([x, y, z]), weight);
                    }
                }
            }
        }
    }
}
