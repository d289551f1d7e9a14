//! The files that parameters name, as they were when a run began.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use stillpoint_operator::files::{DiskFiles, FilePlace, Files, FilesError, listed};

use crate::graph::{Graph, OperatorNode};

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
    /// What operators leave out of their files, by operator.
    #[serde(default)]
    remarks: BTreeMap<String, Vec<String>>,
}

impl Snapshot {
    /// The files that a graph names, where they are; of those that its operators read in part, that part.
    pub fn of(graph: &Graph, disk: &DiskFiles) -> Result<Self, FileError> {
        let mut files = BTreeMap::new();
        let mut parts = parts(graph, disk)?;
        for name in graph.files() {
            for file in disk.list(name).map_err(|e| FileError::new(name, &e))? {
                let place = match (parts.remove(&file), disk.place(&file)) {
                    (Some(bytes), _) | (None, FilePlace::Memory(bytes)) => Place::Here(bytes),
                    (None, FilePlace::Disk(path)) => Place::Disk(path),
                };
                files.entry(file).or_insert(place);
            }
        }
        let of = |node: &OperatorNode| (node.name.clone(), (node.stage.remarks)(&node.params, disk));
        let nodes = graph.operators.iter().filter(|node| !node.files.is_empty());
        let remarks = nodes.map(of).filter(|(_, remarks)| !remarks.is_empty()).collect();
        Ok(Self { files, remarks })
    }

    /// The files that a graph names, as `files` gives them, in memory.
    pub fn in_memory(graph: &Graph, files: &dyn Files) -> Result<Self, FileError> {
        let mut held = BTreeMap::new();
        for name in graph.files() {
            for file in files.list(name).map_err(|e| FileError::new(name, &e))? {
                let bytes = files.read(&file).map_err(|e| FileError::new(&file, &e))?;
                held.insert(file, Place::Here(bytes));
            }
        }
        Ok(Self { files: held, remarks: BTreeMap::new() })
    }

    /// What operators leave out of their files, by operator.
    pub fn remarks(&self) -> &BTreeMap<String, Vec<String>> {
        &self.remarks
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
        Ok(Self { files, remarks: self.remarks.clone() })
    }
}

/// The files of which the operators of a graph read a part alone, with that part.
fn parts(graph: &Graph, disk: &DiskFiles) -> Result<BTreeMap<String, Vec<u8>>, FileError> {
    // The hosts of a pipeline compare their files, and each knows the operators of its own part alone.
    if graph.part.is_some() {
        return Ok(BTreeMap::new());
    }
    let mut by_kind = BTreeMap::<&str, Vec<&OperatorNode>>::new();
    for node in graph.operators.iter().filter(|node| !node.files.is_empty()) {
        by_kind.entry(node.stage.kind.name).or_default().push(node);
    }
    let (mut parts, mut whole) = (BTreeMap::new(), BTreeSet::new());
    let mut named: Vec<(&String, &str)> = Vec::new();
    for (kind, nodes) in by_kind {
        let params: Vec<_> = nodes.iter().map(|node| &node.params).collect();
        let cut =
            (nodes[0].stage.cut_files)(&params, disk).map_err(|e| FileError::new(&nodes[0].name, &e))?;
        named.extend(nodes.iter().flat_map(|node| &node.files).map(|name| (name, kind)));
        parts.extend(cut.into_iter().map(|(file, bytes)| (file, (kind, bytes))));
    }
    // What another kind names, too, it reads whole.
    for (name, kind) in named {
        for file in disk.list(name).map_err(|e| FileError::new(name, &e))? {
            if parts.get(&file).is_some_and(|(of, _)| *of != kind) {
                whole.insert(file);
            }
        }
    }
    Ok(parts
        .into_iter()
        .filter(|(file, _)| !whole.contains(file))
        .map(|(f, (_, bytes))| (f, bytes))
        .collect())
}

const NOT_OF_RUN: FilesError = FilesError::Unavailable("it is not among the files of this run");

impl Files for Snapshot {
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError> {
        match self.files.get(name).ok_or(NOT_OF_RUN)? {
            Place::Disk(path) => Ok(std::fs::read(path)?),
            Place::Here(bytes) => Ok(bytes.clone()),
        }
    }

    fn shared_mode(&self, name: &str) -> Option<u32> {
        match self.files.get(name)? {
            Place::Disk(path) => FilePlace::Disk(path.clone()).shared_mode(),
            Place::Here(_) => None,
        }
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        listed(&self.files, name).ok_or(NOT_OF_RUN)
    }
}
