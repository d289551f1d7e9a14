//! A folder to a case.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use stillpoint_plan::case::{
    Case, CaseError, CaseParts, Imported, NameTable, Prescription, Structure, Uid, Uids,
};
use thiserror::Error;

use crate::dataset::{DataSet, ReadError};
use crate::element::{TagError, text, text_if_any, uid};
use crate::layout::LayoutError;
use crate::raster::rasterise;
use crate::roi::{self, Rois};
use crate::series::{SeriesError, Volume, volume};
use crate::slice::Slice;

/// Exports nest a folder per patient, study and series.
const DEEPEST: usize = 8;

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
    /// Isocentre, mm; without it, the centroid of all targets.
    pub isocentre_mm: Option<[f64; 3]>,
}

/// Why a folder makes no case.
#[derive(Debug, Error)]
pub enum ImportError {
    /// A file or folder cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file is damaged, or of a kind that is not read.
    #[error("{}: {source}", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        source: ReadError,
    },
    /// The images make no volume.
    #[error(transparent)]
    Series(#[from] SeriesError),
    /// Folders are too deep.
    #[error("{}: folders nest more than {DEEPEST} deep: give the one with the series", .0.display())]
    Deep(PathBuf),
    /// There is nothing to read.
    #[error("{}: no CT image is here, but {found}; give a folder with a CT series and its RTSTRUCT, or the JSON beside NRRD volumes", folder.display())]
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
        /// What is wrong.
        source: CaseError,
    },
}

fn list(entries: &[String]) -> String {
    entries.iter().flat_map(|entry| ["\n  ", entry]).collect()
}

/// The data set in a file.
pub(crate) fn open(path: &Path) -> Result<DataSet, ImportError> {
    let bytes = std::fs::read(path).map_err(|source| ImportError::File { path: path.to_owned(), source })?;
    DataSet::read(&bytes).map_err(|source| read_error(path, source))
}

fn read_error(path: &Path, source: impl Into<ReadError>) -> ImportError {
    ImportError::Read { path: path.to_owned(), source: source.into() }
}

/// The case in this folder and the folders in it: one CT series and the RTSTRUCT drawn on it.
pub fn import_folder(folder: &Path, request: &Request<'_>) -> Result<Imported, ImportError> {
    let mut notes = Vec::new();
    let Found { images, structures } = find(folder, &mut notes)?;
    let series = choose(folder, &images, request.series.as_ref())?;
    let slices: Vec<_> = images.into_iter().filter(|(_, slice)| slice.series == series).collect();
    let volume = volume(slices)?;
    let Volume { grid, hu, study, frame_of_reference: frame } = volume;
    let rois = structure_set(folder, structures, &series, &frame)?;
    let mut drawn = Vec::new();
    let mut written = Vec::new();
    for roi in &rois.rois {
        let rastered = rasterise(&grid, &roi.contours);
        if roi.lines > 0 {
            notes.push(format!(
                "{:?}: {} contours are points or open lines and hold no volume",
                roi.name, roi.lines
            ));
        }
        if rastered.planes_unused > 0 {
            let planes = rastered.planes_unused;
            notes.push(format!(
                "{:?}: {planes} planes of contours lie outside the images, or closer than them, and are left out",
                roi.name
            ));
        }
        if rastered.mask.is_empty() {
            notes.push(format!("{:?} holds no voxel and is left out", roi.name));
            continue;
        }
        written.push((roi.name.as_str(), roi.role));
        drawn.push(rastered.mask);
    }
    let named = request.names.apply(&written, &mut notes);
    let structures =
        named.into_iter().zip(drawn).map(|((name, role), mask)| Structure { name, role, mask }).collect();
    let end: String = series.as_str().chars().rev().take(8).collect::<Vec<_>>().into_iter().rev().collect();
    let parts = CaseParts {
        name: request.name.clone().unwrap_or_else(|| format!("ct-{end}")),
        grid,
        hu,
        structures,
        isocentre_mm: request.isocentre_mm,
        prescription: request.prescription.clone(),
        fractions: request.fractions,
        reference_dose_gy: None,
        uids: Some(Uids { study, series, frame_of_reference: frame, structure_set: rois.uid }),
        provenance: "DICOM CT and RTSTRUCT".to_owned(),
    };
    let case = Case::new(parts).map_err(|source| ImportError::Case { folder: folder.to_owned(), source })?;
    Ok(Imported { case, notes })
}

struct Found {
    images: Vec<(PathBuf, Slice)>,
    structures: Vec<(PathBuf, InMemDicomObject)>,
}

/// CT images and structure sets in a folder and the folders in it.
fn find(folder: &Path, notes: &mut Vec<String>) -> Result<Found, ImportError> {
    let mut found = Found { images: Vec::new(), structures: Vec::new() };
    let (mut foreign, mut other) = (0, BTreeSet::new());
    for path in files(folder)? {
        let data = match open(&path) {
            Err(ImportError::Read { source: ReadError::Layout(LayoutError::NotDicom), .. }) => {
                foreign += 1;
                continue;
            }
            opened => opened?,
        };
        let tag = |source: TagError| read_error(&path, source);
        let class = text(&data.object, tags::SOP_CLASS_UID).map_err(tag)?;
        let modality = text_if_any(&data.object, tags::MODALITY).map_err(tag)?.unwrap_or_default();
        if class == uids::RT_STRUCTURE_SET_STORAGE {
            found.structures.push((path, data.object));
        } else if modality == "CT" {
            if text_if_any(&data.object, tags::IMAGE_TYPE)
                .map_err(tag)?
                .is_some_and(|t| t.contains("LOCALIZER"))
            {
                notes.push(format!("{} is a localizer and is left out", path.display()));
                continue;
            }
            let slice = Slice::read(&data).map_err(tag)?;
            found.images.push((path, slice));
        } else {
            other.insert(if modality.is_empty() { class } else { modality });
        }
    }
    if found.images.is_empty() {
        other.extend(found.structures.first().map(|_| "RTSTRUCT".to_owned()));
        let kinds: Vec<_> =
            other.into_iter().chain((foreign > 0).then(|| format!("{foreign} other files"))).collect();
        let found = if kinds.is_empty() { "nothing".to_owned() } else { kinds.join(", ") };
        return Err(ImportError::NoImages { folder: folder.to_owned(), found });
    }
    if foreign > 0 {
        notes.push(format!("{foreign} files are no DICOM and are left out"));
    }
    if !other.is_empty() {
        let kinds: Vec<_> = other.into_iter().collect();
        notes.push(format!("files of {} are left out: CT and RTSTRUCT are read", kinds.join(", ")));
    }
    Ok(found)
}

/// All files in a folder and the folders in it, in the order of their paths.
pub(crate) fn files(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let mut files = Vec::new();
    walk(folder, 0, &mut files)?;
    files.sort();
    Ok(files)
}

fn walk(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), ImportError> {
    if depth > DEEPEST {
        return Err(ImportError::Deep(folder.to_owned()));
    }
    let fault = |source| ImportError::File { path: folder.to_owned(), source };
    for entry in std::fs::read_dir(folder).map_err(fault)? {
        let path = entry.map_err(fault)?.path();
        if path.is_dir() {
            walk(&path, depth + 1, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}

fn choose(folder: &Path, images: &[(PathBuf, Slice)], asked: Option<&Uid>) -> Result<Uid, ImportError> {
    let series: BTreeSet<&Uid> = images.iter().map(|(_, slice)| &slice.series).collect();
    let told = || series.iter().map(ToString::to_string).collect();
    match (asked, series.len(), series.first()) {
        (Some(asked), ..) if series.contains(asked) => Ok(asked.clone()),
        (Some(asked), ..) => {
            Err(ImportError::NoSuchSeries { folder: folder.to_owned(), series: asked.clone(), found: told() })
        }
        (None, 1, Some(&only)) => Ok(only.clone()),
        _ => Err(ImportError::SeveralSeries { folder: folder.to_owned(), series: told() }),
    }
}

/// The one structure set that was drawn on the series.
fn structure_set(
    folder: &Path,
    found: Vec<(PathBuf, InMemDicomObject)>,
    series: &Uid,
    frame: &Uid,
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
        (Some((path, object)), _) => Rois::read(&object, frame).map_err(|source| read_error(&path, source)),
        (None, Some(path)) => Err(ImportError::OtherImages { path, series: series.clone() }),
        (None, None) => Err(ImportError::NoStructures(folder.to_owned())),
    }
}
