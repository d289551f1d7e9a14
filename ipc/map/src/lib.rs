//! Files mapped into memory, read-only: large derived data that many processes read without a copy.
//!
//! ```
//! # fn main() -> std::io::Result<()> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("dose");
//! stillpoint_map::publish(&path, |file| std::io::Write::write_all(file, b"derived"))?;
//! assert_eq!(stillpoint_map::MappedFile::open(&path)?.bytes(), b"derived");
//! # Ok(()) }
//! ```

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// A file, mapped read-only. Its bytes start at a page, so they are aligned for every number.
///
/// The file must not be written to or cut while it is mapped; one that [`publish`] or [`publish_derived`] put there never
/// is, for it is replaced as a whole. A file cut by other means ends the process with SIGBUS where its lost part is read.
#[derive(Debug)]
pub struct MappedFile(memmap2::Mmap);

impl MappedFile {
    /// Maps a file.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        if !file.metadata()?.is_file() {
            return Err(io::Error::new(ErrorKind::InvalidInput, "not a plain file"));
        }
        // It is read as a whole at once, to be checked: its pages are brought in together.
        // SAFETY: the map is private to this type, read-only, and lends bytes no longer than it lives. That nobody
        // writes to the file is the contract above: `publish` never changes a file in place.
        unsafe { memmap2::MmapOptions::new().populate().map(&file) }.map(Self)
    }

    /// What the file holds.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// Writes a file beside `path` and, when it is whole, puts it there: a reader finds the old file, the new one or none.
/// The file is the user's own (mode 0600). Its content is forced to the disk before it gets its name.
pub fn publish(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
    replace(path, |file| {
        write(file)?;
        file.sync_all()
    })
}

/// The same without waiting for the disk, for what can be made again: after a power failure the file may be cut or empty, so
/// each process that opens it has to check its content.
pub fn publish_derived(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
    replace(path, write)
}

fn replace(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let mut name = path.file_name().ok_or_else(|| io::Error::from(ErrorKind::InvalidInput))?.to_owned();
    name.push(format!(".{}-{}.part", std::process::id(), NUMBER.fetch_add(1, Ordering::Relaxed)));
    let part = path.with_file_name(name);
    let opened = OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&part);
    let whole = opened.and_then(|mut file| write(&mut file));
    whole.and_then(|()| std::fs::rename(&part, path)).inspect_err(|_| {
        // The first error is the one to tell; a part that cannot be removed either harms nobody.
        let _ = std::fs::remove_file(&part);
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_mapped_file_keeps_its_bytes_while_another_takes_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        publish(&path, |file| file.write_all(&[1; 10_000])).unwrap();
        let old = MappedFile::open(&path).unwrap();
        publish_derived(&path, |file| file.write_all(&[2; 20])).unwrap();
        assert_eq!(old.bytes(), [1; 10_000]);
        let new = MappedFile::open(&path).unwrap();
        publish(&path, |file| file.write_all(&[3; 30])).unwrap();
        assert_eq!(new.bytes(), [2; 20]);
        assert_eq!(MappedFile::open(&path).unwrap().bytes(), [3; 30]);
    }

    #[test]
    fn a_write_that_fails_leaves_the_old_file_and_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        publish(&path, |file| file.write_all(b"old")).unwrap();
        let failed = publish(&path, |file| {
            file.write_all(b"half")?;
            Err(ErrorKind::StorageFull.into())
        });
        assert_eq!(failed.unwrap_err().kind(), ErrorKind::StorageFull);
        assert_eq!(MappedFile::open(&path).unwrap().bytes(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn folders_are_refused_and_empty_files_are_empty() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(MappedFile::open(folder.path()).unwrap_err().kind(), ErrorKind::InvalidInput);
        let path = folder.path().join("empty");
        publish(&path, |_| Ok(())).unwrap();
        assert_eq!(MappedFile::open(&path).unwrap().bytes(), b"");
    }
}
