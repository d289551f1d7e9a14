//! The dose of each bixel by superposition.
//!
//! The primary is the gather of a weighted beam, with what each voxel gives filed under the bixels that light it. The
//! scatter of a bixel is that of a pencil in water at the radiological depth, times the ratio of the gathered scatter of the
//! open field to the sum of all its pencils: so the columns together have the scatter of the superposition.

use super::field::{Field, FieldBox, FieldVoxel};
use super::fluence::{BixelShape, FluenceMap, bounds};
use super::gather::{Gather, Start, each_share};
use super::nodes::{NODE_MM, Profiles};
use super::pencil::ScatterPencil;
use super::primary::REACH_MM;
use super::scatter;
use super::section::Superposition;
use crate::dose::angles::BeamAngles;
use crate::dose::beam::{Aim, BeamRows, OBLIQUE};
use crate::dose::engine::DoseEngine;
use crate::dose::error::DoseError;
use crate::sparse::{RowsBuilder, RowsError};

/// Widths of a voxel as the source sees it, for which bixels have profiles of their own.
const WIDTHS: usize = 8;

/// Dose of the bixels of one beam.
pub(in crate::dose) fn influence(
    engine: &DoseEngine,
    angles: BeamAngles,
    section: &Superposition,
) -> Result<BeamRows, DoseError> {
    let aim = Aim::new(engine, angles)?;
    engine.check_entry(angles, aim.bixels_mm.iter().copied())?;
    let bixels: Vec<([f64; 2], f32)> = aim.bixels_with_fluence(engine);
    let shape = BixelShape::new(engine.params.bixels.width_mm, engine.machine.file().penumbra_fwhm_at_iso_mm);
    let map = FluenceMap::new(&bixels, &shape);
    let bounds = bounds(bixels.iter().map(|(bixel, _)| *bixel), &shape);
    let field = Field::new(engine, &aim.frame, section, bounds);
    let mut open = vec![0.0; engine.rows()];
    scatter::add(engine, &aim.frame, section, &field, (&map, bounds), &mut open);

    let cut = FieldBox::around(&field, &engine.params.grid);
    let filer = Filer::new(engine, &bixels, &shape, (&field, &cut));
    let pencil = ScatterPencil::new(section, shape.width_mm, OBLIQUE * engine.params.cutoff_mm);
    let gather = Gather::new(&cut.grid, &aim.frame, &section.primary, REACH_MM, bounds);
    let mut nodes = Nodes { shares: vec![0.0; filer.counts[0] * filer.counts[1]], ..Nodes::default() };
    let mut entries = Entries { scatter: vec![0.0; bixels.len()], rows: RowsBuilder::new(bixels.len()) };
    let mut primary = vec![0.0; filer.across[0] * filer.across[1]];
    for voxel in field.voxels.iter().filter(|v| engine.voxels.binary_search(&v.voxel).is_ok()) {
        filer.gather(&gather, (voxel, cut.voxel(voxel.voxel)), &mut nodes);
        filer.fold(&mut nodes, voxel.side_mm, &mut primary);
        let row = engine.row_of(voxel.voxel) as usize;
        let of_row =
            entries.add(engine, section, (voxel, row, open[row]), (&bixels, &filer, &primary, &pencil));
        of_row.map_err(|fault| DoseError::Rows { angles, fault })?;
    }
    let dose = entries.rows.finish(engine.rows()).map_err(|fault| DoseError::Rows { angles, fault })?;
    Ok(BeamRows { angles, bixels_mm: aim.bixels_mm, dose })
}

/// Where a voxel is seen between the nodes, and its TERMA.
#[derive(Clone, Copy, Default)]
#[repr(align(16))]
struct Seen {
    terma: f32,
    node: u32,
    right: f32,
    back: f32,
}

/// What files the shares of voxels under bixels.
struct Filer {
    /// Of each voxel of the field's box. The density is by itself: a line reads it of every voxel, the rest where there is
    /// TERMA.
    density: Vec<f32>,
    seen: Vec<Seen>,
    /// Nodes along x and z.
    counts: [usize; 2],
    /// Distinct places of bixels along x and z.
    across: [usize; 2],
    /// Of each bixel, its place among all pairs of these: by x and then z.
    place: Vec<usize>,
    /// By width of a voxel: the bixels along x and along z.
    profiles: Vec<[Profiles; 2]>,
    widths_mm: [f32; 2],
}

/// Shares by node, and the nodes that have some.
#[derive(Default)]
struct Nodes {
    shares: Vec<f32>,
    /// First line of nodes along z that has some, and the line behind the last.
    used: [usize; 2],
    /// Sums of one line by the bixels along z.
    folded: Vec<f32>,
}

impl Filer {
    fn new(
        engine: &DoseEngine,
        bixels: &[([f64; 2], f32)],
        shape: &BixelShape,
        (field, cut): (&Field, &FieldBox),
    ) -> Self {
        let sides = || field.voxels.iter().map(|voxel| voxel.side_mm);
        let widths_mm = [sides().fold(f32::INFINITY, f32::min), sides().fold(0.0, f32::max)];
        let centres = [0, 1].map(|axis| {
            let mut centres: Vec<f64> = bixels.iter().map(|(bixel, _)| bixel[axis]).collect();
            centres.sort_by(f64::total_cmp);
            centres.dedup();
            centres
        });
        let reach_mm = Profiles::reach_mm(shape, f64::from(widths_mm[1]));
        let first_mm = [0, 1].map(|axis| NODE_MM * ((centres[axis][0] - reach_mm) / NODE_MM).floor());
        let counts = [0, 1].map(|axis| {
            let last_mm = centres[axis][centres[axis].len() - 1] + reach_mm;
            ((last_mm - first_mm[axis]) / NODE_MM).ceil() as usize + 2
        });
        let across = [0, 1].map(|axis| centres[axis].len());
        let place_of = |bixel: &[f64; 2]| {
            let [x, z] = [0, 1].map(|axis| centres[axis].partition_point(|centre| *centre < bixel[axis]));
            x * across[1] + z
        };
        let place: Vec<usize> = bixels.iter().map(|(bixel, _)| place_of(bixel)).collect();
        let profiles = (0..WIDTHS).map(|width| {
            let part = (width as f32 + 0.5) / WIDTHS as f32;
            let side_mm = f64::from(widths_mm[0] + part * (widths_mm[1] - widths_mm[0]));
            [0, 1].map(|axis| Profiles::new(&centres[axis], shape, side_mm, first_mm[axis]))
        });
        let mut filer = Self {
            density: cut.cut(&engine.density),
            seen: vec![Seen::default(); cut.grid.len()],
            counts,
            across,
            place,
            profiles: profiles.collect(),
            widths_mm,
        };
        filer.see(field, cut, first_mm);
        filer
    }

    /// Files each voxel between its nodes. Voxels beyond all nodes have no fluence of any bixel.
    fn see(&mut self, field: &Field, cut: &FieldBox, first_mm: [f64; 2]) {
        for voxel in &field.voxels {
            let at = [0, 1].map(|axis| (f64::from(voxel.plane_mm[axis]) - first_mm[axis]) / NODE_MM);
            let is_inside = (0..2).all(|axis| at[axis] >= 0.0 && at[axis] < (self.counts[axis] - 1) as f64);
            if is_inside {
                let [x, z] = at.map(|place| place as usize);
                let seen = &mut self.seen[cut.grid.index(cut.voxel(voxel.voxel))];
                seen.terma = voxel.terma[0];
                seen.node = (x * self.counts[1] + z) as u32;
                [seen.right, seen.back] = at.map(|place| (place - place.floor()) as f32);
            }
        }
    }

    /// Files what all lines bring to a voxel, which is here in the field's box.
    fn gather(&self, gather: &Gather, (voxel, place): (&FieldVoxel, [usize; 3]), nodes: &mut Nodes) {
        let start = Start { voxel: place, beam_mm: voxel.beam_mm, level: gather.level(voxel.hardening) };
        let stride = self.counts[1];
        let (mut low, mut high) = (u32::MAX, 0);
        let shares = nodes.shares.as_mut_slice();
        gather.each_line(&start, |start, steps, kernel| {
            each_share(
                |place| self.density[place],
                start,
                steps,
                kernel,
                |place, share| {
                    let seen = &self.seen[place];
                    if seen.terma > 0.0 && share > 0.0 {
                        let energy = share * seen.terma;
                        let (left, right) = (energy * (1.0 - seen.right), energy * seen.right);
                        let node = seen.node as usize;
                        shares[node] += left * (1.0 - seen.back);
                        shares[node + 1] += left * seen.back;
                        shares[node + stride] += right * (1.0 - seen.back);
                        shares[node + stride + 1] += right * seen.back;
                        low = low.min(seen.node);
                        high = high.max(seen.node);
                    }
                },
            );
        });
        // Whole lines of nodes along z: those between the first and the last.
        nodes.used = match low <= high {
            true => [low as usize / stride, high as usize / stride + 2],
            false => [0, 0],
        };
    }

    /// The sums over nodes of each bixel, by x and then z; the nodes are empty afterwards.
    fn fold(&self, nodes: &mut Nodes, side_mm: f32, sums: &mut [f32]) {
        sums.fill(0.0);
        let part = (side_mm - self.widths_mm[0]) / (self.widths_mm[1] - self.widths_mm[0]).max(1e-6);
        let [along_x, along_z] = &self.profiles[((part * WIDTHS as f32) as usize).min(WIDTHS - 1)];
        let [low, high] = nodes.used;
        let stride = self.counts[1];
        nodes.folded.resize(self.across[1], 0.0);
        for x in low..high {
            let line = &mut nodes.shares[x * stride..(x + 1) * stride];
            let first = line.iter().position(|share| *share != 0.0);
            let (Some(first), Some(last)) = (first, line.iter().rposition(|share| *share != 0.0)) else {
                continue;
            };
            for (sum, (start, coefficients)) in nodes.folded.iter_mut().zip(&along_z.of) {
                let from = first.max(*start);
                let to = (last + 1).min(start + coefficients.len());
                *sum = if from < to {
                    let shares = line[from..to].iter().zip(&coefficients[from - start..to - start]);
                    shares.map(|(share, coefficient)| share * coefficient).sum()
                } else {
                    0.0
                };
            }
            line[first..=last].fill(0.0);
            for (bixel, (start, coefficients)) in along_x.of.iter().enumerate() {
                let Some(coefficient) = x.checked_sub(*start).and_then(|node| coefficients.get(node)) else {
                    continue;
                };
                let of_x = &mut sums[bixel * self.across[1]..(bixel + 1) * self.across[1]];
                of_x.iter_mut().zip(&nodes.folded).for_each(|(sum, folded)| *sum += coefficient * folded);
            }
        }
    }
}

/// Entries of the matrix, row by row.
struct Entries {
    scatter: Vec<f32>,
    rows: RowsBuilder,
}

/// Bixels with their fluence, where their primary dose is filed, that dose, and the scatter of a bixel.
type Filed<'a> = (&'a [([f64; 2], f32)], &'a Filer, &'a [f32], &'a ScatterPencil);

impl Entries {
    /// Adds a voxel: its row and the scatter of the open field there.
    fn add(
        &mut self,
        engine: &DoseEngine,
        section: &Superposition,
        (voxel, row, open): (&FieldVoxel, usize, f32),
        (bixels, filer, primary, pencil): Filed<'_>,
    ) -> Result<(), RowsError> {
        let cutoff2 = (engine.params.cutoff_mm * engine.params.cutoff_mm) as f32;
        // Distances in the plane of the voxel, for a kernel in millimetres of tissue.
        let width_mm = libm::cbrt(engine.params.grid.spacing_mm.iter().product()) as f32;
        let magnification = width_mm / voxel.side_mm;
        let mut sum = 0.0;
        for (scatter, (bixel, fluence)) in self.scatter.iter_mut().zip(bixels) {
            let [x, z] = [0, 1].map(|axis| bixel[axis] as f32 - voxel.plane_mm[axis]);
            let distance2 = x * x + z * z;
            *scatter = match distance2 <= cutoff2 {
                true => fluence * pencil.at(voxel.depth_mm, distance2.sqrt() * magnification),
                false => -1.0,
            };
            sum += scatter.max(0.0);
        }
        let ratio = if sum > 0.0 { open / sum } else { 0.0 };
        let scale = section.gray_per_mev_g as f32;
        self.rows.begin(row)?;
        for (column, (scatter, (_, fluence))) in self.scatter.iter().zip(bixels).enumerate() {
            if *scatter >= 0.0 {
                let dose = scale * (primary[filer.place[column]] * fluence + scatter * ratio);
                // The fit of a bixel may be negative at its foot; no dose is.
                if dose > 0.0 {
                    self.rows.push(column as u16, dose);
                }
            }
        }
        Ok(())
    }
}
