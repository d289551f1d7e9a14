//! The files of a folder: images, structure sets, and others.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use stillpoint_patient::case::Uid;

use crate::dataset::{DataSet, ReadError};
use crate::element::{TagError, text, text_if_any, uid};
use crate::import::ImportError;
use crate::layout::{LayoutError, PREAMBLE};

/// Exports nest a folder per patient, study and series.
pub(crate) const DEEPEST: usize = 8;

/// What a folder holds of a patient.
pub(crate) struct Found {
    /// CT images with their files, of one series.
    pub images: Vec<(PathBuf, DataSet)>,
    /// Their series.
    pub series: Uid,
    /// Structure sets with their files.
    pub structures: Vec<(PathBuf, InMemDicomObject)>,
}

/// The CT images of one series and the structure sets in a folder and the folders in it.
///
/// The series is the wanted one, else the only one. Of other series no more is read than what they are.
pub(crate) fn find(
    folder: &Path,
    wanted: Option<&Uid>,
    notes: &mut Vec<String>,
) -> Result<Found, ImportError> {
    let (mut images, mut structures) = (Vec::new(), Vec::new());
    let mut all: BTreeMap<Uid, Series> = BTreeMap::new();
    let (mut foreign, mut other) = (0, BTreeSet::new());
    for path in files(folder)? {
        let bytes = read(&path)?;
        let data = match DataSet::read(&bytes) {
            Err(ReadError::Layout(LayoutError::NotDicom)) if !meant_as_dicom(&path, &bytes) => {
                foreign += 1;
                continue;
            }
            read => read.map_err(|source| read_error(&path, source))?,
        };
        let tag = |source: TagError| read_error(&path, source);
        let class = text(&data.object, tags::SOP_CLASS_UID).map_err(tag)?;
        let modality = text_if_any(&data.object, tags::MODALITY).map_err(tag)?.unwrap_or_default();
        if class == uids::RT_STRUCTURE_SET_STORAGE {
            structures.push((path, data.object));
        } else if modality == "CT" {
            if text_if_any(&data.object, tags::IMAGE_TYPE)
                .map_err(tag)?
                .is_some_and(|t| t.contains("LOCALIZER"))
            {
                notes.push(format!("{} is a localizer and is left out", path.display()));
                continue;
            }
            let series = uid(&data.object, tags::SERIES_INSTANCE_UID).map_err(tag)?;
            let position = text_if_any(&data.object, tags::PATIENT_POSITION).map_err(tag)?;
            let entry = all.entry(series.clone()).or_default();
            entry.images += 1;
            entry.position = position;
            if wanted.is_none_or(|wanted| *wanted == series) {
                images.push((path, data));
            }
        } else {
            other.insert(if modality.is_empty() { class } else { modality });
        }
    }
    if all.is_empty() {
        other.extend(structures.first().map(|_| "RTSTRUCT".to_owned()));
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
    Ok(Found { images, series: choose(folder, &all, wanted)?, structures })
}

/// What is said of a series.
#[derive(Default)]
struct Series {
    images: usize,
    position: Option<String>,
}

fn choose(folder: &Path, all: &BTreeMap<Uid, Series>, wanted: Option<&Uid>) -> Result<Uid, ImportError> {
    let line = |(uid, series): (&Uid, &Series)| {
        format!("{uid}: {} images, {}", series.images, series.position.as_deref().unwrap_or("no position"))
    };
    let told = || all.iter().map(line).collect();
    match (wanted, all.len(), all.keys().next()) {
        (Some(wanted), ..) if all.contains_key(wanted) => Ok(wanted.clone()),
        (Some(wanted), ..) => Err(ImportError::NoSuchSeries {
            folder: folder.to_owned(),
            series: wanted.clone(),
            found: told(),
        }),
        (None, 1, Some(only)) => Ok(only.clone()),
        _ => Err(ImportError::SeveralSeries { folder: folder.to_owned(), series: told() }),
    }
}

/// Whether a file that is no DICOM was meant as one: by its name, or because it ends within the zeros that a file begins
/// with. An image at the end of a series would else be lost without a word.
fn meant_as_dicom(path: &Path, bytes: &[u8]) -> bool {
    let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dcm"));
    named || (bytes.len() < PREAMBLE + 4 && bytes.iter().take(PREAMBLE).all(|b| *b == 0))
}

/// The data set in a file.
pub(crate) fn open(path: &Path) -> Result<DataSet, ImportError> {
    DataSet::read(&read(path)?).map_err(|source| read_error(path, source))
}

fn read(path: &Path) -> Result<Vec<u8>, ImportError> {
    std::fs::read(path).map_err(|source| ImportError::File { path: path.to_owned(), source })
}

pub(crate) fn read_error(path: &Path, source: impl Into<ReadError>) -> ImportError {
    ImportError::Read { path: path.to_owned(), source: source.into() }
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
