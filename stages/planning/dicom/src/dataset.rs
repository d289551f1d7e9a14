//! The data set in a file's bytes.

use dicom_object::InMemDicomObject;
use dicom_transfer_syntax_registry::entries::{EXPLICIT_VR_LITTLE_ENDIAN, IMPLICIT_VR_LITTLE_ENDIAN};
use thiserror::Error;

use crate::element::TagError;
use crate::layout::{Encoding, LayoutError, layout};
use crate::repertoire::Repertoire;

/// A data set, and how its pixels are written.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSet {
    /// Its elements.
    pub object: InMemDicomObject,
    /// The transfer syntax, where the pixels are compressed.
    pub compressed: Option<String>,
}

/// Why bytes are not what they should be.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ReadError {
    /// They are no data set.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The parser refuses them.
    #[error("{0}: the file is damaged, or written wrongly; export it again")]
    Parser(String),
    /// A tag is missing or cannot be used.
    #[error(transparent)]
    Tag(#[from] TagError),
}

impl DataSet {
    /// The data set in these bytes of a file, with or without file meta information.
    pub fn read(bytes: &[u8]) -> Result<Self, ReadError> {
        let layout = layout(bytes)?;
        let syntax = match layout.encoding {
            Encoding::Implicit => IMPLICIT_VR_LITTLE_ENDIAN.erased(),
            Encoding::Explicit => EXPLICIT_VR_LITTLE_ENDIAN.erased(),
        };
        let parse = |bytes: &[u8]| InMemDicomObject::read_dataset_with_ts(bytes, &syntax).map_err(chain);
        let named = layout.character_set.unwrap_or(0..0);
        let object = match Repertoire::of(&String::from_utf8_lossy(&bytes[named.clone()])) {
            None => parse(&bytes[layout.start..])?,
            Some(repertoire) => {
                let mut unnamed = bytes.to_vec();
                unnamed[named].fill(b' ');
                repertoire.decode(parse(&unnamed[layout.start..])?)
            }
        };
        Ok(Self { object, compressed: layout.compressed })
    }
}

/// All causes in one sentence: the innermost names the tag.
fn chain(error: dicom_object::ReadError) -> ReadError {
    let mut why = error.to_string();
    let mut cause = std::error::Error::source(&error);
    while let Some(inner) = cause {
        why = format!("{why}: {inner}");
        cause = inner.source();
    }
    ReadError::Parser(why)
}
