//! Cells of a regular grid, and points sorted into them.

use crate::cell_index::CellIndex;

/// Cell coordinates are less than this, in each direction of each axis; 21 bits of a key each.
const REACH: i32 = 1 << 20;

/// A cell's three coordinates in one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CellKey(u64);

impl CellKey {
    /// Cells at each end of an axis in which no point lies: so far, a step leads from key to key by adding.
    pub const FREE: u64 = 3;
    /// A point nearer to the origin than this many cells lies in the grid.
    pub const INNER: f64 = (REACH as u64 - 2 * Self::FREE) as f64;
    /// The key of no cell.
    pub const NONE: Self = Self(u64::MAX);
    /// The key of the next cell along x, less that of this one.
    pub const STEP_X: u64 = 1 << 42;
    /// The same along y; along z it is 1.
    pub const STEP_Y: u64 = 1 << 21;

    /// The cell of `point` in a grid of cells `1 / inverse_side` wide; `None` beyond the grid and for NaN. A point that lies
    /// before the end of a cell by less than 2^-21 of its width counts to the next one.
    #[inline]
    pub fn of(point: [f32; 3], inverse_side: f64) -> Option<Self> {
        const LEAST: f64 = CellKey::FREE as f64;
        const MOST: f64 = (2 * REACH as u64 - CellKey::FREE) as f64;
        let shifted = point.map(|c| f64::from(c) * inverse_side + f64::from(REACH));
        // Written so that NaN is outside.
        let inside = shifted.iter().all(|c| *c >= LEAST && *c < MOST);
        inside.then(|| Self::of_inner(point, inverse_side))
    }

    /// As [`of`](Self::of), of a point less than [`INNER`](Self::INNER) cells from the origin; of any other, some cell.
    #[inline]
    pub fn of_inner(point: [f32; 3], inverse_side: f64) -> Self {
        // In numbers of this size the last bit is 1: adding it rounds, and leaves a whole number in the low bits.
        const WHOLE: f64 = (1_u64 << 52) as f64;
        const SHIFT: f64 = REACH as f64 - (0.5 - 1.0 / (1 << 21) as f64);
        let rounded = point.map(|c| f64::from(c) * inverse_side + SHIFT + WHOLE);
        let [x, y, z] = rounded.map(|c| c.to_bits() & (2 * REACH as u64 - 1));
        Self(x << 42 | y << 21 | z)
    }

    /// The block of 8 x 4 x 8 cells that a cell is in, and its place there.
    #[inline]
    pub fn split(self) -> (Self, usize) {
        const WITHIN: u64 = 7 << 42 | 3 << 21 | 7;
        let within = self.0 >> 37 & 7 << 5 | self.0 >> 18 & 3 << 3 | self.0 & 7;
        (Self(self.0 & !WITHIN), within as usize)
    }

    /// A number whose high half is well mixed (Fibonacci hashing).
    #[inline]
    pub fn mixed(self) -> u64 {
        self.0.wrapping_mul(0x9e37_79b9_7f4a_7c15)
    }

    /// Whether two cells share a face, an edge or a corner, or are the same.
    #[inline]
    pub fn touches(self, other: Self) -> bool {
        (0..3).all(|axis| {
            let [a, b] = [self, other].map(|key| (key.0 >> (21 * axis)) as i32 & (2 * REACH - 1));
            (a - b).abs() <= 1
        })
    }

    /// The key that is `steps` greater.
    #[inline]
    pub fn plus(self, steps: u64) -> Self {
        Self(self.0.wrapping_add(steps))
    }

    /// The cell `by` further, at most [`FREE`](Self::FREE) steps along each axis.
    #[inline]
    pub fn offset(self, by: [i32; 3]) -> Self {
        let [x, y, z] = by.map(|steps| i64::from(steps) as u64);
        self.plus(x.wrapping_mul(Self::STEP_X).wrapping_add(y.wrapping_mul(Self::STEP_Y)).wrapping_add(z))
    }
}

/// Marks a point that is in no cell.
pub(crate) const NO_CELL: u32 = u32::MAX;

/// Points sorted into cells, with the buffers for it.
#[derive(Debug, Clone, Default)]
pub(crate) struct SortedCells {
    index: CellIndex,
    cell_of_point: Vec<u32>,
    /// Where each cell's points start in `members`; one more at the end.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl SortedCells {
    /// Sorts `points` into cells `1 / inverse_side` wide. Points beyond the grid and NaN are in no cell.
    pub fn sort(&mut self, points: &[[f32; 3]], inverse_side: f64) {
        self.index.clear();
        self.cell_of_point.clear();
        for &point in points {
            let cell = CellKey::of(point, inverse_side).map_or(NO_CELL, |key| self.index.insert(key));
            self.cell_of_point.push(cell);
        }
        // A counting sort keeps the points of a cell in their order.
        self.starts.clear();
        self.starts.resize(self.index.len() + 2, 0);
        for &cell in self.cell_of_point.iter().filter(|&&cell| cell != NO_CELL) {
            self.starts[cell as usize + 2] += 1;
        }
        for cell in 2..self.starts.len() {
            self.starts[cell] += self.starts[cell - 1];
        }
        self.members.clear();
        self.members.resize(self.starts[self.starts.len() - 1] as usize, 0);
        for (point, &cell) in self.cell_of_point.iter().enumerate().filter(|&(_, &cell)| cell != NO_CELL) {
            let next = &mut self.starts[cell as usize + 1];
            self.members[*next as usize] = point as u32;
            *next += 1;
        }
        self.starts.pop();
    }

    pub fn index(&self) -> &CellIndex {
        &self.index
    }

    /// The cell of each point, or [`NO_CELL`].
    pub fn cell_of_point(&self) -> &[u32] {
        &self.cell_of_point
    }

    /// The points of a cell, in their order.
    #[inline]
    pub fn members(&self, cell: u32) -> &[u32] {
        &self.members[self.starts[cell as usize] as usize..self.starts[cell as usize + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_half_open_on_both_sides_of_zero() {
        let cell = |x: f32| CellKey::of([x, 0.0, 0.0], 10.0).unwrap();
        assert_eq!(cell(0.0), cell(0.099));
        assert_ne!(cell(-0.001), cell(0.0));
        assert_eq!(cell(-0.001), cell(-0.099));
        assert_eq!(cell(0.0).offset([-1, 0, 0]), cell(-0.05));
        assert_eq!(cell(0.0).offset([2, -1, 1]).offset([-2, 1, -1]), cell(0.0));
        assert!(
            cell(0.0).touches(cell(-0.05)) && cell(0.0).touches(cell(0.15)) && !cell(0.0).touches(cell(0.25))
        );
    }

    #[test]
    fn points_beyond_the_grid_and_nan_have_no_cell() {
        assert_eq!(CellKey::of([f32::NAN, 0.0, 0.0], 1.0), None);
        assert_eq!(CellKey::of([0.0, f32::INFINITY, 0.0], 1.0), None);
        assert_eq!(CellKey::of([0.0, 0.0, 1048576.0], 1.0), None);
        assert_eq!(CellKey::of([0.0, 0.0, -1048574.0], 1.0), None);
        assert!(CellKey::of([0.0, 0.0, -1048573.0], 1.0).is_some());
    }
}
