//! NRRD volumes with the JSON beside them, to a case.
//!
//! The JSON names the volumes, gives the meaning of the bits of the labels, and repeats the grid. If JSON and volumes
//! state the same thing, they must agree.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use thiserror::Error;

use super::intake::{IntakeError, Scale, settle};
use super::mask::Mask;
use super::names::NameTable;
use super::nrrd::{NrrdError, Values, Volume, read_detached};
use super::patient::{Case, CaseError, CaseParts, Prescription, check_grid};
use super::structure::{Role, Structure};
use crate::Grid;

/// How far two ways to write one position may lie apart, mm.
const SAME_MM: f64 = 1e-3;

/// A case, and what the reader has to say about how it came to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// The case.
    pub case: Case,
    /// What was renamed, made or is worth a look, a sentence each.
    pub notes: Vec<String>,
    /// What could not be read and was left out, a sentence each.
    pub left_out: Vec<String>,
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
        why: Disagreement,
    },
    /// The parts make no case.
    #[error("{}: {source}", path.display())]
    Case {
        /// The JSON.
        path: PathBuf,
        /// The underlying error.
        source: CaseError,
    },
    /// The images and structures are no patient.
    #[error("{}: {source}", path.display())]
    Intake {
        /// The JSON.
        path: PathBuf,
        /// The underlying error.
        source: IntakeError,
    },
}

/// Where a JSON is at odds with itself or with a volume.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Disagreement {
    /// Coordinates in another unit or other axes.
    #[error("units {units:?} and axes {axes:?} are not read: `mm` and `LPS` are required")]
    Axes {
        /// The unit.
        units: String,
        /// The axes.
        axes: String,
    },
    /// Too few voxels.
    #[error("{0:?} voxels are not a volume: 2 or more along each axis are required")]
    Flat([usize; 3]),
    /// A value of the CT is not one.
    #[error("{name} holds {value}, which is not a Hounsfield unit (allowed: -32768 to 32767)")]
    Hounsfield {
        /// The volume.
        name: String,
        /// The value.
        value: f64,
    },
    /// A CT of another type.
    #[error("{0} is unsigned, but a CT is int16, int32, float or double Hounsfield units")]
    Ct(String),
    /// Labels of another type.
    #[error("{0} is signed, but labels are uint8, uint16 or uint32 bits")]
    Labels(String),
    /// A dose of another type.
    #[error("{0} is signed or of 8 bits, but a dose is uint16 or uint32 centigray")]
    Dose(String),
    /// A volume in another folder.
    #[error("{0:?} is not a plain file name: volumes must be in the folder of the JSON")]
    Folder(String),
    /// A volume on another grid.
    #[error(
        "it has {:?} voxels, spacing {:?} mm, origin {:?} mm, but the JSON says {:?}, {:?}, {:?}",
        found.counts, found.spacing_mm, found.origin_mm, json.counts, json.spacing_mm, json.origin_mm
    )]
    Grid {
        /// Grid of the volume.
        found: Box<Grid>,
        /// Grid of the JSON.
        json: Box<Grid>,
    },
    /// A structure whose bit the labels do not have.
    #[error(
        "{name:?} is bit {bit}, but labels have {all} (bits 0 to {}): write them as uint32, or give a list of files as `labels`",
        all.saturating_sub(1)
    )]
    Bit {
        /// The structure.
        name: String,
        /// Its bit.
        bit: u32,
        /// Bits of the labels.
        all: u32,
    },
    /// One bit for two structures.
    #[error("two structures are bit {0}")]
    Twice(u32),
    /// A structure of another type.
    #[error("{name:?} has type {kind:?}: EXTERNAL, TARGET, CTV, GTV, OAR or OTHER is required")]
    Kind {
        /// The structure.
        name: String,
        /// Its type.
        kind: String,
    },
    /// Another number of voxels than is stated.
    #[error("{name:?} has {count} voxels in the labels, but the JSON says {stated}")]
    Voxels {
        /// The structure.
        name: String,
        /// Its voxels.
        count: usize,
        /// Those of the JSON.
        stated: usize,
    },
    /// A bit without a structure.
    #[error("the labels use bit {0}, which no structure names")]
    Unnamed(u32),
    /// A dose without a structure.
    #[error("a dose is prescribed to {0:?}, but no structure has that name")]
    Prescribed(String),
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
    labels: Files,
    dose_centigray: Option<String>,
    structures: Vec<Label>,
    isocentre_mm: Option<[f64; 3]>,
    #[serde(default)]
    prescription_gray: BTreeMap<String, f64>,
    fractions: Option<u32>,
    #[serde(default)]
    provenance: String,
    #[serde(flatten)]
    unknown: BTreeMap<String, serde_json::Value>,
}

/// One file of labels, or several: their bits are counted on from file to file.
#[derive(Deserialize)]
#[serde(untagged)]
enum Files {
    One(String),
    Several(Vec<String>),
}

/// Labels of 8, 16 or 32 bits.
struct Labels {
    voxels: Vec<u32>,
    first_bit: u32,
    bits: u32,
}

#[derive(Deserialize)]
struct Label {
    name: String,
    bit: u32,
    #[serde(rename = "type")]
    kind: String,
    voxels: Option<usize>,
    #[serde(flatten)]
    unknown: BTreeMap<String, serde_json::Value>,
}

/// The case that this JSON file describes; its volumes lie in the same folder.
pub fn import_described(json: &Path, names: &NameTable) -> Result<Imported, DescribedError> {
    import_described_as(json, names, Scale::OfPatients)
}

/// The case that this JSON file describes, with or without leave for Hounsfield units that no patient has.
pub fn import_described_as(json: &Path, names: &NameTable, scale: Scale) -> Result<Imported, DescribedError> {
    let text =
        std::fs::read(json).map_err(|source| DescribedError::File { path: json.to_owned(), source })?;
    let description: Description = serde_json::from_slice(&text)
        .map_err(|source| DescribedError::Json { path: json.to_owned(), source })?;
    let disagree = |why: Disagreement| DescribedError::Disagree { path: json.to_owned(), why };
    if description.units != "mm" || !description.axes.starts_with("LPS") {
        return Err(disagree(Disagreement::Axes { units: description.units, axes: description.axes }));
    }
    let counts = description.shape_xyz;
    if counts.iter().any(|&n| n < 2) {
        return Err(disagree(Disagreement::Flat(counts)));
    }
    let grid = Grid { counts, spacing_mm: description.spacing_mm, origin_mm: description.origin_mm };
    check_grid(&grid).map_err(|source| DescribedError::Case { path: json.to_owned(), source })?;
    let volume = |name: &str| sibling(json, name, &grid);
    let hu = hounsfield(&description.ct, volume(&description.ct)?).map_err(disagree)?;
    let labels = labels(&description.labels, volume, disagree)?;
    let reference_dose_gy = match &description.dose_centigray {
        None => None,
        Some(name) => Some(dose(name, volume(name)?).map_err(disagree)?),
    };
    let mut notes = Vec::new();
    let left_out = unknown_keys(&description);
    let mut structures = structures(&description, &labels, names, &mut notes).map_err(disagree)?;
    let prescription = prescription(&description.prescription_gray, &description.structures, &structures)
        .map_err(disagree)?;
    settle(&grid, &hu, &mut structures, scale, &mut notes)
        .map_err(|source| DescribedError::Intake { path: json.to_owned(), source })?;
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
    Ok(Imported { case, notes, left_out })
}

/// A sentence for each key that nothing reads: a misspelt one would else change the plan without a word.
fn unknown_keys(description: &Description) -> Vec<String> {
    let own = description.unknown.keys().map(|key| format!("the key {key:?} of the JSON is not read"));
    let of_structure = |label: &Label| {
        let name = label.name.clone();
        let keys: Vec<String> = label.unknown.keys().filter(|key| *key != "volume_cm3").cloned().collect();
        keys.into_iter()
            .map(move |key| format!("the key {key:?} of the structure {name:?} in the JSON is not read"))
    };
    own.chain(description.structures.iter().flat_map(of_structure)).collect()
}

/// Values as Hounsfield units, to the nearest.
fn hounsfield(name: &str, values: Values) -> Result<Vec<i16>, Disagreement> {
    match values {
        Values::I16(hu) => Ok(hu),
        Values::F64(exact) => exact
            .iter()
            .map(|&value| {
                let range = f64::from(i16::MIN)..=f64::from(i16::MAX);
                let hu = libm::round(value);
                if range.contains(&hu) {
                    return Ok(hu as i16);
                }
                Err(Disagreement::Hounsfield { name: name.to_owned(), value })
            })
            .collect(),
        Values::U8(_) | Values::U16(_) | Values::U32(_) => Err(Disagreement::Ct(name.to_owned())),
    }
}

fn labels(
    files: &Files,
    volume: impl Fn(&str) -> Result<Values, DescribedError>,
    disagree: impl Fn(Disagreement) -> DescribedError,
) -> Result<Vec<Labels>, DescribedError> {
    let names = match files {
        Files::One(name) => std::slice::from_ref(name),
        Files::Several(names) => names,
    };
    let mut all = Vec::new();
    let mut first_bit = 0;
    for name in names {
        let (voxels, bits): (Vec<u32>, u32) = match volume(name)? {
            Values::U8(v) => (v.into_iter().map(u32::from).collect(), 8),
            Values::U16(v) => (v.into_iter().map(u32::from).collect(), 16),
            Values::U32(v) => (v, 32),
            Values::I16(_) | Values::F64(_) => {
                return Err(disagree(Disagreement::Labels(name.clone())));
            }
        };
        all.push(Labels { voxels, first_bit, bits });
        first_bit += bits;
    }
    Ok(all)
}

/// A dose in centigray as gray.
fn dose(name: &str, values: Values) -> Result<Vec<f32>, Disagreement> {
    match values {
        Values::U16(dose) => Ok(dose.iter().map(|&c| f32::from(c) / 100.0).collect()),
        Values::U32(dose) => Ok(dose.iter().map(|&c| (f64::from(c) / 100.0) as f32).collect()),
        Values::U8(_) | Values::I16(_) | Values::F64(_) => Err(Disagreement::Dose(name.to_owned())),
    }
}

/// The values of a volume beside the JSON, which must lie on the grid that the JSON says.
fn sibling(json: &Path, name: &str, grid: &Grid) -> Result<Values, DescribedError> {
    if Path::new(name).file_name() != Some(name.as_ref()) {
        let why = Disagreement::Folder(name.to_owned());
        return Err(DescribedError::Disagree { path: json.to_owned(), why });
    }
    let path = json.with_file_name(name);
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(source) => return Err(DescribedError::File { path, source }),
    };
    let detached = |name: &str| {
        let data = path.with_file_name(name);
        std::fs::read(&data).map_err(|error| NrrdError::DataFile { path: data, why: error.to_string() })
    };
    let Volume { grid: found, values } = match read_detached(&bytes, detached) {
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
        let why = Disagreement::Grid { found: Box::new(found), json: Box::new(*grid) };
        return Err(DescribedError::Disagree { path, why });
    }
    Ok(values)
}

fn structures(
    description: &Description,
    labels: &[Labels],
    names: &NameTable,
    notes: &mut Vec<String>,
) -> Result<Vec<Structure>, Disagreement> {
    let mut written = Vec::new();
    let mut masks = Vec::new();
    let mut named = vec![0_u32; labels.len()];
    let all: u32 = labels.iter().map(|l| l.bits).sum();
    for Label { name, bit, kind, voxels, .. } in &description.structures {
        let place = labels.iter().position(|l| (l.first_bit..l.first_bit + l.bits).contains(bit));
        let place = place.ok_or_else(|| Disagreement::Bit { name: name.clone(), bit: *bit, all })?;
        let file = &labels[place];
        let single = 1_u32 << (bit - file.first_bit);
        if named[place] & single != 0 {
            return Err(Disagreement::Twice(*bit));
        }
        named[place] |= single;
        let role = Role::of_interpreted_type(kind)
            .ok_or_else(|| Disagreement::Kind { name: name.clone(), kind: kind.clone() })?;
        let mask = Mask::from_fn(file.voxels.len(), |i| file.voxels[i] & single != 0);
        let count = mask.count();
        if let Some(stated) = voxels.filter(|stated| *stated != count) {
            return Err(Disagreement::Voxels { name: name.clone(), count, stated });
        }
        written.push((name.as_str(), Some(role)));
        masks.push(mask);
    }
    for (file, named) in labels.iter().zip(named) {
        if let Some(l) = file.voxels.iter().find(|&&l| l & !named != 0) {
            let bit = file.first_bit + (l & !named).trailing_zeros();
            return Err(Disagreement::Unnamed(bit));
        }
    }
    let named = names.apply(&written, notes);
    Ok(named.into_iter().zip(masks).map(|((name, role), mask)| Structure { name, role, mask }).collect())
}

/// The prescription in the order of the structures.
fn prescription(
    doses: &BTreeMap<String, f64>,
    labels: &[Label],
    structures: &[Structure],
) -> Result<Vec<Prescription>, Disagreement> {
    if let Some(name) = doses.keys().find(|name| !labels.iter().any(|l| &l.name == *name)) {
        return Err(Disagreement::Prescribed(name.clone()));
    }
    let of = |(label, structure): (&Label, &Structure)| {
        let dose_gy = *doses.get(&label.name)?;
        Some(Prescription { structure: structure.name.clone(), dose_gy })
    };
    Ok(labels.iter().zip(structures).filter_map(of).collect())
}
