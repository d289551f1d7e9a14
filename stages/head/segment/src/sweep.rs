//! Pairs of neighbouring cells, by sweeping over their sorted keys.
//!
//! A row of neighbours (the same x and y steps, all z steps) is a range of keys, and it advances with the sweep. So
//! each row needs one place in the list that only goes forward, and no look-up.

use crate::cells::CellKey;

/// A list of cells to sweep over, with its buffers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sweep {
    /// Keys and numbers of the cells, by rising key.
    sorted: Vec<(CellKey, u32)>,
    rows: Vec<Row>,
}

/// A row of neighbours: its first key and the last, from that of the cell, and where the sweep is in it.
#[derive(Debug, Clone)]
struct Row {
    first: u64,
    last: u64,
    at: usize,
}

impl Sweep {
    /// Calls `meet` for each pair of cells (numbers of `keys`, each key once) that are at most `reach` steps apart along
    /// each axis; once for each pair, the order depending on the keys alone. `reach` is at most [`CellKey::FREE`].
    pub fn pairs(&mut self, keys: &[CellKey], reach: u64, mut meet: impl FnMut(u32, u32)) {
        self.sorted.clear();
        self.sorted.extend(keys.iter().zip(0..).map(|(&key, number)| (key, number)));
        self.sorted.sort_unstable();
        // Half of the rows around a cell: the other half finds its pairs from the other side.
        self.rows.clear();
        for x in 0..=reach {
            for y in 0..=2 * reach {
                // The steps in y are from -reach; of the cell's own row, those in z are from 1.
                if x == 0 && y < reach {
                    continue;
                }
                let middle = x * CellKey::STEP_X + y * CellKey::STEP_Y - reach * CellKey::STEP_Y;
                let first = if x == 0 && y == reach { middle + 1 } else { middle - reach };
                self.rows.push(Row { first, last: middle + reach, at: 0 });
            }
        }
        for (cell, &(key, number)) in self.sorted.iter().enumerate() {
            for row in &mut self.rows {
                let (first, last) = (key.plus(row.first), key.plus(row.last));
                row.at = row.at.max(cell);
                while self.sorted.get(row.at).is_some_and(|(other, _)| *other < first) {
                    row.at += 1;
                }
                let from_here = self.sorted[row.at..].iter().take_while(|(other, _)| *other <= last);
                from_here.for_each(|&(_, other)| meet(number, other));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn pairs_are_those_of_all_cells(
            cells in prop::collection::btree_set(prop::array::uniform3(-4..4_i8), 0..80),
            reach in 1..3_u64,
        ) {
            let cells: Vec<[i8; 3]> = cells.into_iter().collect();
            let keys: Vec<_> =
                cells.iter().map(|cell| CellKey::of(cell.map(|c| f32::from(c) + 0.5), 1.0).unwrap()).collect();
            let mut found = Vec::new();
            Sweep::default().pairs(&keys, reach, |a, b| found.push([a.min(b), a.max(b)]));
            found.sort_unstable();
            let mut expected = Vec::new();
            for a in 0..cells.len() {
                for b in a + 1..cells.len() {
                    let near = (0..3).all(|i| u64::from(cells[a][i].abs_diff(cells[b][i])) <= reach);
                    if near {
                        expected.push([a as u32, b as u32]);
                    }
                }
            }
            prop_assert_eq!(found, expected);
        }
    }
}
