//! The sections of a report, in their order. To add one, add a file with a function from the source to a section, and
//! a line in [`ALL`].

mod actuation;
mod alignment;
mod confidence;
mod consistency;
mod contacts;
mod contracts;
mod controllers;
mod diagnostics;
mod duties;
mod errors;
mod faults;
mod filters;
mod gate;
mod ledger;
mod operators;
mod provenance;
mod segmentation;
mod sensors;
mod stages;
mod summary;
mod targets;
mod topics;
mod trace;
mod tracks;

use super::page::Section;
use super::source::Source;
use crate::ReportError;

/// A section out of what was read.
type Make = fn(&Source<'_>) -> Result<Section, ReportError>;

/// All sections, from the top of the page to its end.
pub const ALL: &[Make] = &[
    summary::section,
    tracks::section,
    errors::section,
    filters::section,
    consistency::section,
    sensors::section,
    targets::section,
    controllers::section,
    duties::section,
    actuation::section,
    contacts::section,
    gate::section,
    segmentation::section,
    alignment::section,
    confidence::section,
    operators::section,
    trace::section,
    contracts::section,
    stages::section,
    diagnostics::section,
    ledger::section,
    faults::section,
    topics::section,
    provenance::section,
];
