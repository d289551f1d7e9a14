//! A folder for the sessions of a bench. It goes when the bench is over.

use std::path::{Path, PathBuf};

use crate::exit::Failure;

/// The folder.
pub struct Folder(PathBuf);

impl Folder {
    /// Makes one below `parent`, or below the system's folder for such things.
    pub fn create(parent: Option<&Path>) -> Result<Self, Failure> {
        let parent = parent.map_or_else(std::env::temp_dir, Path::to_path_buf);
        let path = parent.join(format!("stillpoint-bench-{}", std::process::id()));
        std::fs::create_dir_all(&path)
            .map_err(|e| Failure::failed(format!("{}: {e}; name a folder with --folder", path.display())))?;
        Ok(Self(path))
    }

    /// A place in it where nothing is yet.
    pub fn free(&self, name: &str) -> Result<PathBuf, Failure> {
        let path = self.0.join(name);
        if path.exists() {
            std::fs::remove_dir_all(&path).map_err(Failure::failed)?;
        }
        Ok(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
