//! Point clouds in PLY files (Turk 1994), text or binary: the vertices, without their other properties and their faces.
//!
//! - `header`: the text that describes the elements
//! - `body`: the rows of the elements
//! - `error`: everything that can be wrong with a file

mod body;
mod error;
mod header;

pub use error::PlyError;

/// The most vertices that are read; more are refused before memory is taken for them.
pub const MAX_POINTS: usize = 1 << 24;

/// Reads the vertices of a file, in the unit of the file. Those without a measurement are
/// [`INVALID_POINT`](crate::INVALID_POINT).
///
/// # Errors
/// What is wrong with the file, and where.
///
/// ```
/// let file = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
///              0.1 -0.2 0.9\n";
/// assert_eq!(stillpoint_ingest::ply::read(file)?, [[0.1, -0.2, 0.9]]);
/// # Ok::<(), stillpoint_ingest::ply::PlyError>(())
/// ```
pub fn read(bytes: &[u8]) -> Result<Vec<[f32; 3]>, PlyError> {
    let header = header::Header::parse(bytes)?;
    body::vertices(&header, &bytes[header.data_offset..])
}
