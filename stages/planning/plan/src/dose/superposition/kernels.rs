//! Energy along the axis of a cone.

use super::section::PointKernels;

/// Kernels between the two of the primary: the spectrum of a voxel takes the nearest.
pub(super) const LEVELS: usize = 16;

/// Energy within a distance, in one cone of each ring, per unit of TERMA.
#[derive(Clone, Debug)]
pub(super) struct ConeKernels {
    /// By level, ring and shell: energy within the shell's inner radius, and what the shell adds.
    tables: Vec<[f32; 2]>,
    rings: usize,
    /// Entries of a table: one more than there are shells.
    entries: usize,
    /// Shells per mm of water.
    per_mm: f32,
}

/// The kernel along one axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Along<'a> {
    table: &'a [[f32; 2]],
    per_mm: f32,
}

impl ConeKernels {
    /// Kernels of several depths become levels between the first and the last; that of one depth is one level.
    pub fn new(kernels: &PointKernels) -> Self {
        let levels = if kernels.depths_mm.len() > 1 { LEVELS } else { 1 };
        let rings = kernels.cones.len();
        let shells = kernels.energy[0][0].len();
        let (first, last) = (&kernels.energy[0], &kernels.energy[kernels.energy.len() - 1]);
        let mut tables = Vec::with_capacity(levels * rings * (shells + 1));
        for level in 0..levels {
            let part = level as f64 / (levels - 1).max(1) as f64;
            for ring in 0..rings {
                let mut within = 0.0;
                for shell in 0..shells {
                    let energy = first[ring][shell] * (1.0 - part) + last[ring][shell] * part;
                    let energy = energy / kernels.cones[ring] as f64;
                    tables.push([within as f32, energy as f32]);
                    within += energy;
                }
                tables.push([within as f32, 0.0]);
            }
        }
        Self { tables, rings, entries: shells + 1, per_mm: (1.0 / kernels.shell_mm) as f32 }
    }

    /// The level of a hardening from 0 to 1.
    pub fn level(&self, hardening: f32) -> usize {
        let levels = self.tables.len() / (self.rings * self.entries);
        ((hardening * (levels - 1) as f32 + 0.5) as usize).min(levels - 1)
    }

    pub fn along(&self, level: usize, ring: usize) -> Along<'_> {
        let start = (level * self.rings + ring) * self.entries;
        Along { table: &self.tables[start..start + self.entries], per_mm: self.per_mm }
    }
}

impl Along<'_> {
    /// Energy within a distance, mm of water; `Err` with all of it beyond the last shell.
    #[inline]
    pub fn within(&self, water_mm: f32) -> Result<f32, f32> {
        let place = water_mm * self.per_mm;
        let shell = place as usize;
        let last = self.table.len() - 1;
        if shell < last {
            let [within, energy] = self.table[shell];
            Ok(within + energy * (place - shell as f32))
        } else {
            Err(self.table[last][0])
        }
    }
}
