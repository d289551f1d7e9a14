//! PLY files (Turk 1994), text or binary: the header, and the rows of each element. Meshes and point clouds are read
//! through it.

use thiserror::Error;

/// Why bytes are not a PLY file.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PlyError {
    /// The header, or a line of text.
    #[error("line {line}: {why}")]
    Line {
        /// From 1.
        line: usize,
        /// Description of the fault.
        why: String,
    },
    /// The file ends before what its header promises.
    #[error("the file ends at byte {found}, but its header promises {expected} bytes")]
    Short {
        /// Bytes that the header promises.
        expected: usize,
        /// Bytes found.
        found: usize,
    },
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Text,
    Little,
    Big,
}

/// The type of a number in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

/// A property of an element.
#[derive(Clone, Debug)]
pub struct Property {
    /// Its name.
    pub name: String,
    /// Type of the number that counts a list; none for a single number.
    count: Option<Number>,
    number: Number,
}

impl Property {
    /// Whether each row has a list of numbers.
    #[must_use]
    pub fn is_list(&self) -> bool {
        self.count.is_some()
    }
}

/// An element: a table.
#[derive(Clone, Debug)]
pub struct Element {
    /// Its name.
    pub name: String,
    /// Rows that the header claims.
    pub count: usize,
    /// The columns, in the order of the file.
    pub properties: Vec<Property>,
}

/// A comment of the header.
#[derive(Clone, Debug)]
pub struct Comment {
    /// Its line, from 1.
    pub line: usize,
    /// Its text.
    pub text: String,
}

/// A number of a row.
#[derive(Clone, Copy, Debug, Default)]
pub struct Value {
    /// In double precision.
    pub double: f64,
    /// In single precision, rounded once.
    pub single: f32,
}

/// The numbers of a property in a row: one, or those of a list.
pub type Cell = Vec<Value>;

/// A file whose header is read. Its elements are read in their order.
pub struct Ply<'a> {
    /// The elements, in the order of the file.
    pub elements: Vec<Element>,
    /// The comments of the header.
    pub comments: Vec<Comment>,
    bytes: &'a [u8],
    at: usize,
    format: Format,
    line: usize,
}

impl<'a> Ply<'a> {
    /// Reads the header.
    ///
    /// # Errors
    /// What is wrong with it, with its line.
    pub fn open(bytes: &'a [u8]) -> Result<Self, PlyError> {
        let (mut format, mut elements, mut comments) = (None, Vec::<Element>::new(), Vec::new());
        let (mut at, mut line) = (0, 0);
        loop {
            line += 1;
            let fault = |why: String| PlyError::Line { line, why };
            let end = bytes[at..]
                .iter()
                .position(|b| *b == b'\n')
                .ok_or_else(|| fault("the header has no end".into()))?;
            let text = std::str::from_utf8(&bytes[at..at + end])
                .map_err(|_| fault("the header is not text".into()))?;
            at += end + 1;
            let words: Vec<&str> = text.split_whitespace().collect();
            match words[..] {
                ["ply"] if line == 1 => {}
                _ if line == 1 => return Err(fault("a PLY file begins with `ply`".into())),
                ["format", "ascii", _] => format = Some(Format::Text),
                ["format", "binary_little_endian", _] => format = Some(Format::Little),
                ["format", "binary_big_endian", _] => format = Some(Format::Big),
                ["comment", ref rest @ ..] => comments.push(Comment { line, text: rest.join(" ") }),
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| fault(format!("{count:?} is not a count")))?;
                    elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
                }
                ["property", ref rest @ ..] => {
                    let property =
                        property(rest).ok_or_else(|| fault(format!("{text:?} is not a property")))?;
                    let element =
                        elements.last_mut().ok_or_else(|| fault("a property of no element".into()))?;
                    element.properties.push(property);
                }
                ["end_header"] => break,
                [] | ["obj_info", ..] => {}
                _ => return Err(fault(format!("{text:?} is not understood"))),
            }
        }
        let format = format.ok_or(PlyError::Line { line, why: "the header names no format".into() })?;
        // The rows of such an element take no bytes: nothing would end their reading before their count.
        if let Some(empty) = elements.iter().find(|e| e.properties.is_empty() && e.count > 0) {
            return Err(PlyError::Line { line, why: format!("element {:?} has no property", empty.name) });
        }
        Ok(Self { elements, comments, bytes, at, format, line })
    }

    /// Reads the rows of the next element, one of [`Ply::elements`]; `row` gets the number of the row and its cells.
    ///
    /// # Errors
    /// A row that the file does not have whole; those of `row`.
    pub fn rows<E: From<PlyError>>(
        &mut self,
        element: &Element,
        mut row: impl FnMut(usize, &[Cell]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut cells = vec![Cell::new(); element.properties.len()];
        for number in 0..element.count {
            for (cell, property) in cells.iter_mut().zip(&element.properties) {
                let length = match property.count {
                    Some(count) => self.number(count)?.double as usize,
                    None => 1,
                };
                cell.clear();
                for _ in 0..length {
                    cell.push(self.number(property.number)?);
                }
            }
            row(number, &cells)?;
        }
        Ok(())
    }

    fn number(&mut self, kind: Number) -> Result<Value, PlyError> {
        if self.format == Format::Text {
            return self.word(kind);
        }
        let double = match kind {
            Number::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Number::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Number::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Number::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Number::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Number::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Number::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Number::F64 => f64::from_le_bytes(self.take()?),
        };
        Ok(Value { double, single: double as f32 })
    }

    /// The next bytes, in little-endian order.
    fn take<const N: usize>(&mut self) -> Result<[u8; N], PlyError> {
        let end = self.at + N;
        let short = PlyError::Short { expected: end, found: self.bytes.len() };
        let mut taken: [u8; N] = self.bytes.get(self.at..end).and_then(|b| b.try_into().ok()).ok_or(short)?;
        self.at = end;
        if self.format == Format::Big {
            taken.reverse();
        }
        Ok(taken)
    }

    fn word(&mut self, kind: Number) -> Result<Value, PlyError> {
        while let Some(b) = self.bytes.get(self.at).filter(|b| b.is_ascii_whitespace()) {
            self.line += usize::from(*b == b'\n');
            self.at += 1;
        }
        let rest = &self.bytes[self.at.min(self.bytes.len())..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let word = std::str::from_utf8(&rest[..length]).unwrap_or_default();
        self.at += length;
        let fault = || PlyError::Line { line: self.line + 1, why: format!("{word:?} is not a number") };
        let double: f64 = word.parse().map_err(|_| fault())?;
        let single = match kind {
            Number::F32 => word.parse().map_err(|_| fault())?,
            _ => double as f32,
        };
        Ok(Value { double, single })
    }
}

fn number(word: &str) -> Option<Number> {
    Some(match word {
        "char" | "int8" => Number::I8,
        "uchar" | "uint8" => Number::U8,
        "short" | "int16" => Number::I16,
        "ushort" | "uint16" => Number::U16,
        "int" | "int32" => Number::I32,
        "uint" | "uint32" => Number::U32,
        "float" | "float32" => Number::F32,
        "double" | "float64" => Number::F64,
        _ => return None,
    })
}

fn property(words: &[&str]) -> Option<Property> {
    let (count, kind, name) = match words {
        ["list", count, kind, name] => (Some(number(count)?), kind, name),
        [kind, name] => (None, kind, name),
        _ => return None,
    };
    Some(Property { name: (*name).to_owned(), count, number: number(kind)? })
}
