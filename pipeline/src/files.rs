//! Where the files that parameters name are read from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::graph::Graph;
use crate::setup::Files;

/// Files on disk, beside the pipeline's file.
pub struct DiskFiles {
    base: PathBuf,
}

impl DiskFiles {
    /// Files named relative to the folder of `pipeline_file`.
    pub fn beside(pipeline_file: &Path) -> Self {
        Self { base: pipeline_file.parent().map(Path::to_path_buf).unwrap_or_default() }
    }
}

impl DiskFiles {
    /// Where a file is.
    fn path(&self, name: &str) -> PathBuf {
        self.base.join(name)
    }
}

/// The files of a run as they were when it began: every process reads these, also one that is started again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Snapshot {
    files: BTreeMap<String, PathBuf>,
}

impl Snapshot {
    /// The files that a graph names, where they are.
    pub fn of(graph: &Graph, disk: &DiskFiles) -> Result<Self, String> {
        let mut files = BTreeMap::new();
        for name in graph.operators.iter().flat_map(|o| &o.files) {
            for file in disk.list(name).map_err(|e| format!("{name}: {e}"))? {
                files.insert(file.clone(), disk.path(&file));
            }
        }
        Ok(Self { files })
    }

    /// Copies of them in `folder`: what happens to the originals from now on is not seen.
    pub fn copied_to(&self, folder: &Path) -> Result<Self, String> {
        let mut files = BTreeMap::new();
        std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        for (number, (name, path)) in self.files.iter().enumerate() {
            let copy = folder.join(number.to_string());
            std::fs::copy(path, &copy).map_err(|e| format!("{}: {e}", path.display()))?;
            files.insert(name.clone(), copy);
        }
        Ok(Self { files })
    }
}

impl Files for Snapshot {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        let path = self.files.get(name).ok_or("it is not among the files of this run")?;
        std::fs::read(path).map_err(|e| e.to_string())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "it is not among the files of this run".to_string())
    }
}

/// A file by its own name, or the files of a folder.
fn listed<T>(files: &BTreeMap<String, T>, name: &str) -> Option<Vec<String>> {
    if files.contains_key(name) {
        return Some(vec![name.to_string()]);
    }
    let folder = format!("{}/", name.trim_end_matches('/'));
    let inside = files.keys().filter(|f| f.strip_prefix(&folder).is_some_and(|rest| !rest.contains('/')));
    let inside: Vec<String> = inside.cloned().collect();
    (!inside.is_empty()).then_some(inside)
}

impl Files for DiskFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        std::fs::read(self.path(name)).map_err(|e| e.to_string())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        let path = self.path(name);
        if path.is_file() {
            return Ok(vec![name.to_string()]);
        }
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&path).map_err(|e| e.to_string())? {
            let entry = entry.map_err(|e| e.to_string())?;
            if entry.path().is_file()
                && let Some(file) = entry.file_name().to_str()
            {
                names.push(format!("{}/{file}", name.trim_end_matches('/')));
            }
        }
        names.sort();
        Ok(names)
    }
}

/// Files that a session keeps.
#[derive(Clone, Debug, Default)]
pub struct KeptFiles {
    /// Bytes by name.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Files for KeptFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        self.files.get(name).cloned().ok_or_else(|| "the session does not keep this file".to_string())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "the session does not keep it".to_string())
    }
}
