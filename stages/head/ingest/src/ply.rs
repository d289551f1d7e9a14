//! Point clouds in PLY files (Turk 1994), text or binary: the vertices, without their other properties and their faces.

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use thiserror::Error;

use crate::INVALID_POINT;

/// The most vertices that are read; more are refused before memory is taken for them.
pub const MAX_POINTS: usize = 1 << 24;

/// Why a file gives no cloud.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PlyError {
    /// It is no PLY file, or damaged.
    #[error("it is not a readable PLY: {0}")]
    Unreadable(String),
    /// It has no vertices.
    #[error("it has no element `vertex` with the properties x, y and z")]
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
}

/// Reads the vertices of a file, in the unit of the file. Those that are not finite are [`INVALID_POINT`].
///
/// # Errors
/// What is wrong with the file.
pub fn read(bytes: &[u8]) -> Result<Vec<[f32; 3]>, PlyError> {
    let unreadable = |e: ply_rs_bw::parser::ParseError| {
        // It comes in several lines.
        let words: Vec<String> = e.to_string().split_whitespace().map(str::to_owned).collect();
        PlyError::Unreadable(words.join(" "))
    };
    let mut reader = Reader::new(bytes);
    let vertices = Parser::<Vertex>::new();
    let header = vertices.read_header(&mut reader).map_err(unreadable)?;
    for (name, element) in &header.elements {
        // A row takes a byte at least, and one without properties none: its reading would end at its count alone.
        let most = if element.properties.is_empty() { 0 } else { bytes.len().min(MAX_POINTS) };
        if element.count > most {
            return Err(PlyError::TooMany { element: name.clone(), count: element.count, most });
        }
        if name != "vertex" {
            let skipped = Parser::<Skipped>::new().read_payload_for_element(&mut reader, element, &header);
            skipped.map_err(unreadable)?;
            continue;
        }
        if !["x", "y", "z"].iter().all(|axis| element.properties.contains_key(*axis)) {
            return Err(PlyError::NoVertices);
        }
        let found = vertices.read_payload_for_element(&mut reader, element, &header).map_err(unreadable)?;
        let valid = |Vertex(point): Vertex| match point.iter().all(|c| c.is_finite()) {
            true => point,
            false => INVALID_POINT,
        };
        return Ok(found.into_iter().map(valid).collect());
    }
    Err(PlyError::NoVertices)
}

/// The coordinates of a vertex.
struct Vertex([f32; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([f32::NAN; 3])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) else {
            return PropertyAccessResult::Ignored;
        };
        self.0[axis] = match property {
            Property::Float(value) => value,
            Property::Double(value) => value as f32,
            Property::Char(value) => f32::from(value),
            Property::UChar(value) => f32::from(value),
            Property::Short(value) => f32::from(value),
            Property::UShort(value) => f32::from(value),
            Property::Int(value) => value as f32,
            Property::UInt(value) => value as f32,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// A row of another element.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
