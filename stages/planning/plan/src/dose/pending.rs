//! Doses that others computed, apart from those of a cache as long as they may be in doubt.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

/// The file whose lock the process holds that uses the folder.
const LOCK: &str = "lock";

/// A folder within that of a cache, which one process uses. What is there when it ends, or was left by one that was killed, is
/// removed.
#[derive(Debug)]
pub(super) struct Pending {
    folder: PathBuf,
    _lock: File,
}

impl Pending {
    /// The first such folder that no other process uses.
    pub fn within(cache: &Path) -> io::Result<Self> {
        let mut number = 0;
        loop {
            let folder = cache.join(format!("pending-{number}"));
            std::fs::create_dir_all(&folder)?;
            let lock = File::options().create(true).truncate(false).write(true).open(folder.join(LOCK))?;
            match lock.try_lock() {
                Ok(()) => {
                    let pending = Self { folder, _lock: lock };
                    pending.files()?.iter().try_for_each(std::fs::remove_file)?;
                    return Ok(pending);
                }
                Err(TryLockError::WouldBlock) => number += 1,
                Err(TryLockError::Error(fault)) => return Err(fault),
            }
        }
    }

    /// The folder itself.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Moves all files into the folder of the cache.
    pub fn adopt(&self, cache: &Path) -> io::Result<()> {
        self.files()?.iter().try_for_each(|file| match file.file_name() {
            Some(name) => std::fs::rename(file, cache.join(name)),
            None => Ok(()),
        })
    }

    fn files(&self) -> io::Result<Vec<PathBuf>> {
        let entries = std::fs::read_dir(&self.folder)?.map(|entry| entry.map(|entry| entry.path()));
        let paths: Vec<PathBuf> = entries.collect::<io::Result<_>>()?;
        Ok(paths.into_iter().filter(|path| path.file_name().is_some_and(|name| name != LOCK)).collect())
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        // What cannot be removed now is removed by the next process that uses the folder.
        for file in self.files().unwrap_or_default() {
            let _ = std::fs::remove_file(file);
        }
    }
}
