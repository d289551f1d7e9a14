//! The rows of a PLY file, text or binary, element by element.

use super::PlyError;
use super::header::{Comment, Element, Encoding, Header, Scalar};
use crate::records::{self, Surplus, quoted};

/// A number of a row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Value {
    /// In double precision.
    pub double: f64,
    /// In single precision, rounded once.
    pub single: f32,
}

/// The numbers of a property in a row: one, or those of a list.
pub type Cell = Vec<Value>;

/// A file whose header is read. The rows of its elements are read in their order.
pub struct Ply<'a> {
    header: Header,
    rest: &'a [u8],
}

impl<'a> Ply<'a> {
    /// Reads the header.
    ///
    /// # Errors
    /// What is wrong with it, with its line; more rows than the file can have.
    pub fn open(bytes: &'a [u8]) -> Result<Self, PlyError> {
        let header = Header::parse(bytes)?;
        let rest = &bytes[header.data_offset..];
        Ok(Self { header, rest })
    }

    /// The elements, in the order of the file.
    #[must_use]
    pub fn elements(&self) -> &[Element] {
        &self.header.elements
    }

    /// The comments of the header.
    #[must_use]
    pub fn comments(&self) -> &[Comment] {
        &self.header.comments
    }

    /// How the rows are written.
    #[must_use]
    pub fn encoding(&self) -> Encoding {
        self.header.encoding
    }

    /// Reads the rows of the next element, one of [`Ply::elements`]; `row` gets the number of the row, from 0, and a cell
    /// for each of `columns`, which are places among the properties. The other properties are passed over.
    ///
    /// # Errors
    /// A row that the file does not have whole, or that is not one of the element; those of `row`.
    pub fn rows<E: From<PlyError>>(
        &mut self,
        element: &Element,
        columns: &[usize],
        mut row: impl FnMut(usize, &[Cell]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut cells = vec![Cell::new(); columns.len()];
        let cell_of: Vec<Option<usize>> =
            (0..element.properties.len()).map(|p| columns.iter().position(|c| *c == p)).collect();
        for number in 0..element.rows {
            cells.iter_mut().for_each(Vec::clear);
            let mut keep = |property: usize, value: Value| {
                if let Some(cell) = cell_of[property] {
                    cells[cell].push(value);
                }
            };
            match self.header.encoding {
                Encoding::Ascii => {
                    let line = self.line().ok_or_else(|| short(element, number))?;
                    text_row(element, number, line, &cell_of, &mut keep)?;
                }
                order => binary_row(
                    element,
                    number,
                    &mut self.rest,
                    order == Encoding::BigEndian,
                    &cell_of,
                    &mut keep,
                )?,
            }
            row(number, &cells)?;
        }
        Ok(())
    }

    /// Whether the file ends behind the last row; call it when the rows of all elements were read. Text may have blank
    /// lines there, binary files zeros or blanks.
    ///
    /// # Errors
    /// How many bytes follow.
    pub fn end(mut self) -> Result<(), PlyError> {
        let rows = self.header.elements.iter().map(|e| e.rows).sum::<usize>();
        if self.header.encoding != Encoding::Ascii {
            return Ok(records::surplus(self.rest, rows)?);
        }
        let mut surplus = 0;
        while let Some(line) = self.line() {
            surplus += line.len() + 1;
        }
        match surplus {
            0 => Ok(()),
            _ => Err(Surplus { items: "rows", expected: rows, bytes: surplus }.into()),
        }
    }

    /// The next line that is not blank.
    fn line(&mut self) -> Option<&'a [u8]> {
        while !self.rest.is_empty() {
            let length = self.rest.iter().position(|b| *b == b'\n').unwrap_or(self.rest.len());
            let line = &self.rest[..length];
            self.rest = self.rest.get(length + 1..).unwrap_or_default();
            if !line.iter().all(u8::is_ascii_whitespace) {
                return Some(line);
            }
        }
        None
    }
}

fn short(element: &Element, number: usize) -> PlyError {
    PlyError::Short { element: quoted(&element.name), expected: element.rows, row: number + 1 }
}

/// One line. It must be a whole row, since a missing number would make one of the row behind it.
fn text_row(
    element: &Element,
    row: usize,
    line: &[u8],
    cell_of: &[Option<usize>],
    keep: &mut impl FnMut(usize, Value),
) -> Result<(), PlyError> {
    let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
    let (name, row) = (|| quoted(&element.name), row + 1);
    let shown = |bytes: &[u8]| quoted(String::from_utf8_lossy(bytes).trim());
    let bad =
        |expected| PlyError::Row { element: name(), row, found: shown(line), count: words.len(), expected };
    let number = |at: usize, expected: usize, scalar: Scalar| {
        let word = *words.get(at).ok_or_else(|| bad(expected))?;
        let not_a_number = || PlyError::NotANumber { element: name(), row, found: shown(word) };
        let double = records::double(word).ok_or_else(not_a_number)?;
        let single = match scalar {
            Scalar::F64 => double as f32,
            _ => records::number(word).ok_or_else(not_a_number)?,
        };
        Ok::<_, PlyError>(Value { double, single })
    };
    let mut at = 0;
    // What stands before the end of the row cannot be fewer numbers than its properties.
    let least = element.properties.len();
    for (place, property) in element.properties.iter().enumerate() {
        let mut length = 1;
        if let Some(scalar) = property.count {
            let count = number(at, least, scalar)?.double;
            let whole = count >= 0.0 && count.fract() == 0.0;
            at += 1;
            let end = if whole { at.saturating_add(count as usize) } else { usize::MAX };
            if end > words.len() {
                return Err(bad(end));
            }
            if cell_of[place].is_none() {
                at = end;
                continue;
            }
            length = count as usize;
        }
        for _ in 0..length {
            keep(place, number(at, least, property.scalar)?);
            at += 1;
        }
    }
    if at == words.len() { Ok(()) } else { Err(bad(at)) }
}

/// Takes a row off the data. Lists that no cell asks for are passed over, so that memory is taken for none of them.
fn binary_row(
    element: &Element,
    row: usize,
    rest: &mut &[u8],
    big_endian: bool,
    cell_of: &[Option<usize>],
    keep: &mut impl FnMut(usize, Value),
) -> Result<(), PlyError> {
    for (place, property) in element.properties.iter().enumerate() {
        let mut length = 1;
        if let Some(scalar) = property.count {
            let count = take(rest, scalar, big_endian).ok_or_else(|| short(element, row))?;
            if !(count >= 0.0 && count.fract() == 0.0) {
                let (element, row) = (quoted(&element.name), row + 1);
                return Err(PlyError::ListLength { element, row, count: count.to_string() });
            }
            length = count as usize;
        }
        let size = length.checked_mul(property.scalar.size());
        let bytes = size.and_then(|size| rest.split_at_checked(size)).ok_or_else(|| short(element, row))?;
        let mut numbers = bytes.0;
        *rest = bytes.1;
        if cell_of[place].is_some() {
            while let Some(double) = take(&mut numbers, property.scalar, big_endian) {
                keep(place, Value { double, single: double as f32 });
            }
        }
    }
    Ok(())
}

fn take(rest: &mut &[u8], scalar: Scalar, big_endian: bool) -> Option<f64> {
    let (bytes, behind) = rest.split_at_checked(scalar.size())?;
    *rest = behind;
    let value = match big_endian {
        true => bytes.iter().fold(0, |value, b| value << 8 | u64::from(*b)),
        false => bytes.iter().rev().fold(0, |value, b| value << 8 | u64::from(*b)),
    };
    Some(scalar.value(value))
}
