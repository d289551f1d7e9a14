//! What the cones bring to a voxel: the sum along all axes.
//!
//! `D(v) = sum over axes and voxels q behind v of T(q) (C(x2) - C(x1))`, where `x1` to `x2` (mm of water, from `v`) is what
//! the line crosses of `q` and `C(x)` is the energy of a point kernel within `x` in the cone. It is the reciprocal of
//! spreading energy from each `q`, exact for collapsed cones.

use super::directions;
use super::kernels::{Along, ConeKernels};
use super::section::PointKernels;
use super::stencil::{Stencil, Step};
use crate::dose::frame::BeamFrame;
use stillpoint_patient::Grid;

/// What a line reads of a voxel: density and TERMA.
pub(super) type Cell = [f32; 2];

/// The lines of all axes, and the kernels along them.
#[derive(Clone, Debug)]
pub(super) struct Gather {
    counts: [usize; 3],
    kernels: ConeKernels,
    /// By axis: its ring, and the line against the direction in which energy goes.
    lines: Vec<(usize, Stencil)>,
}

impl Gather {
    /// Over a grid, as far as `reach_mm` of tissue.
    pub fn new(grid: &Grid, frame: &BeamFrame, kernels: &PointKernels, reach_mm: f64) -> Self {
        let origin = frame.patient_from_beam([0.0; 3]);
        let line = |axis: directions::Axis| {
            let from = frame.patient_from_beam(axis.towards.map(|part| -part));
            let backwards = std::array::from_fn(|i| from[i] - origin[i]);
            (axis.ring, Stencil::new(grid, backwards, reach_mm))
        };
        Self {
            counts: grid.counts,
            kernels: ConeKernels::new(kernels),
            lines: directions::axes(kernels).into_iter().map(line).collect(),
        }
    }

    /// The level of the kernels of a hardening from 0 to 1.
    pub fn level(&self, hardening: f32) -> usize {
        self.kernels.level(hardening)
    }

    /// What all cones bring to a voxel.
    pub fn at(&self, cells: &[Cell], voxel: [usize; 3], level: usize) -> f32 {
        let mut sum = 0.0;
        self.each_line(voxel, level, |start, steps, kernel| {
            sum += along(cells, start, steps, kernel);
        });
        sum
    }

    /// Each line to a voxel: the voxel's place, the steps, and the kernel.
    #[inline]
    pub fn each_line(&self, voxel: [usize; 3], level: usize, mut visit: impl FnMut(i32, &[Step], Along<'_>)) {
        let [x, y, z] = voxel;
        let start = (x + self.counts[0] * (y + self.counts[1] * z)) as i32;
        for (ring, stencil) in &self.lines {
            visit(start, stencil.of(self.counts, voxel), self.kernels.along(level, *ring));
        }
    }
}

/// What one cone brings to a voxel.
#[inline]
fn along(cells: &[Cell], start: i32, steps: &[Step], kernel: Along<'_>) -> f32 {
    let (mut water_mm, mut before, mut sum) = (0.0, 0.0, 0.0);
    for step in steps {
        let [density, terma] = cells[(start + step.offset) as usize];
        water_mm += density * step.length_mm;
        match kernel.within(water_mm) {
            Ok(within) => {
                sum += terma * (within - before);
                before = within;
            }
            Err(all) => {
                sum += terma * (all - before);
                break;
            }
        }
    }
    sum
}

/// The share of each voxel along one line: `visit(place, share of its TERMA)`.
#[inline]
pub(super) fn each_share(
    densities: impl Fn(usize) -> f32,
    start: i32,
    steps: &[Step],
    kernel: Along<'_>,
    mut visit: impl FnMut(usize, f32),
) {
    let (mut water_mm, mut before) = (0.0, 0.0);
    for step in steps {
        let place = (start + step.offset) as usize;
        water_mm += densities(place) * step.length_mm;
        match kernel.within(water_mm) {
            Ok(within) => {
                visit(place, within - before);
                before = within;
            }
            Err(all) => {
                visit(place, all - before);
                break;
            }
        }
    }
}
