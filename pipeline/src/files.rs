//! Where the files that parameters name are read from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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

impl Files for DiskFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        std::fs::read(self.base.join(name)).map_err(|e| e.to_string())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        let path = self.base.join(name);
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
        if self.files.contains_key(name) {
            return Ok(vec![name.to_string()]);
        }
        let folder = format!("{}/", name.trim_end_matches('/'));
        let inside: Vec<_> = self
            .files
            .keys()
            .filter(|f| f.strip_prefix(&folder).is_some_and(|rest| !rest.contains('/')))
            .cloned()
            .collect();
        if inside.is_empty() { Err("the session does not keep this folder".to_string()) } else { Ok(inside) }
    }
}
