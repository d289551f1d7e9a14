//! Cells of a regular grid, numbered in the order in which they are first seen.

/// Cell coordinates reach from `-REACH` to `REACH - 1` in each axis; 21 bits of a key each.
const REACH: i32 = 1 << 20;

/// A cell's three coordinates in one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct CellKey(u64);

impl CellKey {
    /// The cell of `point` in a grid of cells `1 / inverse_side` wide; `None` beyond the grid and for NaN.
    #[inline]
    pub fn of(point: [f32; 3], inverse_side: f64) -> Option<Self> {
        let mut key = 0_u64;
        for coordinate in point {
            // Adding REACH makes truncation a floor.
            let shifted = f64::from(coordinate) * inverse_side + f64::from(REACH);
            // Written so that NaN is outside.
            if !(shifted >= 0.0 && shifted < f64::from(2 * REACH)) {
                return None;
            }
            // Through i32, for which the processor has an instruction.
            key = key << 21 | shifted as i32 as u64;
        }
        Some(Self(key))
    }

    /// Whether two cells share a face, an edge or a corner, or are the same.
    #[inline]
    pub fn touches(self, other: Self) -> bool {
        (0..3).all(|axis| {
            let [a, b] = [self, other].map(|key| (key.0 >> (21 * axis)) as i32 & (2 * REACH - 1));
            (a - b).abs() <= 1
        })
    }

    /// The cell `by` further, `None` beyond the grid.
    #[inline]
    pub fn offset(self, by: [i32; 3]) -> Option<Self> {
        let mut key = 0_u64;
        for (axis, step) in by.into_iter().enumerate() {
            let here = (self.0 >> (21 * (2 - axis))) as i32 & (2 * REACH - 1);
            let there = here + step;
            if !(0..2 * REACH).contains(&there) {
                return None;
            }
            key = key << 21 | there as u64;
        }
        Some(Self(key))
    }
}

/// An open-addressing table from cells to their numbers: 0, 1, 2 in the order of first insertion.
#[derive(Debug, Clone, Default)]
pub(crate) struct CellIndex {
    keys: Vec<CellKey>,
    /// Number plus one, 0 for an empty slot; the length is a power of two.
    slots: Vec<u32>,
}

impl CellIndex {
    /// Forgets all cells and keeps the memory.
    pub fn clear(&mut self) {
        self.keys.clear();
        self.slots.fill(0);
    }

    pub fn len(&self) -> usize {
        self.keys.len()
    }

    pub fn keys(&self) -> &[CellKey] {
        &self.keys
    }

    /// The cell's number; a new one where it was not there.
    #[inline]
    pub fn insert(&mut self, key: CellKey) -> u32 {
        if self.keys.len() * 2 >= self.slots.len() {
            self.grow();
        }
        let slot = self.slot(key);
        if self.slots[slot] == 0 {
            self.keys.push(key);
            self.slots[slot] = self.keys.len() as u32;
        }
        self.slots[slot] - 1
    }

    /// The cell's number, if it is there.
    #[inline]
    pub fn get(&self, key: CellKey) -> Option<u32> {
        if self.slots.is_empty() {
            return None;
        }
        self.slots[self.slot(key)].checked_sub(1)
    }

    /// The slot that holds `key` or would.
    #[inline]
    fn slot(&self, key: CellKey) -> usize {
        let mask = self.slots.len() - 1;
        // Fibonacci hashing: the high bits of the product are well mixed.
        let mut slot = (key.0.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & mask;
        loop {
            let number = self.slots[slot];
            if number == 0 || self.keys[number as usize - 1] == key {
                return slot;
            }
            slot = (slot + 1) & mask;
        }
    }

    #[cold]
    fn grow(&mut self) {
        let length = (self.slots.len() * 2).max(1 << 12);
        self.slots.clear();
        self.slots.resize(length, 0);
        for number in 0..self.keys.len() {
            let slot = self.slot(self.keys[number]);
            self.slots[slot] = number as u32 + 1;
        }
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
    fn cells_are_numbered_by_first_sight_through_growth() {
        let mut index = CellIndex::default();
        let key = |i: u32| CellKey::of([i as f32, -(i as f32), 0.5], 1.0).unwrap();
        for i in 0..20_000 {
            assert_eq!(index.insert(key(i)), i);
        }
        for i in 0..20_000 {
            assert_eq!((index.insert(key(i)), index.get(key(i))), (i, Some(i)));
        }
        assert_eq!(index.get(CellKey::of([0.0, 0.0, -1.0], 1.0).unwrap()), None);
    }

    #[test]
    fn cells_are_half_open_on_both_sides_of_zero() {
        let cell = |x: f32| CellKey::of([x, 0.0, 0.0], 10.0).unwrap();
        assert_eq!(cell(0.0), cell(0.099));
        assert_ne!(cell(-0.001), cell(0.0));
        assert_eq!(cell(-0.001), cell(-0.099));
        assert_eq!(cell(0.0).offset([-1, 0, 0]), Some(cell(-0.05)));
        assert!(
            cell(0.0).touches(cell(-0.05)) && cell(0.0).touches(cell(0.15)) && !cell(0.0).touches(cell(0.25))
        );
    }

    #[test]
    fn points_beyond_the_grid_and_nan_have_no_cell() {
        assert_eq!(CellKey::of([f32::NAN, 0.0, 0.0], 1.0), None);
        assert_eq!(CellKey::of([0.0, f32::INFINITY, 0.0], 1.0), None);
        assert_eq!(CellKey::of([0.0, 0.0, 1048576.0], 1.0), None);
        assert!(CellKey::of([0.0, 0.0, -1048576.0], 1.0).unwrap().offset([0, 0, -1]).is_none());
    }
}
