//! Marching tetrahedra (Doi and Koide 1991): the surface on which a volume of values, linear along the edges of its
//! cells' tetrahedra, has a given value. It needs no table of cases and has no ambiguous ones.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::Mesh;
use crate::Grid;

/// The six tetrahedra of a cell about its diagonal, by the numbers of its corners: bit 0 is x, bit 1 y, bit 2 z.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// The surface where `values` (in the order of the grid) cross `level`. Outside is where values are lower. Where the
/// inside reaches the edge of the grid the mesh is open.
pub fn march(grid: &Grid, values: &[f32], level: f32) -> Mesh {
    let mut made = Made { grid, values, level, mesh: Mesh::default(), vertices: BTreeMap::new() };
    let [nx, ny, nz] = grid.counts;
    for z in 0..nz.saturating_sub(1) {
        for y in 0..ny.saturating_sub(1) {
            for x in 0..nx.saturating_sub(1) {
                made.cell([x, y, z]);
            }
        }
        // Edges below this layer are not met again.
        let above = grid.index([0, 0, z + 1]);
        made.vertices = made.vertices.split_off(&(above, 0));
    }
    made.mesh
}

struct Made<'a> {
    grid: &'a Grid,
    values: &'a [f32],
    level: f32,
    mesh: Mesh,
    /// The vertex of an edge between two voxels, the lower number first.
    vertices: BTreeMap<(usize, usize), u32>,
}

impl Made<'_> {
    fn value(&self, voxel: usize) -> f32 {
        self.values.get(voxel).copied().unwrap_or(f32::NEG_INFINITY)
    }

    fn cell(&mut self, [x, y, z]: [usize; 3]) {
        let corners: [usize; 8] =
            std::array::from_fn(|c| self.grid.index([x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)]));
        let inside = corners.map(|c| self.value(c) > self.level);
        if inside.iter().all(|i| *i) || !inside.iter().any(|i| *i) {
            return;
        }
        for tetrahedron in TETRAHEDRA {
            let all = tetrahedron.map(|c| corners[c]);
            let (within, without): (Vec<usize>, Vec<usize>) =
                all.into_iter().partition(|voxel| self.value(*voxel) > self.level);
            match (&within[..], &without[..]) {
                ([a], [p, q, r]) | ([p, q, r], [a]) => {
                    let [p, q, r] = [*p, *q, *r].map(|other| self.vertex(*a, other));
                    self.triangle([p, q, r], &within, &without);
                }
                ([a, b], [p, q]) => {
                    let [ap, aq, bq, bp] =
                        [(*a, *p), (*a, *q), (*b, *q), (*b, *p)].map(|(i, o)| self.vertex(i, o));
                    self.triangle([ap, aq, bq], &within, &without);
                    self.triangle([ap, bq, bp], &within, &without);
                }
                _ => {}
            }
        }
    }

    /// The vertex where the edge between two voxels crosses the level.
    fn vertex(&mut self, one: usize, other: usize) -> u32 {
        let (low, high) = (one.min(other), one.max(other));
        if let Some(vertex) = self.vertices.get(&(low, high)) {
            return *vertex;
        }
        let (a, b) = (f64::from(self.value(low)), f64::from(self.value(high)));
        let part = ((f64::from(self.level) - a) / (b - a)).clamp(0.0, 1.0);
        let [from, to] = [low, high].map(|voxel| Vector3::from(self.grid.centre_mm(self.grid.voxel(voxel))));
        let number = self.mesh.vertices_mm.len() as u32;
        self.mesh.vertices_mm.push((from + (to - from) * part).into());
        self.vertices.insert((low, high), number);
        number
    }

    /// Adds a triangle so that it faces from the voxels within to those without.
    fn triangle(&mut self, [a, b, c]: [u32; 3], within: &[usize], without: &[usize]) {
        let middle = |voxels: &[usize]| {
            let centres = voxels.iter().map(|v| Vector3::from(self.grid.centre_mm(self.grid.voxel(*v))));
            centres.sum::<Vector3<f64>>() / voxels.len() as f64
        };
        let out = middle(without) - middle(within);
        let [p, q, r] = [a, b, c].map(|v| Vector3::from(self.mesh.vertices_mm[v as usize]));
        let faces_out = (q - p).cross(&(r - p)).dot(&out) >= 0.0;
        self.mesh.triangles.push(if faces_out { [a, b, c] } else { [a, c, b] });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    fn ball(radius_mm: f64, spacing_mm: f64) -> (Grid, Vec<f32>) {
        let half = (radius_mm / spacing_mm) as usize + 2;
        let counts = [2 * half + 1, 2 * half + 2, 2 * half + 3];
        let grid = Grid {
            counts,
            spacing_mm: [spacing_mm; 3],
            origin_mm: [
                -(half as f64) * spacing_mm + 0.3,
                -(half as f64) * spacing_mm,
                -(half as f64) * spacing_mm,
            ],
        };
        let depth = |i| (radius_mm - Vector3::from(grid.centre_mm(grid.voxel(i))).norm()) as f32;
        (grid, (0..grid.len()).map(depth).collect())
    }

    #[test]
    fn balls_have_their_area_and_volume_and_every_edge_has_two_sides() {
        for (radius, spacing) in [(40.0, 2.0), (80.0, 3.0), (25.0, 1.0)] {
            let (grid, values) = ball(radius, spacing);
            let mesh = march(&grid, &values, 0.0);
            let volume = 4e-3 / 3.0 * PI * radius.powi(3);
            let area = 4e-2 * PI * radius * radius;
            assert!((mesh.volume_cm3() / volume - 1.0).abs() < 5e-3, "{} of {volume}", mesh.volume_cm3());
            assert!((mesh.area_cm2() / area - 1.0).abs() < 1e-2, "{} of {area}", mesh.area_cm2());
            let off = |v: &[f64; 3]| (Vector3::from(*v).norm() - radius).abs();
            let worst = mesh.vertices_mm.iter().map(off).fold(0.0, f64::max);
            assert!(worst < 0.5 * spacing * spacing / radius, "{worst} mm");
            let mut sides: BTreeMap<(u32, u32), i32> = BTreeMap::new();
            for [a, b, c] in &mesh.triangles {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    let path = if from < to { 1 } else { -1 };
                    *sides.entry((*from.min(to), *from.max(to))).or_default() += path;
                }
            }
            assert!(sides.values().all(|sum| *sum == 0), "closed, and all triangles face one way");
        }
    }

    #[test]
    fn what_the_grid_cuts_stays_open() {
        let (grid, values) = ball(40.0, 2.0);
        let half = Grid { counts: [grid.counts[0], grid.counts[1], grid.counts[2] / 2], ..grid };
        let mesh = march(&half, &values[..half.len()], 0.0);
        let area = 2e-2 * PI * 40.0 * 40.0;
        assert!((mesh.area_cm2() / area - 1.0).abs() < 0.04, "no lid: {} of {area}", mesh.area_cm2());
    }
}
