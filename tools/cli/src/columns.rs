//! Tables of text that fit a terminal.

use std::fmt::{Display, Formatter, Result};

/// Characters of a line at most, as long as the first column and one other fit.
const WIDTH: usize = 100;

/// On which side of a column its cells stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Text is aligned left.
    Left,
    /// Numbers are aligned right.
    Right,
}

/// A table whose columns are as wide as their widest cells. If it is wider than 100 characters, the columns that do not
/// fit follow in further blocks, each with the first column in front.
#[derive(Clone, Debug)]
pub struct Columns {
    head: Vec<(Side, String)>,
    rows: Vec<Vec<String>>,
}

impl Columns {
    /// An empty table with these headings; the first column names the rows.
    pub fn new<H: Into<String>>(head: impl IntoIterator<Item = (Side, H)>) -> Self {
        let head = head.into_iter().map(|(side, name)| (side, name.into())).collect();
        Self { head, rows: Vec::new() }
    }

    /// Adds a row with a cell for each column.
    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// Leaves out the columns in which every cell is `0`, and gives their headings.
    pub fn fold_zeros(&mut self) -> Vec<String> {
        let is_zero = |at: usize| at > 0 && self.rows.iter().all(|row| row[at] == "0");
        let zeros: Vec<bool> = (0..self.head.len()).map(is_zero).collect();
        let folded = self.head.iter().zip(&zeros).filter(|(_, zero)| **zero);
        let folded = folded.map(|((_, name), _)| name.clone()).collect();
        let retained = |at: usize| !zeros[at];
        self.head = keep(std::mem::take(&mut self.head), retained);
        self.rows = std::mem::take(&mut self.rows).into_iter().map(|row| keep(row, retained)).collect();
        folded
    }

    fn width(&self, at: usize) -> usize {
        let cells = self.rows.iter().map(|row| &row[at]).chain([&self.head[at].1]);
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    }

    /// The columns of each block, without the first.
    fn blocks(&self) -> Vec<Vec<usize>> {
        let first = self.width(0);
        let mut blocks: Vec<Vec<usize>> = vec![Vec::new()];
        let mut used = first;
        for at in 1..self.head.len() {
            let width = self.width(at) + 2;
            if used + width > WIDTH && blocks.last().is_some_and(|block| !block.is_empty()) {
                blocks.push(Vec::new());
                used = first;
            }
            used += width;
            blocks.last_mut().into_iter().for_each(|block| block.push(at));
        }
        blocks
    }
}

fn keep<T>(all: Vec<T>, retained: impl Fn(usize) -> bool) -> Vec<T> {
    all.into_iter().enumerate().filter(|(at, _)| retained(*at)).map(|(_, item)| item).collect()
}

impl Display for Columns {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let head: Vec<String> = self.head.iter().map(|(_, name)| name.clone()).collect();
        for (number, block) in self.blocks().iter().enumerate() {
            if number > 0 {
                writeln!(f)?;
            }
            for row in std::iter::once(&head).chain(&self.rows) {
                let mut line = String::new();
                for at in std::iter::once(0).chain(block.iter().copied()) {
                    let (cell, width) = (&row[at], self.width(at));
                    let gap = if at == 0 { "" } else { "  " };
                    line += &match self.head[at].0 {
                        Side::Left => format!("{gap}{cell:<width$}"),
                        Side::Right => format!("{gap}{cell:>width$}"),
                    };
                }
                writeln!(f, "{}", line.trim_end())?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(numbers: usize, name: &str, cell: &str) -> Columns {
        let numbered = (0..numbers).map(|at| (Side::Right, format!("column {at}")));
        let mut table = Columns::new([(Side::Left, "name".to_owned())].into_iter().chain(numbered));
        table.row(std::iter::once(name.to_owned()).chain((0..numbers).map(|_| cell.to_owned())));
        table
    }

    #[test]
    fn columns_are_as_wide_as_their_cells() {
        let text = table(2, "a row", "1234567890").to_string();
        assert_eq!(text, "name     column 0    column 1\na row  1234567890  1234567890\n");
    }

    #[test]
    fn a_wide_table_continues_below_and_no_line_is_longer_than_a_hundred() {
        let text = table(20, "a name of thirty characters...", "17").to_string();
        assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
        assert_eq!(text.matches("column ").count(), 20);
        assert_eq!(text.matches("a name").count(), text.lines().filter(|l| l.starts_with("name")).count());
    }

    #[test]
    fn columns_of_zeros_are_folded_and_named() {
        let mut table = table(3, "a", "0");
        table.row(["b", "0", "5", "0"].map(str::to_owned));
        assert_eq!(table.fold_zeros(), ["column 0", "column 2"]);
        assert_eq!(table.to_string(), "name  column 1\na            0\nb            5\n");
    }
}
