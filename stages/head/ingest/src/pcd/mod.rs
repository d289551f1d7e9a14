//! Point cloud files (PCD 0.7): bytes in, organised points out.
//!
//! - `header`: the text that describes the records.
//! - `body`: records to points, for the three encodings.
//! - `lzf`: the compression of `binary_compressed`.
//! - `write`: ascii and binary files from points.
//! - `error`: everything that can be wrong with a file.

mod body;
mod error;
mod header;
mod lzf;
mod write;

pub use body::{PcdCloud, read};
pub use error::PcdError;
pub use header::{Encoding, Field, FieldType, PcdHeader};
pub use write::{write_ascii, write_binary};
