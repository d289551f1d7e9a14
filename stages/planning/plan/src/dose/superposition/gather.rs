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
    lines: Vec<Line>,
    length_mm: f32,
    /// Where the isocentre plane has fluence (low and high of x and z), and its distance from the source, mm.
    window: [[f32; 2]; 2],
    sad_mm: f32,
}

/// The line of one axis.
#[derive(Clone, Debug)]
struct Line {
    ring: usize,
    /// Where energy goes, in the beam's frame.
    towards: [f32; 3],
    /// Against that.
    stencil: Stencil,
}

/// Where a line begins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start {
    pub voxel: [usize; 3],
    /// Its centre in the beam's frame, mm.
    pub beam_mm: [f32; 3],
    /// Level of the kernels.
    pub level: usize,
}

impl Gather {
    /// Over a grid, as far as `length_mm`; beyond these bounds of the isocentre plane (mm) there is no TERMA.
    pub fn new(
        grid: &Grid,
        frame: &BeamFrame,
        kernels: &PointKernels,
        length_mm: f64,
        bounds: [[f64; 2]; 2],
    ) -> Self {
        let origin = frame.patient_from_beam([0.0; 3]);
        let line = |axis: directions::Axis| {
            let from = frame.patient_from_beam(axis.towards.map(|part| -part));
            let backwards = std::array::from_fn(|i| from[i] - origin[i]);
            Line {
                ring: axis.ring,
                towards: axis.towards.map(|part| part as f32),
                stencil: Stencil::new(grid, backwards, length_mm),
            }
        };
        // A voxel whose centre is outside of the bounds may have TERMA.
        let margin_mm = 2.0 * grid.spacing_mm.iter().copied().fold(0.0, f64::max);
        Self {
            counts: grid.counts,
            kernels: ConeKernels::new(kernels),
            lines: directions::axes(kernels).into_iter().map(line).collect(),
            length_mm: length_mm as f32,
            window: bounds.map(|[low, high]| [(low - margin_mm) as f32, (high + margin_mm) as f32]),
            sad_mm: frame.sad_mm() as f32,
        }
    }

    /// The level of the kernels of a hardening from 0 to 1.
    pub fn level(&self, hardening: f32) -> usize {
        self.kernels.level(hardening)
    }

    /// What all cones bring to a voxel.
    pub fn at(&self, cells: &[Cell], start: &Start) -> f32 {
        let mut sum = 0.0;
        self.each_line(start, |place, steps, kernel| sum += along(cells, place, steps, kernel));
        sum
    }

    /// Each line that may bring something to a voxel: the voxel's place, the steps, and the kernel.
    #[inline]
    pub fn each_line(&self, start: &Start, mut visit: impl FnMut(i32, &[Step], Along<'_>)) {
        let [x, y, z] = start.voxel;
        let place = (x + self.counts[0] * (y + self.counts[1] * z)) as i32;
        for line in self.lines.iter().filter(|line| self.is_lit(start.beam_mm, line.towards)) {
            let steps = line.stencil.of(self.counts, start.voxel);
            visit(place, steps, self.kernels.along(start.level, line.ring));
        }
    }

    /// Whether a line passes where there is TERMA: each edge of the window, seen from the source, cuts the line once.
    #[inline]
    fn is_lit(&self, beam_mm: [f32; 3], towards: [f32; 3]) -> bool {
        let (mut from, mut to) = (0.0_f32, self.length_mm);
        for (axis, [low, high]) in [(0, self.window[0]), (2, self.window[1])] {
            for (edge, sign) in [(high, 1.0), (low, -1.0)] {
                // Outside of the edge by `outside`, and `nearer` for each mm of the line.
                let outside = sign * (self.sad_mm * beam_mm[axis] - edge * beam_mm[1]);
                let nearer = sign * (self.sad_mm * towards[axis] - edge * towards[1]);
                if nearer > 0.0 {
                    from = from.max(outside / nearer);
                } else if nearer < 0.0 {
                    to = to.min(outside / nearer);
                } else if outside > 0.0 {
                    return false;
                }
            }
        }
        from <= to
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
