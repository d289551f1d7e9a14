//! A folder to a case.

use std::path::{Path, PathBuf};

use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use stillpoint_patient::Grid;
use stillpoint_patient::case::intake::{IntakeError, Scale, settle};
use stillpoint_patient::case::{
    Case, CaseError, CaseParts, Imported, NameTable, PatientPosition, Prescription, Role, Structure, Uid,
    Uids,
};
use thiserror::Error;

use crate::cut::{Cut, cut};
use crate::dataset::ReadError;
use crate::element::{TagError, uid};
use crate::find::{DEEPEST, Found, find, read_error};
use crate::import_messages::sentences;
use crate::names;
use crate::property::{self, Material};
use crate::raster::{Contour, Rastered, rasterise};
use crate::roi::{self, Roi, Rois};
use crate::series::{SeriesError, Volume, volume};
use crate::slice::{Reading, Slice};
use crate::stack::Stack;

/// What the files do not say.
#[derive(Clone, Debug)]
pub struct Request<'a> {
    /// How names of structures are matched.
    pub names: &'a NameTable,
    /// Name of the case; without it, `ct-` and the end of the series' UID.
    pub name: Option<String>,
    /// The series to take where there are several.
    pub series: Option<Uid>,
    /// Doses of the targets: CT and RTSTRUCT hold none.
    pub prescription: Vec<Prescription>,
    /// Number of fractions.
    pub fractions: Option<u32>,
    /// Isocentre, mm; without it, the centroid of the targets with a prescription, or of all targets where none has one.
    pub isocentre_mm: Option<[f64; 3]>,
    /// How much of an organ may lie beyond the images, cm3; 0 refuses every organ that is cut.
    pub allowed_cut_cm3: f64,
    /// How the patient lies, where the images do not say it.
    pub position: Option<PatientPosition>,
    /// Whether values are taken that are no Hounsfield units of a patient.
    pub scale: Scale,
    /// Whether images that are unevenly spaced or of a tilted gantry are resampled, which changes their values.
    pub resample: bool,
}

/// Why a folder makes no case.
#[derive(Debug, Error)]
pub enum ImportError {
    /// A file or folder cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file is damaged, or of a kind that is not read.
    #[error("{}: {source}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// The underlying error.
        source: ReadError,
    },
    /// The images make no volume.
    #[error(transparent)]
    Series(#[from] SeriesError),
    /// Folders are too deep.
    #[error("{}: folders nest more than {DEEPEST} deep: give the one with the series", .0.display())]
    Deep(PathBuf),
    /// There is nothing to read.
    #[error("{}: no CT image is here, but {found}; give a folder with a CT series and its RTSTRUCT, or the JSON next to NRRD volumes", folder.display())]
    NoImages {
        /// The folder.
        folder: PathBuf,
        /// What is there.
        found: String,
    },
    /// There is more than one series.
    #[error("{} holds several CT series: choose one by --series UID:{}", folder.display(), list(series))]
    SeveralSeries {
        /// The folder.
        folder: PathBuf,
        /// Their UIDs.
        series: Vec<String>,
    },
    /// The chosen series is not there.
    #[error("{} has no CT series {series}: it has{}", folder.display(), list(found))]
    NoSuchSeries {
        /// The folder.
        folder: PathBuf,
        /// What was asked for.
        series: Uid,
        /// Their UIDs.
        found: Vec<String>,
    },
    /// There is no structure set.
    #[error("{}: no RTSTRUCT is here: add the one that was drawn on these images", .0.display())]
    NoStructures(PathBuf),
    /// There are several structure sets.
    #[error("{} holds several RTSTRUCT of the series: leave one here:{}", folder.display(), list(files))]
    SeveralStructures {
        /// The folder.
        folder: PathBuf,
        /// The files.
        files: Vec<String>,
    },
    /// The structure set belongs to other images.
    #[error("{}: (3006,0010) ReferencedFrameOfReferenceSequence names other series than {series}: give the images that the structures were drawn on", path.display())]
    OtherImages {
        /// The structure set.
        path: PathBuf,
        /// The series of the images.
        series: Uid,
    },
    /// The images end inside targets or organs.
    #[error("the images end inside structures:{}", list(.0))]
    Cut(Vec<String>),
    /// The images and structures are no patient.
    #[error("{}: {source}", folder.display())]
    Intake {
        /// The folder.
        folder: PathBuf,
        /// The underlying error.
        source: IntakeError,
    },
    /// No file is of the case's study.
    #[error("{}: no file is of the study {study}: give the folder that the case was imported from", folder.display())]
    OtherStudy {
        /// The folder.
        folder: PathBuf,
        /// The study of the case.
        study: Uid,
    },
    /// The parts make no case.
    #[error("{}: {source}", folder.display())]
    Case {
        /// The folder.
        folder: PathBuf,
        /// The underlying error.
        source: CaseError,
    },
}

fn list(entries: &[String]) -> String {
    entries.iter().flat_map(|entry| ["\n  ", entry]).collect()
}

/// The case in this folder and the folders in it: one CT series and the RTSTRUCT drawn on it.
pub fn import_folder(folder: &Path, request: &Request<'_>) -> Result<Imported, ImportError> {
    let (mut notes, mut left_out) = (Vec::new(), Vec::new());
    let Found { images, series, structures } =
        find(folder, request.series.as_ref(), &mut notes, &mut left_out)?;
    let reading = Reading { position: request.position, scale: request.scale, resample: request.resample };
    let mut slices = Vec::with_capacity(images.len());
    for (path, data) in images {
        let slice = Slice::read_as(&data, reading).map_err(|source| read_error(&path, source))?;
        slices.push((path, slice));
    }
    let tilt = slices.first().map_or(0.0, |(_, slice)| slice.tilt);
    let Volume { grid, mut hu, study, frame_of_reference: frame, position, stack, notes: of_volume } =
        volume(slices, request.resample)?;
    notes.extend(of_volume);
    let rois = structure_set(folder, structures, &series, &frame, tilt)?;
    left_out.extend(rois.left_out);
    let onto = Onto { grid: &grid, stack: stack.as_ref() };
    let Taken { mut structures, materials, written } = drawn(&rois.rois, onto, request, &mut notes)?;
    settle(&grid, &hu, &mut structures, request.scale, &mut notes)
        .map_err(|source| ImportError::Intake { folder: folder.to_owned(), source })?;
    property::apply(&grid, &materials, &mut hu, &mut structures, &mut notes);
    let prescription: Vec<_> =
        request.prescription.iter().map(|p| prescribed(p, &structures, &written)).collect();
    helpers(&structures, &prescription, &mut notes);
    let end: String = series.as_str().chars().rev().take(8).collect::<Vec<_>>().into_iter().rev().collect();
    let parts = CaseParts {
        name: request.name.clone().unwrap_or_else(|| format!("ct-{end}")),
        grid,
        hu,
        structures,
        isocentre_mm: request.isocentre_mm,
        prescription,
        fractions: request.fractions,
        reference_dose_gy: None,
        uids: Some(Uids { study, series, frame_of_reference: frame, structure_set: rois.uid }),
        provenance: match stack {
            None => "DICOM CT and RTSTRUCT".to_owned(),
            Some(_) => "DICOM CT, resampled, and RTSTRUCT".to_owned(),
        },
    };
    let case = Case::new(parts).map_err(|source| ImportError::Case { folder: folder.to_owned(), source })?;
    Ok(Imported { case: case.lying(position), notes, left_out })
}

/// A prescription by the name that the structure has in the case, where it is given by that in the structure set.
fn prescribed(given: &Prescription, structures: &[Structure], written: &[(String, String)]) -> Prescription {
    let is_known = structures.iter().any(|s| s.name == given.structure);
    let renamed = written.iter().find(|(own, _)| *own == given.structure);
    match renamed {
        Some((_, name)) if !is_known => Prescription { structure: name.clone(), dose_gy: given.dose_gy },
        _ => given.clone(),
    }
}

/// Says which targets have no dose where others have one.
fn helpers(structures: &[Structure], prescription: &[Prescription], notes: &mut Vec<String>) {
    if prescription.is_empty() {
        return;
    }
    let is_prescribed = |s: &&Structure| prescription.iter().any(|p| p.structure == s.name);
    let targets = structures.iter().filter(|s| s.role == Role::Target);
    notes.extend(targets.filter(|s| !is_prescribed(s)).map(|s| {
        format!(
            "{:?} is a target without a prescription and does not move the isocentre: prescribe a dose to it, or give it another role by a names table (`--names`)",
            s.name
        )
    }));
}

/// The structures of a structure set as voxels.
struct Taken<'a> {
    structures: Vec<Structure>,
    /// Regions that say something of their material.
    materials: Vec<Material<'a>>,
    /// Names in the structure set with those in the case.
    written: Vec<(String, String)>,
}

/// The volume that structures are drawn onto.
#[derive(Clone, Copy)]
struct Onto<'a> {
    grid: &'a Grid,
    /// The images that contours were drawn on, where the volume is resampled.
    stack: Option<&'a Stack>,
}

impl Onto<'_> {
    fn rasterise(self, contours: &[Contour]) -> Rastered {
        match self.stack {
            None => rasterise(self.grid, contours),
            Some(stack) => stack.rasterise(contours, self.grid),
        }
    }
}

/// The structures as voxels, under the names and roles that they get.
fn drawn<'a>(
    rois: &'a [Roi],
    onto: Onto<'_>,
    request: &Request<'_>,
    notes: &mut Vec<String>,
) -> Result<Taken<'a>, ImportError> {
    let unique = names::unique(rois.iter().map(|roi| roi.name.as_str()), notes);
    let written: Vec<_> = unique.iter().map(String::as_str).zip(rois.iter().map(|roi| roi.role)).collect();
    let named = request.names.apply(&written, notes);
    let mut taken = Taken { structures: Vec::new(), materials: Vec::new(), written: Vec::new() };
    let mut refused = Vec::new();
    for ((roi, own), (name, role)) in rois.iter().zip(&unique).zip(named) {
        let Rastered { mask, drawn } = onto.rasterise(&roi.contours);
        match cut(own, role, &drawn, request.allowed_cut_cm3) {
            Cut::Whole => {}
            Cut::Note(text) => notes.push(text),
            Cut::Refused(text) => {
                refused.push(text);
                continue;
            }
        }
        notes.extend(sentences(own, &drawn, roi.lines));
        if mask.is_empty() {
            let volume_cm3 = drawn.drawn_cm3;
            notes.push(format!("{:?} holds no voxel ({volume_cm3:.2} cm3) and is left out", own));
            continue;
        }
        if property::is_material(roi) {
            taken.materials.push(Material { name: roi.name.as_str(), roi, mask: mask.clone() });
        }
        taken.written.extend([(roi.name.clone(), name.clone()), (own.clone(), name.clone())]);
        taken.structures.push(Structure { name, role, mask });
    }
    if refused.is_empty() { Ok(taken) } else { Err(ImportError::Cut(refused)) }
}

/// The one structure set that was drawn on the series.
fn structure_set(
    folder: &Path,
    found: Vec<(PathBuf, InMemDicomObject)>,
    series: &Uid,
    frame: &Uid,
    tilt: f64,
) -> Result<Rois, ImportError> {
    let mut fitting = Vec::new();
    let mut strangers = Vec::new();
    for (path, object) in found {
        let tag = |source: TagError| read_error(&path, source);
        uid(&object, tags::SOP_INSTANCE_UID).map_err(tag)?;
        let named = roi::series(&object).map_err(tag)?;
        match named.is_empty() || named.contains(series) {
            true => fitting.push((path, object)),
            false => strangers.push(path),
        }
    }
    if fitting.len() > 1 {
        let files = fitting.iter().map(|(path, _)| path.display().to_string()).collect();
        return Err(ImportError::SeveralStructures { folder: folder.to_owned(), files });
    }
    match (fitting.pop(), strangers.pop()) {
        (Some((path, object)), _) => {
            Rois::read(&object, frame, tilt).map_err(|source| read_error(&path, source))
        }
        (None, Some(path)) => Err(ImportError::OtherImages { path, series: series.clone() }),
        (None, None) => Err(ImportError::NoStructures(folder.to_owned())),
    }
}
