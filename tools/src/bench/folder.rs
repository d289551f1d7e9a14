//! A folder for the sessions of a bench. It goes when the bench is over, or with the next one where a signal ended it.

use std::path::{Path, PathBuf};

use crate::exit::Failure;

/// Of the names of such folders; the number of the process comes behind it.
const PREFIX: &str = "stillpoint-bench-";

/// The folder.
pub struct Folder(PathBuf);

impl Folder {
    /// Makes one below `parent`, or below the system's folder for such things.
    pub fn create(parent: Option<&Path>) -> Result<Self, Failure> {
        let parent = parent.map_or_else(std::env::temp_dir, Path::to_path_buf);
        sweep(&parent);
        let path = parent.join(format!("{PREFIX}{}", std::process::id()));
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

/// Removes the folders of benches that are no longer there. One that cannot be removed is somebody else's.
fn sweep(parent: &Path) {
    let Ok(entries) = std::fs::read_dir(parent) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let number = name.to_str().and_then(|name| name.strip_prefix(PREFIX)?.parse::<u32>().ok());
        if number.is_some_and(|number| !Path::new(&format!("/proc/{number}")).exists()) {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_benches_that_ended_go_and_others_stay() {
        let parent = tempfile::tempdir().unwrap();
        let kept = ["stillpoint-bench-x", "stillpoint-bench-1"];
        // No process has the greatest number.
        let gone = format!("{PREFIX}{}", u32::MAX);
        for name in kept.into_iter().chain([gone.as_str()]) {
            std::fs::create_dir(parent.path().join(name)).unwrap();
        }
        let folder = Folder::create(Some(parent.path())).ok().unwrap();
        assert!(folder.0.is_dir() && !parent.path().join(gone).exists());
        assert!(kept.iter().all(|name| parent.path().join(name).is_dir()));
    }
}
