//! DICOM in and out.

#![allow(clippy::unwrap_used, clippy::panic)]

mod arc;
mod compressed;
mod export;
mod fixture;
mod import;
mod planning_data;
mod raster;
mod reading;
mod resample;
mod treatment;
mod volumes;
