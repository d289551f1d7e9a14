//! The files of a folder: images, structure sets, and others.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use stillpoint_patient::case::Uid;

use crate::dataset::{DataSet, ReadError};
use crate::element::{TagError, text_if_any, uid};
use crate::import::ImportError;
use crate::layout::{LayoutError, PREAMBLE};
use crate::roi::series;
use crate::series::SeriesError;

/// Exports nest a folder per patient, study and series.
pub(crate) const DEEPEST: usize = 8;

/// How a file begins that holds what a Macintosh says of another file.
const APPLE_DOUBLE: [u8; 4] = [0x00, 0x05, 0x16, 0x07];

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
    requested: Option<&Uid>,
    notes: &mut Vec<String>,
    left_out: &mut Vec<String>,
) -> Result<Found, ImportError> {
    let (mut images, mut structures) = (Vec::new(), Vec::new());
    let mut all: BTreeMap<Uid, Series> = BTreeMap::new();
    let (mut copies, mut resource_forks) = (0, 0);
    let mut instances: BTreeMap<String, PathBuf> = BTreeMap::new();
    let (mut foreign, mut other) = (0, BTreeSet::new());
    for path in files(folder)? {
        let bytes = read(&path)?;
        if bytes.starts_with(&APPLE_DOUBLE) {
            resource_forks += 1;
            continue;
        }
        let data = match DataSet::read(&bytes) {
            Err(ReadError::Layout(LayoutError::NotDicom)) if !meant_as_dicom(&path, &bytes) => {
                foreign += 1;
                continue;
            }
            read => read.map_err(|source| read_error(&path, source))?,
        };
        let tag = |source: TagError| read_error(&path, source);
        if data.object.get(tags::DIRECTORY_RECORD_SEQUENCE).is_some() {
            notes.push(format!("{} is a directory of files (DICOMDIR) and is left out", path.display()));
            continue;
        }
        let Some(class) = text_if_any(&data.object, tags::SOP_CLASS_UID).map_err(tag)? else {
            // An image at the end of a series would be lost.
            if data.object.get(tags::PIXEL_DATA).is_some() {
                return Err(tag(TagError::Missing(tags::SOP_CLASS_UID)));
            }
            left_out.push(format!("{} has no (0008,0016) SOPClassUID and is left out", path.display()));
            continue;
        };
        let modality = text_if_any(&data.object, tags::MODALITY).map_err(tag)?.unwrap_or_default();
        if class == uids::RT_STRUCTURE_SET_STORAGE {
            structures.push((path, data.object));
        } else if modality == "CT" && !is_ct(&class) {
            left_out.push(format!(
                "{} has the modality CT, but is not a CT image (class {class}), and is left out",
                path.display()
            ));
        } else if modality == "CT" {
            if text_if_any(&data.object, tags::IMAGE_TYPE)
                .map_err(tag)?
                .is_some_and(|t| t.contains("LOCALIZER"))
            {
                notes.push(format!("{} is a localizer and is left out", path.display()));
                continue;
            }
            let instance =
                text_if_any(&data.object, tags::SOP_INSTANCE_UID).map_err(tag)?.unwrap_or_default();
            if let Some(known) = instances.get(&instance)
                && read(known)? == bytes
            {
                copies += 1;
                continue;
            }
            instances.insert(instance, path.clone());
            let series = uid(&data.object, tags::SERIES_INSTANCE_UID).map_err(tag)?;
            let position = text_if_any(&data.object, tags::PATIENT_POSITION).map_err(tag)?;
            let entry = all.entry(series.clone()).or_default();
            entry.images += 1;
            entry.position = position;
            if requested.is_none_or(|requested| *requested == series) {
                images.push((path, series, data));
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
    let counted = [
        (foreign, "files are not DICOM and are left out"),
        (resource_forks, "files are resource forks of a Macintosh (AppleDouble) and are left out"),
        (copies, "files are copies of others, byte by byte, and count once"),
    ];
    notes.extend(counted.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")));
    if !other.is_empty() {
        let kinds: Vec<_> = other.into_iter().collect();
        notes.push(format!("files of {} are left out: CT and RTSTRUCT are read", kinds.join(", ")));
    }
    let named = named(&structures, &all)?;
    let series = match (requested, named) {
        (None, Some(named)) if all.len() > 1 => {
            notes.push(format!("of {} CT series that is taken which the RTSTRUCT names: {named}", all.len()));
            named
        }
        _ => choose(folder, &all, requested)?,
    };
    let images: Vec<_> =
        images.into_iter().filter(|(_, of, _)| *of == series).map(|(path, _, data)| (path, data)).collect();
    one_patient(&images, &structures, notes)?;
    Ok(Found { images, series, structures })
}

/// Refuses images of two patients in one series; says where the structure set has another ID. The IDs go into no message.
fn one_patient(
    images: &[(PathBuf, DataSet)],
    structures: &[(PathBuf, InMemDicomObject)],
    notes: &mut Vec<String>,
) -> Result<(), ImportError> {
    let id = |path: &Path, object| {
        text_if_any(object, tags::PATIENT_ID).map_err(|source: TagError| read_error(path, source))
    };
    let Some((first, of_first)) = images.first() else { return Ok(()) };
    let expected = id(first, &of_first.object)?;
    for (file, data) in images {
        if id(file, &data.object)? != expected {
            let (file, first) = (file.clone(), first.clone());
            return Err(SeriesError::Mixed { file, first, what: "(0010,0020) PatientID" }.into());
        }
    }
    for (path, object) in structures {
        let found = id(path, object)?;
        if found.is_some() && expected.is_some() && found != expected {
            notes.push(format!(
                "{}: (0010,0020) PatientID is another than that of the images",
                path.display()
            ));
        }
    }
    Ok(())
}

/// The one series that all structure sets here name.
fn named(
    structures: &[(PathBuf, InMemDicomObject)],
    all: &BTreeMap<Uid, Series>,
) -> Result<Option<Uid>, ImportError> {
    let mut named = BTreeSet::new();
    for (path, object) in structures {
        let found = series(object).map_err(|source: TagError| read_error(path, source))?;
        if found.is_empty() {
            return Ok(None);
        }
        named.extend(found.into_iter().filter(|uid| all.contains_key(uid)));
    }
    Ok((named.len() == 1).then(|| named.pop_first()).flatten())
}

/// Whether objects of this class are CT images, of a kind that is read or of one that is refused by name.
fn is_ct(class: &str) -> bool {
    [
        uids::CT_IMAGE_STORAGE,
        uids::ENHANCED_CT_IMAGE_STORAGE,
        uids::LEGACY_CONVERTED_ENHANCED_CT_IMAGE_STORAGE,
    ]
    .contains(&class)
}

/// What is said of a series.
#[derive(Default)]
struct Series {
    images: usize,
    position: Option<String>,
}

fn choose(folder: &Path, all: &BTreeMap<Uid, Series>, requested: Option<&Uid>) -> Result<Uid, ImportError> {
    let line = |(uid, series): (&Uid, &Series)| {
        format!("{uid}: {} images, {}", series.images, series.position.as_deref().unwrap_or("no position"))
    };
    let texts = || all.iter().map(line).collect();
    match (requested, all.len(), all.keys().next()) {
        (Some(requested), ..) if all.contains_key(requested) => Ok(requested.clone()),
        (Some(requested), ..) => Err(ImportError::NoSuchSeries {
            folder: folder.to_owned(),
            series: requested.clone(),
            found: texts(),
        }),
        (None, 1, Some(only)) => Ok(only.clone()),
        _ => Err(ImportError::SeveralSeries { folder: folder.to_owned(), series: texts() }),
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
