//! Levels into segments: the algorithm of Engel, "A new algorithm for optimal multileaf collimator field segmentation",
//! Discrete Appl. Math. 152 (2005) 35.
//!
//! The complexity of a row is the sum of the rises from one column to the next, of a map the largest of its rows; no
//! sequence needs fewer units than that. Each segment gets as many units as it can have so that the complexity of the rest
//! falls by as much. So the sum is the least possible. Among the segments that can have so many, the one is taken that
//! leaves the fewest steps between columns, which keeps the number of segments small.

/// A segment on the columns of a map: for each pair the columns that are open, from the first to before the second.
pub type Shape = Vec<[usize; 2]>;

/// Segments with their units; their sum is the levels (pair by pair, `columns` each).
pub fn divide(levels: &[u32], columns: usize) -> Vec<(u32, Shape)> {
    let mut rest: Vec<Row> = levels.chunks(columns.max(1)).map(Row::new).collect();
    let mut segments = Vec::new();
    loop {
        let complexity = rest.iter().map(Row::complexity).max().unwrap_or_default();
        if complexity == 0 {
            return segments;
        }
        let units = rest.iter().map(|row| row.most(complexity)).min().unwrap_or_default().max(1);
        let shape: Shape = rest.iter().map(|row| row.best(units, complexity)).collect();
        rest.iter_mut().zip(&shape).for_each(|(row, open)| row.take(units, *open));
        segments.push((units, shape));
    }
}

/// What is left of a row.
struct Row(Vec<u32>);

impl Row {
    fn new(levels: &[u32]) -> Self {
        Self(levels.to_vec())
    }

    fn level(&self, column: usize) -> u32 {
        self.0.get(column).copied().unwrap_or_default()
    }

    /// Step before a column: positive where the level rises.
    fn step(&self, column: usize) -> i64 {
        let before = if column == 0 { 0 } else { self.level(column - 1) };
        i64::from(self.level(column)) - i64::from(before)
    }

    fn complexity(&self) -> u32 {
        (0..self.0.len()).map(|column| self.step(column).max(0) as u32).sum()
    }

    /// Most units that an opening can have so that the complexity of this row stays within what is left of `complexity`.
    fn most_of(&self, [from, to]: [usize; 2], slack: u32) -> u32 {
        if from == to {
            return slack;
        }
        let (rise, fall) = (self.step(from).max(0) as u32, (-self.step(to)).max(0) as u32);
        let by_complexity =
            if slack <= rise.abs_diff(fall) { slack + rise.min(fall) } else { (slack + rise + fall) / 2 };
        by_complexity.min(self.0[from..to].iter().copied().min().unwrap_or_default())
    }

    fn openings(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let columns = self.0.len();
        let some = (0..columns).flat_map(move |from| (from + 1..=columns).map(move |to| [from, to]));
        std::iter::once([0, 0]).chain(some)
    }

    fn most(&self, complexity: u32) -> u32 {
        let slack = complexity - self.complexity();
        self.openings().map(|open| self.most_of(open, slack)).max().unwrap_or_default()
    }

    /// Of the openings that can have `units`, the first of those that remove most steps, the longest among them.
    fn best(&self, units: u32, complexity: u32) -> [usize; 2] {
        let slack = complexity - self.complexity();
        let gain = |[from, to]: [usize; 2]| {
            let step = |at: usize, change: i64| {
                let before = self.step(at);
                i32::from(before != 0) - i32::from(before + change != 0)
            };
            if from == to { 0 } else { step(from, -i64::from(units)) + step(to, i64::from(units)) }
        };
        let able = self.openings().filter(|open| self.most_of(*open, slack) >= units);
        let better = |a: [usize; 2], b: [usize; 2]| {
            if (gain(b), b[1] - b[0]) > (gain(a), a[1] - a[0]) { b } else { a }
        };
        able.reduce(better).unwrap_or([0, 0])
    }

    fn take(&mut self, units: u32, [from, to]: [usize; 2]) {
        self.0[from..to].iter_mut().for_each(|level| *level -= units);
    }
}
