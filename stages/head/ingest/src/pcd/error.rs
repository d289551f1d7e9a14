//! What can be wrong with a PCD file, with the numbers that show it.

use thiserror::Error;

use crate::checks::Surplus;

/// Why a PCD file cannot be read. Lines count from 1, columns of a record from 1, offsets in bytes from the file's start.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum PcdError {
    /// The file ends before a `DATA` line.
    #[error("the header has no DATA line in its {lines} lines; is this a PCD file?")]
    NoDataLine {
        /// Lines read before the end.
        lines: usize,
    },
    /// A header line starts with a word that PCD does not have.
    #[error("line {line}: `{key}` is not a PCD header entry")]
    UnknownKey {
        /// The line.
        line: usize,
        /// The word found.
        key: String,
    },
    /// A header entry appears twice.
    #[error("line {line}: {key} was given before")]
    Repeated {
        /// The line of the second one.
        line: usize,
        /// The entry.
        key: &'static str,
    },
    /// A header entry that is needed is absent.
    #[error("the header has no {key} entry")]
    Missing {
        /// The entry.
        key: &'static str,
    },
    /// A header entry has another number of values than the file has fields.
    #[error("line {line}: {key} needs {expected} values and has {found}")]
    ValueCount {
        /// The line.
        line: usize,
        /// The entry.
        key: &'static str,
        /// Values needed.
        expected: usize,
        /// Values found.
        found: usize,
    },
    /// A header value cannot be what its entry says.
    #[error("line {line}: {key} cannot be `{found}`; it takes {expected}")]
    BadValue {
        /// The line.
        line: usize,
        /// The entry.
        key: &'static str,
        /// The values that the entry takes, as text.
        expected: &'static str,
        /// The text found.
        found: String,
    },
    /// TYPE and SIZE of a field do not make a number.
    #[error("field `{field}` has TYPE {kind} and SIZE {size}, which is not a number type of PCD")]
    FieldType {
        /// The field.
        field: String,
        /// Its TYPE letter.
        kind: char,
        /// Its SIZE in bytes.
        size: usize,
    },
    /// A coordinate is absent, repeated or a vector.
    #[error(
        "the file needs exactly one field `{axis}`, in upper or lower case, with COUNT 1 and has {found}"
    )]
    Coordinate {
        /// `x`, `y` or `z`.
        axis: char,
        /// Fields of that name with COUNT 1.
        found: usize,
    },
    /// WIDTH times HEIGHT is not POINTS.
    #[error("WIDTH {width} times HEIGHT {height} is not POINTS {points}")]
    PointCount {
        /// WIDTH.
        width: usize,
        /// HEIGHT.
        height: usize,
        /// POINTS.
        points: usize,
    },
    /// The sizes in the header overflow.
    #[error("{points} records of {columns} columns cannot be held by any file")]
    TooLarge {
        /// POINTS.
        points: usize,
        /// Numbers per record, as far as they could be counted.
        columns: usize,
    },
    /// The data is shorter than the header says.
    #[error("the data at byte {offset} needs {expected} bytes and has {found}")]
    DataTooShort {
        /// Where the data starts.
        offset: usize,
        /// Bytes needed.
        expected: usize,
        /// Bytes there.
        found: usize,
    },
    /// The sizes given by compressed data do not fit the header.
    #[error(
        "the compressed data at byte {offset} says {found} bytes unpacked; the header makes it {expected}"
    )]
    UnpackedSize {
        /// Where the size is written.
        offset: usize,
        /// Bytes that the header makes.
        expected: usize,
        /// Bytes that the data says.
        found: usize,
    },
    /// The compressed data is damaged.
    #[error("the compressed data is damaged at byte {offset}: {unpacked} of {expected} bytes unpacked")]
    Compression {
        /// Where unpacking stopped.
        offset: usize,
        /// Bytes unpacked until there.
        unpacked: usize,
        /// Bytes expected in all.
        expected: usize,
    },
    /// An ascii record has too few or too many numbers.
    #[error("line {line}: a record has {expected} numbers, this one has {found}")]
    RecordLength {
        /// The line.
        line: usize,
        /// Numbers per record.
        expected: usize,
        /// Numbers found; counting stops one past `expected`.
        found: usize,
    },
    /// An ascii coordinate is not a number.
    #[error("line {line}, column {column}: field `{axis}` is not a number: `{found}`")]
    NotANumber {
        /// The line.
        line: usize,
        /// The column in the record.
        column: usize,
        /// `x`, `y` or `z`.
        axis: char,
        /// The text found, at most 32 characters.
        found: String,
    },
    /// Binary data goes on behind its last record.
    #[error(transparent)]
    Surplus(#[from] Surplus),
    /// Ascii data has another number of records than the header says.
    #[error("the header says {expected} records and line {line} ends the data with {found}")]
    RecordCount {
        /// The line where it shows.
        line: usize,
        /// POINTS.
        expected: usize,
        /// Records found; counting stops one past `expected`.
        found: usize,
    },
}
