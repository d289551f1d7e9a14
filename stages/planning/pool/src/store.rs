//! Contents by their hash, in a folder of bounded size.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, TryLockError};
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use stillpoint_map::{MappedFile, publish_derived};

use crate::Hash;

/// Why a content is not put into a store or read from it.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The folder cannot be made or read.
    #[error("the cache {}: {error}; give another folder", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What the system answered.
        error: std::io::Error,
    },
    /// Another process uses the folder.
    #[error("the cache {} is in use by another worker; give each worker a folder of its own with --cache", folder.display())]
    InUse {
        /// The folder.
        folder: PathBuf,
    },
    /// A file cannot be written.
    #[error("the cache cannot write {}: {error}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system answered.
        error: std::io::Error,
    },
    /// There is no room.
    #[error(
        "the arguments of a call do not fit into the cache of {} MB; allow more with --cache-mb",
        most / 1_000_000
    )]
    Full {
        /// The most bytes that it holds.
        most: u64,
    },
    /// The content is not there.
    #[error("the cache does not hold {0:.16}")]
    Missing(Hash),
    /// The content cannot be read.
    #[error("the cache cannot read {hash:.16}: {error}")]
    Read {
        /// The content.
        hash: Hash,
        /// What the system answered.
        error: std::io::Error,
    },
}

/// The file whose lock the process holds that uses the folder.
const LOCK: &str = "lock";

/// A folder of files, each named by the SHA-256 of its bytes. The one used longest ago goes first. Other files stay as they
/// are.
pub struct Store {
    _lock: File,
    folder: PathBuf,
    most: u64,
    held: BTreeMap<Hash, Held>,
    bytes: u64,
    uses: u64,
}

struct Held {
    length: u64,
    used: u64,
    /// Whether this process has compared the file with its name.
    checked: bool,
}

impl Store {
    /// The store in a folder, which is made if it is not there, of at most this many bytes. Files of an earlier process
    /// are used again.
    ///
    /// # Errors
    /// The folder cannot be made or read, or another process uses it.
    pub fn open(folder: &Path, most: u64) -> Result<Self, StoreError> {
        let fault = |error| StoreError::Folder { folder: folder.to_owned(), error };
        std::fs::create_dir_all(folder).map_err(fault)?;
        let lock = File::options().create(true).truncate(false).write(true).open(folder.join(LOCK));
        let lock = lock.map_err(fault)?;
        lock.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => StoreError::InUse { folder: folder.to_owned() },
            TryLockError::Error(error) => fault(error),
        })?;
        let mut store =
            Self { _lock: lock, folder: folder.to_owned(), most, held: BTreeMap::new(), bytes: 0, uses: 0 };
        for entry in std::fs::read_dir(folder).map_err(fault)?.flatten() {
            let name = entry.file_name();
            let length = entry.metadata().map_or(0, |data| data.len());
            match name.to_str().and_then(Hash::parse) {
                Some(hash) => {
                    store.held.insert(hash, Held { length, used: 0, checked: false });
                    store.bytes += length;
                }
                // A file that an earlier process did not finish.
                None if name.to_str().is_some_and(is_part) => {
                    let _ = std::fs::remove_file(entry.path());
                }
                None => {}
            }
        }
        store.make_room(&BTreeSet::new());
        Ok(store)
    }

    /// Bytes held, and the most.
    pub fn size(&self) -> (u64, u64) {
        (self.bytes, self.most)
    }

    /// Whether the content is there and is what its name says. A file that has changed is removed.
    pub fn holds(&mut self, hash: &Hash) -> bool {
        let path = self.path(hash);
        self.uses += 1;
        let Some(held) = self.held.get_mut(hash) else { return false };
        held.used = self.uses;
        if !held.checked {
            held.checked = MappedFile::open(&path).is_ok_and(|file| Hash::of(file.bytes()) == *hash);
        }
        if held.checked && path.exists() {
            return true;
        }
        self.remove(hash);
        false
    }

    /// Puts a content there and gives its name. Others go if there is no room, but none of `keep`.
    ///
    /// # Errors
    /// The file cannot be written, or there is no room beside `keep`.
    pub fn put(&mut self, bytes: &[u8], keep: &BTreeSet<Hash>) -> Result<Hash, StoreError> {
        let hash = Hash::of(bytes);
        self.put_named(hash, bytes, keep).map(|()| hash)
    }

    /// The same of bytes that were compared with their name just now.
    ///
    /// # Errors
    /// As [`put`](Self::put).
    pub fn put_named(&mut self, hash: Hash, bytes: &[u8], keep: &BTreeSet<Hash>) -> Result<(), StoreError> {
        if self.holds(&hash) {
            return Ok(());
        }
        let path = self.path(&hash);
        // A later process compares the file with its name before it uses it.
        publish_derived(&path, |file| file.write_all(bytes))
            .map_err(|error| StoreError::Write { path, error })?;
        self.uses += 1;
        let length = bytes.len() as u64;
        self.held.insert(hash, Held { length, used: self.uses, checked: true });
        self.bytes += length;
        let mut keep = keep.clone();
        keep.insert(hash);
        self.make_room(&keep);
        if self.bytes > self.most {
            self.remove(&hash);
            return Err(StoreError::Full { most: self.most });
        }
        Ok(())
    }

    /// Where a content is.
    pub fn path(&self, hash: &Hash) -> PathBuf {
        self.folder.join(hash.to_string())
    }

    /// The content.
    ///
    /// # Errors
    /// It is not there.
    pub fn read(&mut self, hash: &Hash) -> Result<MappedFile, StoreError> {
        if !self.holds(hash) {
            return Err(StoreError::Missing(*hash));
        }
        MappedFile::open(&self.path(hash)).map_err(|error| StoreError::Read { hash: *hash, error })
    }

    /// Length of a content, and its bytes from `start`, at most `most` of them.
    pub fn part(&mut self, hash: &Hash, start: u64, most: usize) -> Option<(u64, Vec<u8>)> {
        if !self.holds(hash) {
            return None;
        }
        let length = self.held.get(hash)?.length;
        let rest = usize::try_from(length.checked_sub(start)?).ok()?.min(most);
        let mut bytes = vec![0; rest];
        File::open(self.path(hash)).ok()?.read_exact_at(&mut bytes, start).ok()?;
        Some((length, bytes))
    }

    fn make_room(&mut self, keep: &BTreeSet<Hash>) {
        while self.bytes > self.most {
            let others = self.held.iter().filter(|(hash, _)| !keep.contains(hash));
            let Some(oldest) = others.min_by_key(|(_, held)| held.used).map(|(hash, _)| *hash) else {
                return;
            };
            self.remove(&oldest);
        }
    }

    fn remove(&mut self, hash: &Hash) {
        if let Some(held) = self.held.remove(hash) {
            self.bytes -= held.length;
        }
        // A file that is gone is gone; readers that have it mapped keep it.
        let _ = std::fs::remove_file(self.path(hash));
    }
}

/// Whether a file is a content that was being written: `HASH.PROCESS-NUMBER.part`, as `publish_derived` names it.
fn is_part(name: &str) -> bool {
    let middle = name.strip_suffix(".part").and_then(|name| name.split_once('.'));
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    middle.is_some_and(|(hash, writer)| {
        let numbers = writer.split_once('-');
        Hash::parse(hash).is_some() && numbers.is_some_and(|(process, n)| is_number(process) && is_number(n))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_content_used_longest_ago_makes_room() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = Store::open(folder.path(), 30).unwrap();
        let none = BTreeSet::new();
        let [a, b] = [[1_u8; 10], [2; 10]].map(|bytes| store.put(&bytes, &none).unwrap());
        store.put(&[3; 10], &none).unwrap();
        assert!(store.holds(&a));
        store.put(&[4; 10], &none).unwrap();
        assert!(store.holds(&a) && !store.holds(&b));
        assert_eq!(store.size(), (30, 30));
        let refused = store.put(&[5; 25], &BTreeSet::from([a])).unwrap_err().to_string();
        assert!(refused.contains("do not fit"), "{refused}");
        assert!(store.holds(&a) && store.size().0 <= 30);
    }

    #[test]
    fn files_of_an_earlier_process_are_used_unless_they_have_changed() {
        let folder = tempfile::tempdir().unwrap();
        let none = BTreeSet::new();
        let [a, b] = {
            let mut store = Store::open(folder.path(), 100).unwrap();
            [[1_u8; 10], [2; 10]].map(|bytes| store.put(&bytes, &none).unwrap())
        };
        std::fs::write(folder.path().join(b.to_string()), [7; 10]).unwrap();
        std::fs::write(folder.path().join(format!("{b}.12-3.part")), [7; 10]).unwrap();
        let mut store = Store::open(folder.path(), 100).unwrap();
        assert!(store.holds(&a) && !store.holds(&b));
        assert_eq!(store.part(&a, 4, 3), Some((10, vec![1; 3])));
        assert_eq!(store.part(&a, 11, 3), None);
        // The content and the lock.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn files_of_others_stay_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let hash = Hash::of(b"a");
        let foreign =
            ["film.part".to_owned(), format!("{hash}.part"), format!("{hash}.1-x.part"), "a".to_owned()];
        for name in &foreign {
            std::fs::write(folder.path().join(name), b"mine").unwrap();
        }
        Store::open(folder.path(), 100).unwrap();
        for name in &foreign {
            assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), b"mine", "{name}");
        }
    }

    #[test]
    fn a_folder_that_another_worker_uses_is_refused_until_that_ends() {
        let folder = tempfile::tempdir().unwrap();
        let first = Store::open(folder.path(), 100).unwrap();
        let reason = Store::open(folder.path(), 100).err().unwrap().to_string();
        assert!(reason.contains("in use by another worker"), "{reason}");
        drop(first);
        assert!(Store::open(folder.path(), 100).is_ok());
    }
}
