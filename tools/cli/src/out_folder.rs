//! The folder into which a command writes what it made.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use rustix::fs::Access;

use crate::exit::Failure;

/// The folder of `--out`.
pub struct OutFolder(PathBuf);

impl OutFolder {
    /// Makes the folder, or says before any work is done that it cannot be written.
    pub fn ready(path: &Path) -> Result<Self, Failure> {
        let fault = |e: &dyn std::fmt::Display| {
            Failure::failed(format!("{}: {e}; give another folder with --out", path.display()))
        };
        std::fs::create_dir_all(path).map_err(|e| fault(&e))?;
        rustix::fs::access(path, Access::WRITE_OK | Access::EXEC_OK).map_err(|e| fault(&e))?;
        Ok(Self(path.to_owned()))
    }

    /// Removes a file, if it is there.
    pub fn remove(&self, name: &str) -> Result<(), Failure> {
        let path = self.0.join(name);
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != ErrorKind::NotFound => {
                Err(Failure::failed(format!("{}: {e}", path.display())))
            }
            _ => Ok(()),
        }
    }

    /// Writes a file as a whole; it is the user's own, since it can name a person.
    pub fn put(&self, name: &str, bytes: &[u8]) -> Result<PathBuf, Failure> {
        let path = self.0.join(name);
        stillpoint_map::publish(&path, |file| file.write_all(bytes))
            .map_err(|e| Failure::failed(format!("{}: {e}", path.display())))?;
        Ok(path)
    }
}
