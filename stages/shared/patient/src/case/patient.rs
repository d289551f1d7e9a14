//! A case and the rules that make one.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::names::name_fits;
use super::position::PatientPosition;
use super::structure::{Role, Structure};
use super::uid::Uids;
use crate::Grid;

/// Longest name of a case or a structure, in characters: DICOM's long string.
const LONGEST_NAME: usize = 64;
/// What a name is of.
const CASE: &str = "case";
/// Voxel numbers are rows of the dose matrix, which are 32 bits.
const MOST_VOXELS: usize = u32::MAX as usize;

/// The dose that one target is to have, over all fractions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prescription {
    /// Name of the target.
    pub structure: String,
    /// Dose, gray.
    pub dose_gy: f64,
}

/// What a case is made of; [`Case::new`] checks it.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseParts {
    /// Name of the case. Never a patient's.
    pub name: String,
    /// Where the voxels are, in the DICOM patient frame, mm.
    pub grid: Grid,
    /// CT in Hounsfield units, in the order of the grid.
    pub hu: Vec<i16>,
    /// Structures; they may overlap.
    pub structures: Vec<Structure>,
    /// Isocentre, mm; `None` is the centroid of the targets with a prescription, or of all targets where none has one.
    pub isocentre_mm: Option<[f64; 3]>,
    /// Doses of the targets; may be empty.
    pub prescription: Vec<Prescription>,
    /// Number of fractions, where it is known.
    pub fractions: Option<u32>,
    /// A dose that came with the case, gray, in the order of the grid.
    pub reference_dose_gy: Option<Vec<f32>>,
    /// Identifiers of the DICOM data behind it, if any.
    pub uids: Option<Uids>,
    /// Where it comes from, for people.
    pub provenance: String,
}

/// A patient, ready to plan: what it holds fits together.
///
/// Positions are millimetres in the DICOM patient frame (x to the left, y to the back, z to the head), however the patient
/// lies. It holds no name, ID or birth date of a person.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    parts: CaseParts,
    isocentre_mm: [f64; 3],
    position: PatientPosition,
}

/// Why parts make no case.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CaseError {
    /// A name is empty, long, or holds characters that are no text.
    #[error(
        "{name:?} is not a name for a {what}: give 1 to {LONGEST_NAME} characters of printable text{}", if *what == CASE { " without slashes" } else { "" }
    )]
    Name {
        /// Case or structure.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// The grid cannot be planned on.
    #[error(
        "a grid of {counts:?} voxels, spacing {spacing_mm:?} mm, origin {origin_mm:?} mm cannot be: {why}"
    )]
    Grid {
        /// Voxels.
        counts: [usize; 3],
        /// Spacing.
        spacing_mm: [f64; 3],
        /// Origin.
        origin_mm: [f64; 3],
        /// Description of the fault.
        why: &'static str,
    },
    /// A volume has another number of values than the grid has voxels.
    #[error("{what} has {found} values, but the grid has {expected} voxels")]
    Length {
        /// Name of the volume.
        what: String,
        /// Voxels of the grid.
        expected: usize,
        /// Values found.
        found: usize,
    },
    /// Two structures have one name.
    #[error("two structures are named {0:?}: rename one")]
    TwiceNamed(String),
    /// More than one outline of the patient.
    #[error(
        "{first:?} and {second:?} are both outlines of the patient: give one of them another role by a names table (`--names`)"
    )]
    TwoOutlines {
        /// The first of the two.
        first: String,
        /// The second of the two.
        second: String,
    },
    /// No voxel of any target, and no isocentre.
    #[error(
        "no structure is a target with voxels, so there is no isocentre: name the target in a names table, or give the isocentre"
    )]
    NoTarget,
    /// The isocentre is outside the images.
    #[error("the isocentre {0:?} mm is outside the images")]
    Isocentre([f64; 3]),
    /// A prescription cannot be.
    #[error("a prescription of {dose_gy} Gy to {structure:?} cannot be: {why}")]
    Prescription {
        /// The structure.
        structure: String,
        /// Its dose.
        dose_gy: f64,
        /// Description of the fault.
        why: String,
    },
    /// The number of fractions cannot be.
    #[error("{0} fractions cannot be: give 1 to 100")]
    Fractions(u32),
    /// A value of the reference dose is negative or not finite.
    #[error("the reference dose is {value} Gy at voxel {voxel:?}: doses are finite and not negative")]
    Dose {
        /// The voxel.
        voxel: [usize; 3],
        /// Its dose.
        value: f32,
    },
}

impl Case {
    /// The case of these parts, if they fit together. The patient lies head first and supine.
    pub fn new(parts: CaseParts) -> Result<Self, CaseError> {
        name(CASE, &parts.name)?;
        check_grid(&parts.grid)?;
        let voxels = parts.grid.len();
        let length = |what: &str, found| match found == voxels {
            true => Ok(()),
            false => Err(CaseError::Length { what: what.to_owned(), expected: voxels, found }),
        };
        length("the CT", parts.hu.len())?;
        check_structures(&parts.structures, length)?;
        check_prescription(&parts)?;
        if let Some(dose) = &parts.reference_dose_gy {
            length("the reference dose", dose.len())?;
            if let Some(index) = dose.iter().position(|d| !(d.is_finite() && *d >= 0.0)) {
                return Err(CaseError::Dose { voxel: parts.grid.voxel(index), value: dose[index] });
            }
        }
        let isocentre_mm = match parts.isocentre_mm {
            Some(given) => given,
            None => centroid_of_targets(&parts).ok_or(CaseError::NoTarget)?,
        };
        let inside = |axis: usize| {
            let low = parts.grid.origin_mm[axis];
            let high = low + (parts.grid.counts[axis] - 1) as f64 * parts.grid.spacing_mm[axis];
            (low..=high).contains(&isocentre_mm[axis])
        };
        if !(0..3).all(inside) {
            return Err(CaseError::Isocentre(isocentre_mm));
        }
        Ok(Self { parts, isocentre_mm, position: PatientPosition::default() })
    }

    /// The same case of a patient who lies like this.
    pub fn lying(self, position: PatientPosition) -> Self {
        Self { position, ..self }
    }

    /// How the patient lies on the couch.
    pub fn position(&self) -> PatientPosition {
        self.position
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.parts.name
    }

    /// Where its voxels are.
    pub fn grid(&self) -> &Grid {
        &self.parts.grid
    }

    /// CT, Hounsfield units.
    pub fn hu(&self) -> &[i16] {
        &self.parts.hu
    }

    /// All structures.
    pub fn structures(&self) -> &[Structure] {
        &self.parts.structures
    }

    /// The structure of this name.
    pub fn structure(&self, name: &str) -> Option<&Structure> {
        self.parts.structures.iter().find(|s| s.name == name)
    }

    /// Whether it is a pelvis: it has a rectum or a bladder.
    pub fn is_pelvis(&self) -> bool {
        ["Rectum", "Bladder"].into_iter().any(|name| self.structure(name).is_some())
    }

    /// Whether it is a head or a neck: it has an eye, a brainstem, a parotid gland, or a larynx.
    pub fn is_head_or_neck(&self) -> bool {
        let names = ["Parotid*", "*Parotid", "Brainstem", "Larynx", "Eye_L", "Eye_R"];
        let here = |s: &Structure| names.iter().any(|pattern| name_fits(pattern, &s.name));
        self.parts.structures.iter().any(here)
    }

    /// The targets.
    pub fn targets(&self) -> impl Iterator<Item = &Structure> {
        self.parts.structures.iter().filter(|s| s.role == Role::Target)
    }

    /// The outline of the patient.
    pub fn external(&self) -> Option<&Structure> {
        self.parts.structures.iter().find(|s| s.role == Role::External)
    }

    /// Isocentre, mm.
    pub fn isocentre_mm(&self) -> [f64; 3] {
        self.isocentre_mm
    }

    /// Doses of the targets over all fractions.
    pub fn prescription(&self) -> &[Prescription] {
        &self.parts.prescription
    }

    /// Number of fractions, where it is known.
    pub fn fractions(&self) -> Option<u32> {
        self.parts.fractions
    }

    /// A dose that came with the case, gray.
    pub fn reference_dose_gy(&self) -> Option<&[f32]> {
        self.parts.reference_dose_gy.as_deref()
    }

    /// Identifiers of the DICOM data behind it.
    pub fn uids(&self) -> Option<&Uids> {
        self.parts.uids.as_ref()
    }

    /// Where it comes from, for people.
    pub fn provenance(&self) -> &str {
        &self.parts.provenance
    }

    /// Volume of a structure, cm3.
    pub fn volume_cm3(&self, structure: &Structure) -> f64 {
        let voxel_mm3: f64 = self.parts.grid.spacing_mm.iter().product();
        structure.mask.count() as f64 * voxel_mm3 / 1000.0
    }
}

fn name(what: &'static str, name: &str) -> Result<(), CaseError> {
    // The name of a case becomes that of a folder; those of structures stay text.
    let is_slash = |c: char| what == CASE && (c == '/' || c == '\\');
    let text = name.trim() == name && !name.chars().any(|c| c.is_control() || is_slash(c));
    match text && (1..=LONGEST_NAME).contains(&name.chars().count()) {
        true => Ok(()),
        false => Err(CaseError::Name { what, name: name.chars().take(80).collect() }),
    }
}

/// Whether voxels can be numbered and placed on this grid.
pub(crate) fn check_grid(grid: &Grid) -> Result<(), CaseError> {
    let fault = |why| {
        let Grid { counts, spacing_mm, origin_mm } = *grid;
        Err(CaseError::Grid { counts, spacing_mm, origin_mm, why })
    };
    let voxels = grid.counts.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
    if voxels.is_none_or(|v| v == 0 || v > MOST_VOXELS) {
        return fault("it needs 1 to 4294967295 voxels");
    }
    if !grid.spacing_mm.iter().all(|s| (0.01..=100.0).contains(s)) {
        return fault("its spacing must be 0.01 mm to 100 mm");
    }
    if !grid.origin_mm.iter().all(|o| o.abs() <= 1e5) {
        return fault("its origin must be within 100 m");
    }
    Ok(())
}

fn check_structures(
    structures: &[Structure],
    length: impl Fn(&str, usize) -> Result<(), CaseError>,
) -> Result<(), CaseError> {
    let mut seen = BTreeSet::new();
    let mut outline: Option<&Structure> = None;
    for structure in structures {
        name("structure", &structure.name)?;
        length(&structure.name, structure.mask.len())?;
        if !seen.insert(&structure.name) {
            return Err(CaseError::TwiceNamed(structure.name.clone()));
        }
        if structure.role == Role::External
            && let Some(first) = outline.replace(structure)
        {
            let (first, second) = (first.name.clone(), structure.name.clone());
            return Err(CaseError::TwoOutlines { first, second });
        }
    }
    Ok(())
}

fn check_prescription(parts: &CaseParts) -> Result<(), CaseError> {
    let mut seen = BTreeSet::new();
    for Prescription { structure, dose_gy } in &parts.prescription {
        let fault = |why: String| {
            let (structure, dose_gy) = (structure.clone(), *dose_gy);
            Err(CaseError::Prescription { structure, dose_gy, why })
        };
        match parts.structures.iter().find(|s| &s.name == structure) {
            None => {
                let targets = parts.structures.iter().filter(|s| s.role == Role::Target);
                let names: Vec<_> = targets.map(|s| s.name.as_str()).collect();
                let allowed = if names.is_empty() { "no structure".to_owned() } else { names.join(", ") };
                return fault(format!("the case has no structure of that name (targets: {allowed})"));
            }
            Some(s) if s.role != Role::Target => {
                return fault(format!(
                    "the structure is not a target (its role is {}): make it one by a names table (`--names`), like {{\"structures\": [{{\"role\": \"target\", \"match\": [{structure:?}]}}]}}",
                    s.role.word()
                ));
            }
            Some(_) => {}
        }
        if !(*dose_gy > 0.0 && *dose_gy <= 200.0) {
            return fault("a course is more than 0 Gy and at most 200 Gy".to_owned());
        }
        if !seen.insert(structure) {
            return fault("the structure has another dose already".to_owned());
        }
    }
    match parts.fractions {
        Some(n) if !(1..=100).contains(&n) => Err(CaseError::Fractions(n)),
        _ => Ok(()),
    }
}

/// Mean position of the voxels that belong to any target, each counted once, mm. Where doses are prescribed, the targets are
/// those that have one: helpers of the type PTV do not move it.
fn centroid_of_targets(CaseParts { grid, structures, prescription, .. }: &CaseParts) -> Option<[f64; 3]> {
    let counts =
        |s: &Structure| prescription.is_empty() || prescription.iter().any(|p| p.structure == s.name);
    let targets: Vec<_> = structures.iter().filter(|s| s.role == Role::Target && counts(s)).collect();
    let mut sum = [0_u64; 3];
    let mut count = 0_u64;
    for (place, target) in targets.iter().enumerate() {
        for index in target.mask.indices() {
            if targets[..place].iter().any(|earlier| earlier.mask.contains(index)) {
                continue;
            }
            count += 1;
            for (total, voxel) in sum.iter_mut().zip(grid.voxel(index)) {
                *total += voxel as u64;
            }
        }
    }
    let mean = |axis: usize| grid.origin_mm[axis] + grid.spacing_mm[axis] * (sum[axis] as f64 / count as f64);
    (count > 0).then(|| std::array::from_fn(mean))
}
