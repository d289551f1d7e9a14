//! What every reader of patients asks of images and structures before they become a case.
//!
//! A file can be well formed and still describe no patient: a scale of Hounsfield units that is off by 1024, an outline that
//! is a shell, a target outside of the outline. Readers of all formats call [`settle`], so that all of them say and refuse the
//! same.
//!
//! - `outline`: one outline, whole, made from the CT where none is drawn
//! - `hounsfield`: whether the scale of Hounsfield units is a patient's

mod hounsfield;
mod outline;

use thiserror::Error;

use super::structure::{Role, Structure};
use crate::Grid;

/// Whether Hounsfield units that no patient has are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// They are refused.
    #[default]
    OfPatients,
    /// They are taken and reported: a phantom of other materials.
    Any,
}

/// Why images and structures are no patient.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum IntakeError {
    /// The scale of Hounsfield units is off.
    #[error(
        "implausible Hounsfield units: most of the body has about {body_hu} HU (allowed: -200 to 200, as water has 0){}: correct the rescale intercept of the images, or accept the values of a phantom by `--any-hounsfield`",
        air(*air_hu)
    )]
    Scale {
        /// The most frequent value in the body.
        body_hu: i32,
        /// The most frequent value outside of it.
        air_hu: Option<i32>,
    },
    /// There is no outline, and none can be made.
    #[error(
        "no structure is the outline of the patient, and the images hold no body: the largest region above {above_hu} HU has {found_cm3:.2} cm3; give a structure of the type EXTERNAL"
    )]
    NoBody {
        /// Least value of tissue.
        above_hu: i16,
        /// Size of the largest region.
        found_cm3: f64,
    },
}

fn air(hu: Option<i32>) -> String {
    hu.map_or_else(String::new, |hu| format!(", and what is around it about {hu} HU (air has -1000)"))
}

/// Leaves one whole outline among the structures, and says what a plan on them would not show.
pub fn settle(
    grid: &Grid,
    hu: &[i16],
    structures: &mut Vec<Structure>,
    scale: Scale,
    notes: &mut Vec<String>,
) -> Result<(), IntakeError> {
    outline::one(grid, structures, notes);
    outline::whole(grid, hu, structures, notes);
    let drawn = structures.iter().find(|s| s.role == Role::External).map(|s| &s.mask);
    hounsfield::check(grid, hu, drawn, scale, notes)?;
    outline::made(grid, hu, structures, notes)?;
    outline::leaving(grid, structures, notes);
    Ok(())
}
