//! The folder of a session: `part-000.mcap`, `part-001.mcap`, ... Only its owner may read it: sessions hold faces.

use std::fs::{DirBuilder, File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// Makes the folder of a new session, mode 0700.
///
/// # Errors
/// It is there already, or what the operating system answers.
pub fn create_session(path: &Path) -> io::Result<()> {
    if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent)?;
    }
    DirBuilder::new().mode(0o700).create(path)
}

/// Creates the next part of a session, mode 0600: the first part, or the part after the last one. It is locked as long
/// as the file is open, so that no other program repairs it meanwhile.
///
/// # Errors
/// What the operating system answers.
pub fn create_part(session: &Path) -> io::Result<(PathBuf, File)> {
    let mut number = session_parts(session)?.iter().filter_map(|p| part_number(p)).max().map_or(0, |n| n + 1);
    loop {
        let path = session.join(format!("part-{number:03}.mcap"));
        match create_private(&path) {
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => number += 1,
            made => {
                let file = made?;
                // Whoever looks holds it for a moment only. A file system without locks goes without.
                let _ = file.lock();
                return Ok((path, file));
            }
        }
    }
}

/// Creates a file that is not there yet, mode 0600.
///
/// # Errors
/// It is there already, or what the operating system answers.
pub fn create_private(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)
}

/// Whether the writer of a part has it open, in whatever process.
pub(crate) fn is_being_written(part: &File) -> bool {
    match part.try_lock_shared() {
        Ok(()) => {
            let _ = part.unlock();
            false
        }
        Err(TryLockError::WouldBlock) => true,
        Err(TryLockError::Error(_)) => false,
    }
}

/// The parts of a session in their order; a file is a session of one part.
///
/// # Errors
/// What the operating system answers.
pub fn session_parts(path: &Path) -> io::Result<Vec<PathBuf>> {
    if !std::fs::metadata(path)?.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut parts = Vec::new();
    for entry in std::fs::read_dir(path)? {
        let path = entry?.path();
        if let Some(number) = part_number(&path) {
            parts.push((number, path));
        }
    }
    parts.sort();
    Ok(parts.into_iter().map(|(_, path)| path).collect())
}

/// Whether a part is so short that its recorder died before it wrote anything: it is not an MCAP file, and it is empty.
pub(crate) fn is_blank(part: &Path) -> io::Result<bool> {
    let bytes = std::fs::metadata(part)?.len();
    Ok(bytes < mcap::MAGIC.len() as u64)
}

fn part_number(path: &Path) -> Option<u32> {
    path.file_name()?.to_str()?.strip_prefix("part-")?.strip_suffix(".mcap")?.parse().ok()
}
