//! A plan that is compared: its plan.json, with what a comparison needs of it.

use std::path::{Path, PathBuf};

use stillpoint_plan::plan_file::{PlanFile, PlanFileCase, PlanFileFigures};
use stillpoint_plan::protocol::Judged;

use crate::commands::plan::request::plan_at;
use crate::exit::Failure;

/// A plan that is compared.
#[derive(Debug)]
pub struct Compared {
    /// The file.
    pub path: PathBuf,
    /// Its content.
    pub file: PlanFile,
}

impl Compared {
    /// Reads a plan.json, or that of a folder.
    pub fn read(path: &Path) -> Result<Self, Failure> {
        let (path, file) = plan_at(path)?;
        let fault = |why: &dyn std::fmt::Display| Failure::wrong(format!("{}: {why}", path.display()));
        if file.prescription.is_empty() {
            return Err(fault(
                &"the plan has no prescription; import its case with --prescribe and plan it again",
            ));
        }
        if file.shown().histograms.is_empty() {
            return Err(fault(
                &"the plan has no histograms; an older build wrote it, so plan the case again",
            ));
        }
        Ok(Self { path, file })
    }

    /// Its case.
    pub fn case(&self) -> &PlanFileCase {
        &self.file.case
    }

    /// Figures of the segments where there are some, of the planned fluence otherwise.
    pub fn shown(&self) -> &PlanFileFigures {
        self.file.shown()
    }

    /// The limits of those figures.
    pub fn limits(&self) -> &[Judged] {
        self.file.limits()
    }
}
