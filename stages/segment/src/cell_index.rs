//! Cells numbered in the order in which they are first seen.

use crate::cells::CellKey;

/// Cells of a block.
const BLOCK: usize = 256;

/// A table from cells to their numbers: 0, 1, 2 in the order of first insertion.
///
/// The numbers of a block's cells lie side by side, and neighbouring points are mostly of one block or of two between
/// which noise goes to and fro: so few blocks are looked up, and to find a cell in one nothing is compared.
#[derive(Debug, Clone, Default)]
pub(crate) struct CellIndex {
    keys: Vec<CellKey>,
    blocks: Blocks,
    /// For each block its cells' numbers plus one, 0 where there is none.
    cells: Vec<u32>,
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
            _ => self.enter(block),
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
        let start = self.blocks.get(block)? as usize * BLOCK;
        self.cells[start + within].checked_sub(1)
    }

    /// Where a block's cells start; it is the last one from here on.
    #[inline]
    fn enter(&mut self, block: CellKey) -> usize {
        std::mem::swap(&mut self.last, &mut self.before);
        match self.last {
            Some((last, start)) if last == block => start,
            _ => self.look_up(block),
        }
    }

    fn look_up(&mut self, block: CellKey) -> usize {
        let start = self.blocks.insert(block) as usize * BLOCK;
        if start == self.cells.len() {
            self.cells.resize(start + BLOCK, 0);
        }
        self.last = Some((block, start));
        start
    }
}

/// An open-addressing table from blocks to their numbers, in the order of first insertion.
#[derive(Debug, Clone, Default)]
struct Blocks {
    keys: Vec<CellKey>,
    /// Number plus one, 0 for an empty slot; the length is a power of two.
    slots: Vec<u32>,
}

impl Blocks {
    fn clear(&mut self) {
        self.keys.clear();
        self.slots.fill(0);
    }

    /// The block's number; a new one where it was not there.
    fn insert(&mut self, block: CellKey) -> u32 {
        if self.keys.len() * 2 >= self.slots.len() {
            self.grow();
        }
        let slot = self.slot(block);
        if self.slots[slot] == 0 {
            self.keys.push(block);
            self.slots[slot] = self.keys.len() as u32;
        }
        self.slots[slot] - 1
    }

    /// The block's number, if it is there.
    fn get(&self, block: CellKey) -> Option<u32> {
        if self.slots.is_empty() {
            return None;
        }
        self.slots[self.slot(block)].checked_sub(1)
    }

    /// The slot that holds `block` or would.
    fn slot(&self, block: CellKey) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = (block.mixed() >> 32) as usize & mask;
        loop {
            let number = self.slots[slot];
            if number == 0 || self.keys[number as usize - 1] == block {
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
