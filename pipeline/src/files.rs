//! The files that parameters name: as they were when a run began, and as a session keeps them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use stillpoint_operator::files::{DiskFiles, Files, listed};
use stillpoint_recorder::Session;

use crate::graph::Graph;
use crate::session::{FILES, HASHES, hex};

/// Where the bytes of a file are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Place {
    Disk(PathBuf),
    Here(Vec<u8>),
}

/// The files of a run as they were when it began: every process reads these, also one that is started again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Snapshot {
    files: BTreeMap<String, Place>,
}

impl Snapshot {
    /// The files that a graph names, where they are.
    pub fn of(graph: &Graph, disk: &DiskFiles) -> Result<Self, String> {
        let mut files = BTreeMap::new();
        for name in graph.operators.iter().flat_map(|o| &o.files) {
            for file in disk.list(name).map_err(|e| format!("{name}: {e}"))? {
                let place = match disk.carried.get(&file) {
                    Some(bytes) => Place::Here(bytes.clone()),
                    None => Place::Disk(disk.path(&file)),
                };
                files.insert(file, place);
            }
        }
        Ok(Self { files })
    }

    /// Copies of them in `folder`: what happens to the originals from now on is not seen.
    pub fn copied_to(&self, folder: &Path) -> Result<Self, String> {
        let mut files = BTreeMap::new();
        std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        for (number, (name, place)) in self.files.iter().enumerate() {
            let copy = folder.join(number.to_string());
            let copied = match place {
                Place::Disk(path) => std::fs::copy(path, &copy).map(|_| ()),
                Place::Here(bytes) => std::fs::write(&copy, bytes),
            };
            copied.map_err(|e| format!("{name}: {e}"))?;
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

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "it is not among the files of this run".to_string())
    }
}

/// The files that a session kept when it began. One that was lost or changed since stands in its folder as before, but
/// cannot be read.
#[derive(Clone, Debug, Default)]
pub struct SessionFiles {
    files: BTreeMap<String, Result<Vec<u8>, String>>,
}

impl SessionFiles {
    /// The files among the attachments of a session, held against the hashes that its metadata says.
    pub fn of(session: &Session) -> Self {
        let mut files: BTreeMap<String, Result<Vec<u8>, String>> = session
            .attachments()
            .iter()
            .filter_map(|(name, a)| Some((name.strip_prefix(FILES)?.to_string(), Ok(a.bytes.clone()))))
            .collect();
        for (name, hash) in session.metadata().get(HASHES).into_iter().flatten() {
            let wrong = match files.get(name) {
                Some(Ok(bytes)) if hex(&Sha256::digest(bytes)) == *hash => continue,
                Some(_) => "the bytes of this file in the session are not those that were recorded",
                None => "the session lacks this file",
            };
            files.insert(name.clone(), Err(wrong.to_string()));
        }
        Self { files }
    }

    /// The files that cannot be read, with the reason.
    pub fn lacking(&self) -> impl Iterator<Item = (&str, &str)> {
        self.files.iter().filter_map(|(name, file)| Some((name.as_str(), file.as_ref().err()?.as_str())))
    }
}

impl Files for SessionFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        self.files
            .get(name)
            .cloned()
            .unwrap_or_else(|| Err("the session does not keep this file".to_string()))
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "the session does not keep it".to_string())
    }
}
