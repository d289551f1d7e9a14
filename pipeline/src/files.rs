//! The files that parameters name, as they were when a run began.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use stillpoint_operator::files::{DiskFiles, FilePlace, Files, listed};

use crate::graph::Graph;

/// Where the bytes of a file are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Place {
    Disk(PathBuf),
    Here(Vec<u8>),
}

/// Why a file that parameters name cannot be read or kept.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {reason}")]
pub struct FileError {
    /// The file, as the parameter names it, or the folder of its copy.
    pub file: String,
    /// What the system or the session says.
    pub reason: String,
}

impl FileError {
    pub(crate) fn new(file: &dyn std::fmt::Display, reason: &dyn std::fmt::Display) -> Self {
        Self { file: file.to_string(), reason: reason.to_string() }
    }
}

/// The files of a run as they were when it began: every process reads these, also one that is started again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Snapshot {
    files: BTreeMap<String, Place>,
}

impl Snapshot {
    /// The files that a graph names, where they are.
    pub fn of(graph: &Graph, disk: &DiskFiles) -> Result<Self, FileError> {
        let mut files = BTreeMap::new();
        for name in graph.files() {
            for file in disk.list(name).map_err(|e| FileError::new(name, &e))? {
                let place = match disk.place(&file) {
                    FilePlace::Memory(bytes) => Place::Here(bytes),
                    FilePlace::Disk(path) => Place::Disk(path),
                };
                files.insert(file, place);
            }
        }
        Ok(Self { files })
    }

    /// Copies of them in `folder`: what happens to the originals from now on is not seen.
    pub fn copied_to(&self, folder: &Path) -> Result<Self, FileError> {
        let mut files = BTreeMap::new();
        std::fs::create_dir_all(folder).map_err(|e| FileError::new(&folder.display(), &e))?;
        for (number, (name, place)) in self.files.iter().enumerate() {
            let copy = folder.join(number.to_string());
            let copied = match place {
                Place::Disk(path) => std::fs::copy(path, &copy).map(|_| ()),
                Place::Here(bytes) => std::fs::write(&copy, bytes),
            };
            copied.map_err(|e| FileError::new(name, &e))?;
            files.insert(name.clone(), Place::Disk(copy));
        }
        Ok(Self { files })
    }
}

impl Files for Snapshot {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        match self.files.get(name).ok_or("it is not among the files of this run")? {
            Place::Disk(path) => std::fs::read(path).map_err(|e| e.to_string()),
            Place::Here(bytes) => Ok(bytes.clone()),
        }
    }

    fn shared_mode(&self, name: &str) -> Option<u32> {
        match self.files.get(name)? {
            Place::Disk(path) => FilePlace::Disk(path.clone()).shared_mode(),
            Place::Here(_) => None,
        }
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "it is not among the files of this run".to_string())
    }
}
