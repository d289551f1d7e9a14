//! Whose plan it is, read again at export and never kept.
//!
//! A case holds no name, ID or birth date. Where an exported plan must carry them, they are read from the DICOM files
//! that the case came from, which must be of the case's study, and go into the exported files alone.

use std::fmt;
use std::path::Path;

use dicom_dictionary_std::tags;
use stillpoint_patient::case::Uids;

use crate::dataset::ReadError;
use crate::element::{text_if_any, uid};
use crate::find::{files, open};
use crate::import::ImportError;
use crate::layout::LayoutError;

/// Whose plan it is.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct CaseIdentity {
    pub(crate) retained: Option<StoredIdentity>,
}

#[derive(Clone, Default, PartialEq, Eq)]
pub(crate) struct StoredIdentity {
    pub name: String,
    pub id: String,
    pub birth_date: String,
    pub sex: String,
}

/// Says whether there is an identity, never which.
impl fmt::Debug for CaseIdentity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.retained.is_some() { "Identity(kept)" } else { "Identity(none)" })
    }
}

impl CaseIdentity {
    /// Nobody's: name, ID and birth date stay empty.
    pub fn none() -> Self {
        Self::default()
    }

    /// That in the source files of a case: the first file in `folder` that is of the case's study.
    pub fn read_stored(folder: &Path, case: &Uids) -> Result<Self, ImportError> {
        for path in files(folder)? {
            let data = match open(&path) {
                Err(ImportError::Read { source: ReadError::Layout(LayoutError::NotDicom), .. }) => continue,
                opened => opened?,
            };
            if uid(&data.object, tags::STUDY_INSTANCE_UID).ok().as_ref() != Some(&case.study) {
                continue;
            }
            let text = |tag| {
                let found = text_if_any(&data.object, tag);
                found
                    .map(Option::unwrap_or_default)
                    .map_err(|source| ImportError::Read { path: path.clone(), source: source.into() })
            };
            return Ok(Self {
                retained: Some(StoredIdentity {
                    name: text(tags::PATIENT_NAME)?,
                    id: text(tags::PATIENT_ID)?,
                    birth_date: text(tags::PATIENT_BIRTH_DATE)?,
                    sex: text(tags::PATIENT_SEX)?,
                }),
            });
        }
        Err(ImportError::OtherStudy { folder: folder.to_owned(), study: case.study.clone() })
    }
}
