//! PLY files (Turk 1994), text or binary: the header, and the rows of each element. Meshes and point clouds are read
//! through it.
//!
//! - `header`: the text that describes the elements
//! - `rows`: the rows of the elements, in order
//! - `error`: everything that can be wrong with a file
//!
//! ```
//! use stillpoint_patient::ply::{Ply, PlyError};
//!
//! let file = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
//!              0.5 -0.25 1\n";
//! let mut ply = Ply::open(file)?;
//! let vertex = ply.elements()[0].clone();
//! let axes = vertex.axes().ok_or(PlyError::NoVertices)?;
//! let mut points = Vec::new();
//! ply.rows::<PlyError>(&vertex, &axes, |_, cells| {
//!     points.push([0, 1, 2].map(|axis: usize| cells[axis][0].double));
//!     Ok(())
//! })?;
//! ply.end()?;
//! assert_eq!(points, [[0.5, -0.25, 1.0]]);
//! # Ok::<(), PlyError>(())
//! ```

mod error;
mod header;
mod rows;

pub use error::PlyError;
pub use header::{Comment, Element, Encoding, Property, Scalar};
pub use rows::{Cell, Ply, Value};

/// The most rows of an element that are read; more are refused before memory is taken for them.
pub const MOST_ROWS: usize = 1 << 24;

/// Whether bytes begin as a PLY file does.
#[must_use]
pub fn is_ply(bytes: &[u8]) -> bool {
    bytes.trim_ascii_start().starts_with(b"ply")
}
