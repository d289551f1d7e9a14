//! A folder for the sessions of a measurement. It is removed when the measurement ends; if a signal ended it, the next
//! measurement removes the folder.

use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use tempfile::TempDir;

use stillpoint::Failure;

/// Prefix of the names of such folders.
const PREFIX: &str = "stillpoint-bench-";
/// Name of the lock file in such a folder. The measurement holds the lock.
const LOCK: &str = "lock";

/// A folder that is removed when it is dropped.
pub struct Folder {
    at: TempDir,
    _lock: File,
}

impl Folder {
    /// Creates a folder below `parent`, or below the system's folder for temporary files. Removes the folders of
    /// measurements that have ended.
    pub fn create(parent: Option<&Path>) -> Result<Self, Failure> {
        let parent = parent.map_or_else(std::env::temp_dir, Path::to_path_buf);
        sweep(&parent);
        let made = std::fs::create_dir_all(&parent).and_then(|()| {
            let at = tempfile::Builder::new().prefix(PREFIX).tempdir_in(&parent)?;
            let lock = File::create(at.path().join(LOCK))?;
            flock(&lock, FlockOperation::NonBlockingLockExclusive)?;
            Ok(Self { at, _lock: lock })
        });
        made.map_err(|e| Failure::failed(format!("{}: {e}; name a folder with --folder", parent.display())))
    }

    /// Path of this name in the folder. A folder that is already there is removed.
    pub fn free(&self, name: &str) -> Result<PathBuf, Failure> {
        let path = self.at.path().join(name);
        if path.exists() {
            std::fs::remove_dir_all(&path).map_err(Failure::failed)?;
        }
        Ok(path)
    }
}

/// Removes the folders of measurements that have ended. A folder that cannot be removed belongs to another user.
fn sweep(parent: &Path) {
    let Ok(entries) = std::fs::read_dir(parent) else { return };
    for entry in entries.flatten() {
        let is_one = entry.file_name().to_str().is_some_and(|name| name.starts_with(PREFIX));
        if is_one && is_left(&entry.path()) {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

/// Whether no process holds the lock of a folder. A folder without a lock is being created at this moment.
fn is_left(folder: &Path) -> bool {
    let lock = OpenOptions::new().write(true).open(folder.join(LOCK));
    lock.is_ok_and(|lock| flock(&lock, FlockOperation::NonBlockingLockExclusive).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_benches_that_ended_go_and_others_stay() {
        let parent = tempfile::tempdir().unwrap();
        let (left, other) =
            (parent.path().join("stillpoint-bench-1"), parent.path().join("stillpoint-bench-2"));
        for folder in [&left, &other] {
            std::fs::create_dir(folder).unwrap();
        }
        File::create(left.join(LOCK)).unwrap();
        let first = Folder::create(Some(parent.path())).ok().unwrap();
        let second = Folder::create(Some(parent.path())).ok().unwrap();
        assert!(!left.exists() && other.is_dir());
        assert!(first.at.path().is_dir() && second.at.path().is_dir());
        let gone = first.at.path().to_owned();
        drop(first);
        assert!(!gone.exists());
    }
}
