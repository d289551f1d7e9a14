//! DICOM in and out: CT and RTSTRUCT to cases, RTPLAN, RTDOSE and RTSTRUCT of plans.
//!
//! Read: single-frame axial CT, little endian, uncompressed or compressed without loss, of patients head or feet first, supine
//! or prone; structure sets of closed planar contours. What differs is refused with the file and the tag. No patient's
//! name, ID or birth date enters a case; UIDs do.
//!
//! - `layout`: whether a file's lengths hold together, before a parser trusts them
//! - `dataset`: the data set in a file's bytes
//! - `repertoire`: texts in character sets that switch or hold backslashes
//! - `element`: typed values of tags, with errors that name the tag
//! - `pixels`: the stored words of an image, uncompressed or compressed without loss
//! - `slice`: one CT image
//! - `series`: CT images to a volume
//! - `stack`: images that are unevenly spaced or tilted, resampled across the patient
//! - `roi`: the contours of a structure set
//! - `names`: names of regions as names of structures
//! - `property`: density overrides, boluses and couches
//! - `raster`: contours to masks
//! - `import_messages`: what is said of a structure whose voxels are not plainly its contours
//! - `cut`: structures that the end of the images cuts
//! - `find`: the images and structure sets in a folder
//! - `import`: a folder to a case
//! - `identity`: whose plan it is, read again at export and never kept
//! - `write`: what RTPLAN, RTDOSE and RTSTRUCT share
//! - `treatment`: RTPLAN of any program, read; `given_dose`: RTDOSE, read
//! - `plan`: RTPLAN
//! - `dose`: RTDOSE
//! - `structures`: RTSTRUCT, by the `outlines` of masks

#![forbid(unsafe_code)]

mod cut;
mod dataset;
mod dose;
mod element;
mod find;
mod given_dose;
mod identity;
mod import;
mod import_messages;
mod layout;
mod names;
mod outlines;
mod pixels;
mod plan;
mod property;
mod raster;
mod repertoire;
mod roi;
mod series;
mod slice;
mod stack;
mod structures;
mod treatment;
mod write;

pub use dataset::{DataSet, ReadError};
pub use dose::{PlannedDose, dose_file};
pub use element::TagError;
pub use given_dose::GivenDose;
pub use identity::CaseIdentity;
pub use import::{ImportError, Request, import_folder};
pub use layout::LayoutError;
pub use plan::{Arc, ArcPoint, Beam, LeafSegment, Machine, Plan, plan_file};
pub use raster::{Beyond, Contour, ContourKind, Drawn, Rastered, rasterise};
pub use roi::{Roi, Rois};
pub use series::{SeriesError, Volume, volume};
pub use slice::{Reading, Slice};
pub use stack::Stack;
pub use structures::structure_file;
pub use treatment::{ControlPoint, Leaves, TreatmentBeam, TreatmentPlan};
pub use write::{Export, ExportError, Exported, uids_of};
