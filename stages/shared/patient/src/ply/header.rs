//! The header of a PLY file: its encoding and its elements.

use super::{MOST_ROWS, PlyError};
use crate::records::quoted;

/// How the rows are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// A row a line, numbers as text.
    Ascii,
    /// The least byte first.
    LittleEndian,
    /// The greatest byte first.
    BigEndian,
}

/// A number type of PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn of_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of a number.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number of these bytes, the least first.
    pub fn value(self, bytes: u64) -> f64 {
        match self {
            Self::I8 => f64::from(bytes as u8 as i8),
            Self::U8 => f64::from(bytes as u8),
            Self::I16 => f64::from(bytes as u16 as i16),
            Self::U16 => f64::from(bytes as u16),
            Self::I32 => f64::from(bytes as u32 as i32),
            Self::U32 => f64::from(bytes as u32),
            Self::F32 => f64::from(f32::from_bits(bytes as u32)),
            Self::F64 => f64::from_bits(bytes),
        }
    }
}

/// A property of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    /// Its name.
    pub name: String,
    /// The type of the count of a list; `None` for one number.
    pub count: Option<Scalar>,
    /// The type of its numbers.
    pub scalar: Scalar,
}

/// An element: rows of equal properties.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    /// Its name.
    pub name: String,
    /// Its rows.
    pub rows: usize,
    /// Properties of a row.
    pub properties: Vec<Property>,
}

impl Property {
    /// Whether each row has a list of numbers.
    #[must_use]
    pub fn is_list(&self) -> bool {
        self.count.is_some()
    }
}

impl Element {
    /// The least bytes of a row in a file.
    fn least(&self, encoding: Encoding) -> usize {
        let of = |p: &Property| match encoding {
            // A digit and what ends it.
            Encoding::Ascii => 2,
            _ => p.count.unwrap_or(p.scalar).size(),
        };
        self.properties.iter().map(of).sum()
    }

    /// Places of x, y and z (or X, Y and Z) in the properties; nothing where one is missing, a list, or there twice.
    #[must_use]
    pub fn axes(&self) -> Option<[usize; 3]> {
        let places = [["x", "X"], ["y", "Y"], ["z", "Z"]].map(|[lower, upper]| {
            let named = |name: &str| self.properties.iter().any(|p| p.name == name);
            // Some programs write X; a file that has both means the lower case.
            let name = if named(lower) { lower } else { upper };
            let mut found = (0..self.properties.len()).filter(|at| self.properties[*at].name == name);
            match (found.next(), found.next()) {
                (Some(at), None) if self.properties[at].count.is_none() => Some(at),
                _ => None,
            }
        });
        let [Some(x), Some(y), Some(z)] = places else { return None };
        Some([x, y, z])
    }
}

/// A comment of the header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Comment {
    /// Its line, from 1.
    pub line: usize,
    /// Its words with one space between them.
    pub text: String,
}

/// A checked header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// How the rows are written.
    pub encoding: Encoding,
    /// The elements in their order.
    pub elements: Vec<Element>,
    /// The comments in their order.
    pub comments: Vec<Comment>,
    /// Where the data starts, in bytes.
    pub data_offset: usize,
}

impl Header {
    /// Reads the header at the start of `bytes`. Comments may hold any bytes, and lines may be indented.
    ///
    /// # Errors
    /// What is wrong with the header.
    pub fn parse(bytes: &[u8]) -> Result<Self, PlyError> {
        if bytes.starts_with(b"ply\r") && bytes.get(4) != Some(&b'\n') {
            return Err(PlyError::CarriageReturns);
        }
        let (mut encoding, mut elements, mut comments) = (None, Vec::<Element>::new(), Vec::new());
        let (mut offset, mut line) = (0, 0);
        while offset < bytes.len() {
            line += 1;
            let rest = &bytes[offset..];
            let length = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
            offset += (length + 1).min(rest.len());
            let text = String::from_utf8_lossy(&rest[..length]);
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            let refuse = |due| Err(PlyError::Header { line, found: quoted(text.trim()), due });
            match (line, &words[..]) {
                (1, ["ply"]) => {}
                (1, _) => return Err(PlyError::NoPly(quoted(text.trim()))),
                (_, ["comment", rest @ ..]) => comments.push(Comment { line, text: rest.join(" ") }),
                (_, [] | ["obj_info", ..]) => {}
                (_, ["format", name, "1.0"]) => {
                    encoding = Some(match *name {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return refuse("a format is ascii, binary_little_endian or binary_big_endian"),
                    });
                }
                (_, ["format", ..]) => return refuse("the format has the version 1.0"),
                (_, ["element", name, rows]) => {
                    let Ok(rows) = rows.parse() else { return refuse("an element needs a number of rows") };
                    elements.push(Element { name: (*name).to_owned(), rows, properties: Vec::new() });
                }
                (_, ["property", rest @ ..]) => {
                    let (count, scalar, name) = match rest {
                        ["list", count, scalar, name] => (Some(*count), scalar, name),
                        [scalar, name] => (None, scalar, name),
                        _ => return refuse("a property is a type and a name, or a list"),
                    };
                    let count = count.map(Scalar::of_name);
                    let (None | Some(Some(_)), Some(scalar)) = (count, Scalar::of_name(scalar)) else {
                        return refuse("a property has a number type of PLY, such as `float`");
                    };
                    let Some(element) = elements.last_mut() else {
                        return refuse("a property stands behind its element");
                    };
                    let (name, count) = ((*name).to_owned(), count.flatten());
                    element.properties.push(Property { name, count, scalar });
                }
                (_, ["end_header"]) => {
                    let Some(encoding) = encoding else { return refuse("the header has no `format`") };
                    check_counts(&elements, encoding, bytes.len() - offset)?;
                    return Ok(Self { encoding, elements, comments, data_offset: offset });
                }
                _ => return refuse("a line of a PLY header is another"),
            }
        }
        Err(PlyError::NoEnd { lines: line })
    }
}

/// Refuses elements with more rows than `bytes` of data can hold.
fn check_counts(elements: &[Element], encoding: Encoding, bytes: usize) -> Result<(), PlyError> {
    for element in elements {
        let least = element.least(encoding);
        // Rows without bytes would end at their count alone.
        let most = (bytes + 1).checked_div(least).unwrap_or(0).min(MOST_ROWS);
        let is_vertex = element.name == "vertex";
        if element.rows > most && (is_vertex || element.rows > MOST_ROWS || least == 0) {
            let most = if is_vertex { most } else { most.min(MOST_ROWS) };
            return Err(PlyError::TooMany { element: quoted(&element.name), count: element.rows, most });
        }
    }
    Ok(())
}
