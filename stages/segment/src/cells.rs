//! Cells of a regular grid, numbered in the order in which they are first seen.

/// Cell coordinates are less than this, in each direction of each axis; 21 bits of a key each.
const REACH: i32 = 1 << 20;

/// A cell's three coordinates in one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct CellKey(u64);

impl CellKey {
    /// Cells at each end of an axis in which no point lies: so far, a step leads from key to key by adding.
    pub const FREE: u64 = 3;
    /// The key of the next cell along x, less that of this one.
    pub const STEP_X: u64 = 1 << 42;
    /// The same along y; along z it is 1.
    pub const STEP_Y: u64 = 1 << 21;

    /// The cell of `point` in a grid of cells `1 / inverse_side` wide; `None` beyond the grid and for NaN. A point that lies
    /// before the end of a cell by less than 2^-21 of its width counts to the next one.
    #[inline]
    pub fn of(point: [f32; 3], inverse_side: f64) -> Option<Self> {
        // In numbers of this size the last bit is 1: adding it rounds, and leaves a whole number in the low bits.
        const WHOLE: f64 = (1_u64 << 52) as f64;
        const HALF: f64 = 0.5 - 1.0 / (1 << 21) as f64;
        const LEAST: f64 = CellKey::FREE as f64;
        const MOST: f64 = (2 * REACH as u64 - CellKey::FREE) as f64;
        let shifted = point.map(|c| f64::from(c) * inverse_side + f64::from(REACH));
        // Written so that NaN is outside.
        let inside = shifted.iter().all(|c| *c >= LEAST && *c < MOST);
        let [x, y, z] = shifted.map(|c| (c - HALF + WHOLE).to_bits() & (2 * REACH as u64 - 1));
        inside.then_some(Self(x << 42 | y << 21 | z))
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
        // Cells that follow each other along x, as in a row of an image, share a cache line: eight have one home. Fibonacci
        // hashing mixes the rest: the high bits of the product are well mixed.
        let within = (key.0 >> 42) as usize & 7;
        let home = ((key.0 & !(7 << 42)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & !7;
        let mut slot = (home | within) & mask;
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
