//! Point clouds in PLY files (Turk 1994), text or binary: the vertices, without their other properties and their faces.

use stillpoint_patient::ply::{Ply, PlyError as Fault};
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
    let mut ply = Ply::open(bytes)?;
    for element in &ply.elements.clone() {
        // A row takes a byte at least.
        let most = bytes.len().min(MAX_POINTS);
        if element.count > most {
            return Err(PlyError::TooMany { element: element.name.clone(), count: element.count, most });
        }
        if element.name != "vertex" {
            ply.rows(element, |_, _| Ok::<_, PlyError>(()))?;
            continue;
        }
        let place = |axis: &str| element.properties.iter().position(|p| p.name == axis);
        let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(place) else {
            return Err(PlyError::NoVertices);
        };
        if let Some(list) =
            [x, y, z].map(|place| &element.properties[place]).into_iter().find(|p| p.is_list())
        {
            let why =
                format!("the property `{}` of `vertex` is a list; a coordinate is one number", list.name);
            return Err(PlyError::Unreadable(why));
        }
        let mut points = Vec::new();
        ply.rows(element, |_, cells| {
            let point = [x, y, z].map(|place| cells[place][0].single);
            points.push(if point.iter().all(|c| c.is_finite()) { point } else { INVALID_POINT });
            Ok::<_, PlyError>(())
        })?;
        return Ok(points);
    }
    Err(PlyError::NoVertices)
}

impl From<Fault> for PlyError {
    fn from(fault: Fault) -> Self {
        Self::Unreadable(fault.to_string())
    }
}
