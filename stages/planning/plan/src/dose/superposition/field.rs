//! What a beam does to the voxels that it crosses: depth, TERMA, and where it sees them.

use super::section::Superposition;
use super::terma::Terma;
use crate::dose::beam::inverse_square;
use crate::dose::depth::{LitVoxel, depths_mm};
use crate::dose::engine::DoseEngine;
use crate::dose::frame::BeamFrame;
use stillpoint_patient::Grid;

/// Distance beside the fluence within which there is primary dose, mm on the isocentre plane.
const PRIMARY_MARGIN_MM: f64 = 50.0;

/// A voxel near a beam.
#[derive(Clone, Copy, Debug)]
pub(super) struct FieldVoxel {
    /// Its place in the dose grid.
    pub voxel: u32,
    /// Its centre in the beam's frame, mm.
    pub beam_mm: [f32; 3],
    /// Where the line from the source meets the isocentre plane, mm.
    pub plane_mm: [f32; 2],
    /// Its width as seen on the isocentre plane, mm.
    pub side_mm: f32,
    /// Radiological depth, mm of water.
    pub depth_mm: f32,
    /// TERMA of a fluence of 1, primary and scatter, with the inverse square of the distance from the source.
    pub terma: [f32; 2],
    /// Hardening of the spectrum, from 0 to 1.
    pub hardening: f32,
}

/// The voxels near a beam.
#[derive(Clone, Debug)]
pub(super) struct Field {
    /// Those in tissue and those that get dose, rising.
    pub voxels: Vec<FieldVoxel>,
}

impl Field {
    /// Around a rectangle of the isocentre plane that has fluence, mm.
    pub fn new(
        engine: &DoseEngine,
        frame: &BeamFrame,
        section: &Superposition,
        bounds: [[f64; 2]; 2],
    ) -> Self {
        let grid = &engine.params.grid;
        let mut gets_dose = vec![false; grid.len()];
        engine.voxels.iter().for_each(|voxel| gets_dose[*voxel as usize] = true);
        let lit: Vec<LitVoxel> = (0..grid.len())
            .filter(|voxel| gets_dose[*voxel] || engine.density[*voxel] > 0.0)
            .map(|voxel| LitVoxel {
                row: voxel as u32,
                beam_mm: frame.beam_from_patient(grid.centre_mm(grid.voxel(voxel))),
            })
            .filter(|voxel| is_near(frame.on_isocentre_plane(voxel.beam_mm), bounds, PRIMARY_MARGIN_MM))
            .collect();
        let terma = Terma::new(section);
        let width_mm = libm::cbrt(grid.spacing_mm.iter().product());
        let depths = depths_mm(grid, &engine.density, frame, &lit);
        let of = |(lit, depth_mm): (&LitVoxel, f64)| {
            let inverse_square = inverse_square(frame, lit.beam_mm) as f32;
            FieldVoxel {
                voxel: lit.row,
                beam_mm: lit.beam_mm.map(|mm| mm as f32),
                plane_mm: frame.on_isocentre_plane(lit.beam_mm).map(|mm| mm as f32),
                side_mm: (width_mm * frame.sad_mm() / lit.beam_mm[1]) as f32,
                depth_mm: depth_mm as f32,
                terma: terma.at(depth_mm).map(|part| part * inverse_square),
                hardening: terma.hardening(depth_mm),
            }
        };
        Self { voxels: lit.iter().zip(depths).map(of).collect() }
    }
}

/// The box of the dose grid around the voxels of a field. Lines that leave it meet no TERMA any more, and the fewer voxels
/// lines read from, the more of them stay in the processor's cache.
#[derive(Clone, Debug)]
pub(super) struct FieldBox {
    pub grid: Grid,
    whole: Grid,
    low: [usize; 3],
}

impl FieldBox {
    /// Around the voxels of a field on a dose grid.
    pub fn around(field: &Field, whole: &Grid) -> Self {
        let mut extent = whole.counts.map(|count| [count - 1, 0]);
        for place in field.voxels.iter().map(|voxel| whole.voxel(voxel.voxel as usize)) {
            for ([low, high], place) in extent.iter_mut().zip(place) {
                (*low, *high) = ((*low).min(place), (*high).max(place));
            }
        }
        let low = extent.map(|[low, high]| low.min(high));
        let grid = Grid {
            counts: std::array::from_fn(|axis| extent[axis][1] + 1 - low[axis]),
            spacing_mm: whole.spacing_mm,
            origin_mm: whole.centre_mm(low),
        };
        Self { grid, whole: *whole, low }
    }

    /// Where a voxel of the dose grid is in the box.
    pub fn voxel(&self, voxel: u32) -> [usize; 3] {
        let place = self.whole.voxel(voxel as usize);
        std::array::from_fn(|axis| place[axis] - self.low[axis])
    }

    /// What a volume over the dose grid holds in the box.
    pub fn cut(&self, volume: &[f32]) -> Vec<f32> {
        let [width, rows, slices] = self.grid.counts;
        let mut cut = Vec::with_capacity(self.grid.len());
        for z in 0..slices {
            for y in 0..rows {
                let start = self.whole.index([self.low[0], self.low[1] + y, self.low[2] + z]);
                cut.extend_from_slice(&volume[start..start + width]);
            }
        }
        cut
    }
}

/// Whether a place of the isocentre plane is within a distance of a rectangle.
pub(super) fn is_near(place: [f64; 2], bounds: [[f64; 2]; 2], margin_mm: f64) -> bool {
    (0..2).all(|axis| {
        let [low, high] = bounds[axis];
        (low - margin_mm..=high + margin_mm).contains(&place[axis])
    })
}
