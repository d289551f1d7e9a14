//! Cells numbered in the order in which they are first seen.

use crate::cells::CellKey;

/// Cells of a block.
const BLOCK: usize = 256;
/// Blocks at most: 64 MiB of numbers. A surface of 70 m2 in voxels of 5 mm has as many.
const MOST_BLOCKS: usize = 1 << 16;

/// A table from cells to their numbers: 0, 1, 2 in the order of first insertion.
///
/// The numbers of a block's cells lie side by side, and neighbouring points are mostly of one block or of two between
/// which noise goes to and fro: so few blocks are looked up, and to find a cell in one nothing is compared. Where points
/// lie far apart, most of a block is empty: cells of blocks beyond [`MOST_BLOCKS`] are looked up one by one.
#[derive(Debug, Clone, Default)]
pub(crate) struct CellIndex {
    keys: Vec<CellKey>,
    blocks: Order,
    /// For each block its cells' numbers plus one, 0 where there is none.
    cells: Vec<u32>,
    /// Cells that are in no block, and for each of them its number.
    strays: Order,
    stray_numbers: Vec<u32>,
    /// The block of the last insertion, and where its cells start.
    last: Option<(CellKey, usize)>,
    /// The same of the block before it.
    before: Option<(CellKey, usize)>,
}

impl CellIndex {
    /// Forgets all cells and keeps the memory.
    pub fn clear(&mut self) {
        self.keys.clear();
        self.blocks.clear();
        self.cells.clear();
        self.strays.clear();
        self.stray_numbers.clear();
        (self.last, self.before) = (None, None);
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
        let (block, within) = key.split();
        let start = match self.last {
            Some((last, start)) if last == block => start,
            _ => match self.enter(block) {
                Some(start) => start,
                None => return self.insert_stray(key),
            },
        };
        let cell = &mut self.cells[start + within];
        if *cell == 0 {
            self.keys.push(key);
            *cell = self.keys.len() as u32;
        }
        *cell - 1
    }

    /// The cell's number, if it is there.
    #[inline]
    pub fn get(&self, key: CellKey) -> Option<u32> {
        let (block, within) = key.split();
        match self.blocks.get(block) {
            Some(block) => self.cells[block as usize * BLOCK + within].checked_sub(1),
            None => self.strays.get(key).map(|stray| self.stray_numbers[stray as usize]),
        }
    }

    /// Where a block's cells start; it is the last one from here on. `None` where there are too many blocks.
    #[inline]
    fn enter(&mut self, block: CellKey) -> Option<usize> {
        std::mem::swap(&mut self.last, &mut self.before);
        match self.last {
            Some((last, start)) if last == block => Some(start),
            _ => self.look_up(block),
        }
    }

    fn look_up(&mut self, block: CellKey) -> Option<usize> {
        let number = match self.blocks.len() < MOST_BLOCKS {
            true => self.blocks.insert(block),
            false => self.blocks.get(block)?,
        };
        let start = number as usize * BLOCK;
        if start == self.cells.len() {
            self.cells.resize(start + BLOCK, 0);
        }
        self.last = Some((block, start));
        Some(start)
    }

    #[cold]
    fn insert_stray(&mut self, key: CellKey) -> u32 {
        let stray = self.strays.insert(key) as usize;
        if stray == self.stray_numbers.len() {
            self.stray_numbers.push(self.keys.len() as u32);
            self.keys.push(key);
        }
        self.stray_numbers[stray]
    }
}

/// An open-addressing table from keys to their numbers in the order of first insertion.
#[derive(Debug, Clone, Default)]
struct Order {
    keys: Vec<CellKey>,
    /// Number plus one, 0 for an empty slot; the length is a power of two.
    slots: Vec<u32>,
}

impl Order {
    fn clear(&mut self) {
        self.keys.clear();
        self.slots.fill(0);
    }

    fn len(&self) -> usize {
        self.keys.len()
    }

    /// The key's number; a new one where it was not there.
    fn insert(&mut self, key: CellKey) -> u32 {
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

    /// The key's number, if it is there.
    fn get(&self, key: CellKey) -> Option<u32> {
        if self.slots.is_empty() {
            return None;
        }
        self.slots[self.slot(key)].checked_sub(1)
    }

    /// The slot that holds `key` or would.
    fn slot(&self, key: CellKey) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = (key.mixed() >> 32) as usize & mask;
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
        let length = (self.slots.len() * 2).max(1 << 10);
        self.slots.clear();
        self.slots.resize(length, 0);
        for number in 0..self.keys.len() {
            let slot = self.slot(self.keys[number]);
            self.slots[slot] = number as u32 + 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

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
    fn lone_cells_cost_no_block_each() {
        let mut index = CellIndex::default();
        let mut expected = BTreeMap::new();
        // Twice as many blocks as there may be, a cell in each, then another cell of each; all of them twice.
        let key = |block: usize, within: usize| {
            let (x, y) = (8 * (block % 512), 4 * (block / 512));
            CellKey::of([x, y, within].map(|c| c as f32 + 0.5), 1.0).unwrap()
        };
        let all = (0..2).flat_map(|within| (0..2 * MOST_BLOCKS).map(move |block| key(block, within)));
        for key in all.clone().chain(all.clone()) {
            let next = expected.len() as u32;
            let number = *expected.entry(key).or_insert(next);
            assert_eq!((index.insert(key), index.get(key)), (number, Some(number)));
            assert_eq!(index.keys()[number as usize], key);
        }
        assert_eq!(index.len(), 4 * MOST_BLOCKS);
        assert_eq!(index.cells.len(), MOST_BLOCKS * BLOCK);
        assert_eq!(index.get(key(2 * MOST_BLOCKS - 1, 2)), None);
        // Of strays of a frame before nothing is left.
        let last = key(2 * MOST_BLOCKS - 1, 1);
        index.clear();
        assert_eq!((index.get(last), index.insert(last), index.len()), (None, 0, 1));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn numbers_are_those_of_an_ordered_map(cells in prop::collection::vec(prop::array::uniform3(-12..12_i8), 0..300)) {
            let mut index = CellIndex::default();
            // Of a frame before nothing is left.
            index.insert(CellKey::of([0.5; 3], 1.0).unwrap());
            index.clear();
            let mut expected = BTreeMap::new();
            for cell in cells {
                let next = expected.len() as u32;
                let number = *expected.entry(cell).or_insert(next);
                let key = CellKey::of(cell.map(|c| f32::from(c) + 0.5), 1.0).unwrap();
                prop_assert_eq!((index.insert(key), index.get(key)), (number, Some(number)));
                prop_assert_eq!(index.keys()[number as usize], key);
            }
            prop_assert_eq!(index.len(), expected.len());
        }
    }
}
