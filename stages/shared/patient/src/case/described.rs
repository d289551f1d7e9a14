//! NRRD volumes with the JSON beside them, to a case.
//!
//! The JSON names the volumes, gives the meaning of the bits of the labels, and repeats the grid. If JSON and volumes
//! state the same thing, they must agree.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use thiserror::Error;

use super::mask::Mask;
use super::names::NameTable;
use super::nrrd::{NrrdError, Values, Volume, read_nrrd};
use super::patient::{Case, CaseError, CaseParts, Prescription};
use super::structure::{Role, Structure};
use crate::Grid;

/// How far two ways to write one position may lie apart, mm.
const SAME_MM: f64 = 1e-3;

/// A case, and what the reader has to say about how it came to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The case.
    pub case: Case,
    /// What was left out or renamed, a sentence each.
    pub notes: Vec<String>,
}

/// Why files make no case.
#[derive(Debug, Error)]
pub enum DescribedError {
    /// A file cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The JSON is no description of a case.
    #[error("{}: this JSON does not describe a case: {source}", path.display())]
    Json {
        /// Path of the file.
        path: PathBuf,
        /// The underlying error.
        source: serde_json::Error,
    },
    /// A volume cannot be read.
    #[error("{}: {source}", path.display())]
    Nrrd {
        /// Path of the file.
        path: PathBuf,
        /// The underlying error.
        source: NrrdError,
    },
    /// The JSON is at odds with itself or with a volume.
    #[error("{}: {why}", path.display())]
    Disagree {
        /// Path of the file.
        path: PathBuf,
        /// Where.
        why: String,
    },
    /// The parts make no case.
    #[error("{}: {source}", path.display())]
    Case {
        /// The JSON.
        path: PathBuf,
        /// The underlying error.
        source: CaseError,
    },
}

#[derive(Deserialize)]
struct Description {
    name: String,
    units: String,
    axes: String,
    shape_xyz: [usize; 3],
    spacing_mm: [f64; 3],
    origin_mm: [f64; 3],
    ct: String,
    labels: String,
    dose_centigray: Option<String>,
    structures: Vec<Label>,
    isocentre_mm: Option<[f64; 3]>,
    #[serde(default)]
    prescription_gray: BTreeMap<String, f64>,
    fractions: Option<u32>,
    #[serde(default)]
    provenance: String,
}

#[derive(Deserialize)]
struct Label {
    name: String,
    bit: u32,
    #[serde(rename = "type")]
    kind: String,
    voxels: Option<usize>,
}

/// The case that this JSON file describes; its volumes lie in the same folder.
pub fn import_described(json: &Path, names: &NameTable) -> Result<Imported, DescribedError> {
    let text =
        std::fs::read(json).map_err(|source| DescribedError::File { path: json.to_owned(), source })?;
    let description: Description = serde_json::from_slice(&text)
        .map_err(|source| DescribedError::Json { path: json.to_owned(), source })?;
    let disagree = |why: String| DescribedError::Disagree { path: json.to_owned(), why };
    if description.units != "mm" || !description.axes.starts_with("LPS") {
        let (units, axes) = (&description.units, &description.axes);
        return Err(disagree(format!(
            "units {units:?} and axes {axes:?} are not read: `mm` and `LPS` are due"
        )));
    }
    let grid = Grid {
        counts: description.shape_xyz,
        spacing_mm: description.spacing_mm,
        origin_mm: description.origin_mm,
    };
    let volume = |name: &str| beside(json, name, &grid);
    let Values::I16(hu) = volume(&description.ct)? else {
        return Err(disagree(format!("{} is unsigned, but a CT is int16 Hounsfield units", description.ct)));
    };
    let Values::U16(labels) = volume(&description.labels)? else {
        return Err(disagree(format!("{} is signed, but labels are uint16 bits", description.labels)));
    };
    let reference_dose_gy = match &description.dose_centigray {
        None => None,
        Some(name) => match volume(name)? {
            Values::U16(dose) => Some(dose.iter().map(|&c| f32::from(c) / 100.0).collect()),
            Values::I16(_) => {
                return Err(disagree(format!("{name} is signed, but a dose is uint16 centigray")));
            }
        },
    };
    let mut notes = Vec::new();
    let structures = structures(&description, &labels, names, &mut notes).map_err(disagree)?;
    let prescription = prescription(&description.prescription_gray, &description.structures, &structures)
        .map_err(disagree)?;
    let parts = CaseParts {
        name: description.name,
        grid,
        hu,
        structures,
        isocentre_mm: description.isocentre_mm,
        prescription,
        fractions: description.fractions,
        reference_dose_gy,
        uids: None,
        provenance: description.provenance,
    };
    let case = Case::new(parts).map_err(|source| DescribedError::Case { path: json.to_owned(), source })?;
    Ok(Imported { case, notes })
}

/// The values of a volume beside the JSON, which must lie on the grid that the JSON says.
fn beside(json: &Path, name: &str, grid: &Grid) -> Result<Values, DescribedError> {
    if Path::new(name).file_name() != Some(name.as_ref()) {
        let why = format!("{name:?} is no plain file name: volumes lie in the folder of the JSON");
        return Err(DescribedError::Disagree { path: json.to_owned(), why });
    }
    let path = json.with_file_name(name);
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(source) => return Err(DescribedError::File { path, source }),
    };
    let Volume { grid: found, values } = match read_nrrd(&bytes) {
        Ok(volume) => volume,
        Err(source) => return Err(DescribedError::Nrrd { path, source }),
    };
    let near = |a: [f64; 3], b: [f64; 3], within: f64| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= within);
    // A spacing's error is felt over the whole axis.
    let longest = grid.counts.iter().copied().max().unwrap_or(1).max(1) as f64;
    if found.counts != grid.counts
        || !near(found.spacing_mm, grid.spacing_mm, SAME_MM / longest)
        || !near(found.origin_mm, grid.origin_mm, SAME_MM)
    {
        let why = format!(
            "it lies on {:?} voxels, spacing {:?} mm, origin {:?} mm, but the JSON says {:?}, {:?}, {:?}",
            found.counts, found.spacing_mm, found.origin_mm, grid.counts, grid.spacing_mm, grid.origin_mm
        );
        return Err(DescribedError::Disagree { path, why });
    }
    Ok(values)
}

fn structures(
    description: &Description,
    labels: &[u16],
    names: &NameTable,
    notes: &mut Vec<String>,
) -> Result<Vec<Structure>, String> {
    let mut written = Vec::new();
    let mut masks = Vec::new();
    let mut named = 0_u16;
    for Label { name, bit, kind, voxels } in &description.structures {
        let single =
            1_u16.checked_shl(*bit).ok_or_else(|| format!("{name:?} is bit {bit}, but labels have 16"))?;
        if named & single != 0 {
            return Err(format!("two structures are bit {bit}"));
        }
        named |= single;
        let role = Role::of_interpreted_type(kind).ok_or_else(|| {
            format!("{name:?} has type {kind:?}: EXTERNAL, TARGET, CTV, GTV, OAR or OTHER is due")
        })?;
        let mask = Mask::from_fn(labels.len(), |i| labels[i] & single != 0);
        let count = mask.count();
        if voxels.is_some_and(|v| v != count) {
            let said = voxels.unwrap_or_default();
            return Err(format!("{name:?} has {count} voxels in the labels, but the JSON says {said}"));
        }
        written.push((name.as_str(), role));
        masks.push(mask);
    }
    if let Some(l) = labels.iter().find(|&&l| l & !named != 0) {
        let bit = (l & !named).trailing_zeros();
        return Err(format!("the labels use bit {bit}, which no structure names"));
    }
    let named = names.apply(&written, notes);
    Ok(named.into_iter().zip(masks).map(|((name, role), mask)| Structure { name, role, mask }).collect())
}

/// The prescription in the order of the structures.
fn prescription(
    doses: &BTreeMap<String, f64>,
    labels: &[Label],
    structures: &[Structure],
) -> Result<Vec<Prescription>, String> {
    if let Some(name) = doses.keys().find(|name| !labels.iter().any(|l| &l.name == *name)) {
        return Err(format!("a dose is prescribed to {name:?}, but no structure has that name"));
    }
    let of = |(label, structure): (&Label, &Structure)| {
        let dose_gy = *doses.get(&label.name)?;
        Some(Prescription { structure: structure.name.clone(), dose_gy })
    };
    Ok(labels.iter().zip(structures).filter_map(of).collect())
}
