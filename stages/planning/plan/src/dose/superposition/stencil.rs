//! The voxels behind a voxel: what a line from its centre crosses. Lines of one direction are parallel, so one list of
//! offsets and lengths serves all voxels.

use stillpoint_patient::Grid;

/// A voxel on a line, relative to the voxel from whose centre the line starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    /// Distance in a volume's values.
    pub offset: i32,
    /// Length of the line in the voxel, mm.
    pub length_mm: f32,
}

/// The steps of one direction.
#[derive(Clone, Debug)]
pub(super) struct Stencil {
    pub steps: Vec<Step>,
    /// By axis and number of voxels from the first voxel to the edge of the grid in the line's direction: steps inside.
    inside: [Vec<u32>; 3],
    is_rising: [bool; 3],
}

impl Stencil {
    /// Of a line in a direction (a unit vector of the grid's frame), as long as this.
    pub fn new(grid: &Grid, towards: [f64; 3], length_mm: f64) -> Self {
        let strides = [1, grid.counts[0], grid.counts[0] * grid.counts[1]];
        let is_rising = towards.map(|part| part > 0.0);
        // Where the line meets the planes of each axis next, mm.
        let every: [f64; 3] = std::array::from_fn(|axis| {
            let part = towards[axis].abs();
            if part > 1e-9 { grid.spacing_mm[axis] / part } else { f64::INFINITY }
        });
        let mut moved = [0_usize; 3];
        let mut inside = grid.counts.map(|count| vec![u32::MAX; count]);
        let mut steps = Vec::new();
        let (mut at, mut offset) = (0.0, 0_i32);
        while at < length_mm {
            let next: [f64; 3] = std::array::from_fn(|axis| (moved[axis] as f64 + 0.5) * every[axis]);
            let axis = (0..3).min_by(|a, b| next[*a].total_cmp(&next[*b])).unwrap_or(0);
            let end = next[axis].min(length_mm);
            if end > at {
                steps.push(Step { offset, length_mm: (end - at) as f32 });
            }
            at = end;
            // A voxel that is so many voxels from the edge has the steps until here.
            match inside[axis].get_mut(moved[axis]) {
                Some(count) => *count = steps.len() as u32,
                None => break,
            }
            moved[axis] += 1;
            offset += if is_rising[axis] { strides[axis] as i32 } else { -(strides[axis] as i32) };
        }
        let all = steps.len() as u32;
        inside.iter_mut().flatten().for_each(|count| *count = (*count).min(all));
        Self { steps, inside, is_rising }
    }

    /// The steps of a voxel that are inside of the grid.
    #[inline]
    pub fn of(&self, counts: [usize; 3], voxel: [usize; 3]) -> &[Step] {
        let mut count = self.steps.len();
        for axis in 0..3 {
            let left = if self.is_rising[axis] { counts[axis] - 1 - voxel[axis] } else { voxel[axis] };
            count = count.min(self.inside[axis][left] as usize);
        }
        &self.steps[..count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dose::siddon::segments;

    #[test]
    fn steps_are_the_segments_of_the_line_in_every_direction() {
        let grid = Grid { counts: [9, 7, 11], spacing_mm: [2.5, 3.0, 2.0], origin_mm: [1.0, -2.0, 5.0] };
        for (a, b) in [(0.3, 0.2), (1.3, 2.0), (2.2, 4.0), (3.0, 5.5), (1.57, 0.0), (0.0, 0.0)] {
            let towards: [f64; 3] = [f64::sin(a) * f64::cos(b), f64::cos(a), f64::sin(a) * f64::sin(b)];
            let stencil = Stencil::new(&grid, towards, 60.0);
            for voxel in [[0, 0, 0], [8, 6, 10], [4, 3, 5], [1, 5, 2]] {
                let from = grid.centre_mm(voxel);
                let to = std::array::from_fn(|axis| from[axis] + 60.0 * towards[axis]);
                let expected: Vec<(usize, f64)> =
                    segments(&grid, from, to).map(|s| (s.voxel, 60.0 * (s.end - s.begin))).collect();
                let start = grid.index(voxel) as i32;
                let found: Vec<(usize, f64)> = stencil
                    .of(grid.counts, voxel)
                    .iter()
                    .map(|step| ((start + step.offset) as usize, f64::from(step.length_mm)))
                    .collect();
                assert_eq!(found.len(), expected.len(), "{towards:?} {voxel:?}");
                for (f, e) in found.iter().zip(&expected) {
                    assert!(f.0 == e.0 && (f.1 - e.1).abs() < 1e-4, "{towards:?} {voxel:?}: {f:?} {e:?}");
                }
            }
        }
    }
}
