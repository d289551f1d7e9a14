//! A patient: images, structures, prescription, and the file that holds them.
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use stillpoint_patient::case;
//! let imported = case::import_described(std::path::Path::new("pelvis_000.json"), &case::NameTable::shipped()?)?;
//! case::write(&imported.case, std::path::Path::new("pelvis_000.case"))?;
//! let again = case::read(std::path::Path::new("pelvis_000.case"))?;
//! assert_eq!(case::content_hash(&again)?, case::content_hash(&imported.case)?);
//! # Ok(()) }
//! ```
//!
//! - `patient`: a case and the rules that make one
//! - `structure`: structures and their roles
//! - `position`: how the patient lies on the couch
//! - `mask`: which voxels belong to a structure
//! - `uid`: the identifiers that a case keeps
//! - `file`: the case file and its hash
//! - `nrrd`: volumes from NRRD files
//! - `described`: NRRD volumes with the JSON beside them, to a case
//! - `names`: the table that structure names are matched by
//! - `phantom`: the project's own pelvis (ordinary or varied), head, head and neck, and chest, made from a seed
//! - [`intake`]: what every reader asks of images and structures before they become a case
//! - `inflate`: decompression that a hostile file cannot make large

mod described;
mod file;
mod inflate;
pub mod intake;
mod mask;
mod names;
mod nrrd;
mod patient;
mod phantom;
mod position;
mod structure;
mod uid;

pub use described::{DescribedError, Disagreement, Imported, import_described, import_described_as};
pub use file::{CaseFileError, ContentHash, content_hash, from_bytes, read, to_bytes, write};
pub use inflate::InflateError;
pub use mask::Mask;
pub use names::{NameTable, NamesError, StandardName, name_fits};
pub use nrrd::{NrrdError, Values, Volume, read_nrrd};
pub use patient::{Case, CaseError, CaseParts, Prescription};
pub use phantom::{HEAD_SPACING_MM, HEAD_SPACINGS_MM, Skin, head, lung, neck, phantom, varied_phantom};
pub use position::PatientPosition;
pub use structure::{Role, Structure};
pub use uid::{Uid, UidError, Uids};
