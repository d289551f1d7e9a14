//! What can be wrong with a PLY file, with the numbers that show it.

use thiserror::Error;

use crate::records::Surplus;

/// Why bytes are no PLY file that can be read. Lines and rows count from 1.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PlyError {
    /// Its first line is another.
    #[error("its first line is `{0}`, not `ply`: it is not a PLY file")]
    NoPly(String),
    /// Its lines end with CR alone.
    #[error("its lines end with CR alone, as on old Macs: convert them to LF")]
    CarriageReturns,
    /// A line of the header is none of PLY.
    #[error("line {line} of the header is `{found}`: {expected}")]
    Header {
        /// The line.
        line: usize,
        /// The start of the text found.
        found: String,
        /// What is wrong with it.
        expected: &'static str,
    },
    /// The header does not end.
    #[error("its header has no `end_header` in its {lines} lines")]
    NoEnd {
        /// Lines read.
        lines: usize,
    },
    /// It has no vertices.
    #[error("it has no element `vertex` with the properties x, y and z (or X, Y and Z), each one number")]
    NoVertices,
    /// More than a file of this length holds, or than is read.
    #[error("its element `{element}` claims {count} rows, at most {most} can be there")]
    TooMany {
        /// Name of the element.
        element: String,
        /// Rows that the header claims.
        count: usize,
        /// The most.
        most: usize,
    },
    /// The data ends before the rows do.
    #[error("its element `{element}` has {expected} rows by the header, and the data ends in row {row}")]
    Short {
        /// Name of the element.
        element: String,
        /// Rows that the header claims.
        expected: usize,
        /// The row, from 1.
        row: usize,
    },
    /// A line of numbers is not a row of its element.
    #[error(
        "row {row} of its element `{element}`, `{found}`, has {count} numbers where {expected} are expected: are there as many \
         rows as the header says?"
    )]
    Row {
        /// Name of the element.
        element: String,
        /// The row, from 1.
        row: usize,
        /// The start of the line.
        found: String,
        /// Numbers found.
        count: usize,
        /// Numbers due.
        expected: usize,
    },
    /// A word is not a number.
    #[error("row {row} of its element `{element}` has `{found}`, which is not a number")]
    NotANumber {
        /// Name of the element.
        element: String,
        /// The row, from 1.
        row: usize,
        /// The start of the word.
        found: String,
    },
    /// A list of a binary row has a count that is none.
    #[error(
        "row {row} of its element `{element}` has a list of {count} numbers (allowed: a whole number from 0)"
    )]
    ListLength {
        /// Name of the element.
        element: String,
        /// The row, from 1.
        row: usize,
        /// The count, as text.
        count: String,
    },
    /// There is more data than the header says.
    #[error(transparent)]
    Surplus(#[from] Surplus),
}
