//! Where the files that parameters name are read from.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use crate::pattern;

/// Why a file is not read, or files are not listed.
#[derive(Debug, thiserror::Error)]
pub enum FilesError {
    /// The operating system refused.
    #[error(transparent)]
    System(#[from] std::io::Error),
    /// A name is not text.
    #[error("the name of the file {0} is not UTF-8")]
    Name(String),
    /// The place does not have it, for this reason.
    #[error("{0}")]
    Unavailable(&'static str),
}

/// Where the files that parameters name are read: the disk in a live run, the session in a replay.
pub trait Files {
    /// Bytes of the file.
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError>;
    /// Permission bits of the file, where the group or others may read it on the disk; else `None`.
    fn shared_mode(&self, _name: &str) -> Option<u32> {
        None
    }
    /// The files that a path names, in the order of their names with numbers by their value (`in_order`): one file, the
    /// files of a folder, or the files whose names fit a last part with `*`. As for a shell, `*` does not stand for the
    /// dot of a hidden file.
    fn list(&self, name: &str) -> Result<Vec<String>, FilesError>;
}

/// Where the bytes of a file are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FilePlace {
    /// In a file on disk.
    Disk(PathBuf),
    /// In memory: the file comes with the program.
    Memory(Vec<u8>),
}

impl FilePlace {
    /// Permission bits of a file on disk that the group or others may read; else `None`.
    pub fn shared_mode(&self) -> Option<u32> {
        let Self::Disk(path) = self else { return None };
        let mode = std::fs::metadata(path).ok()?.permissions().mode() & 0o777;
        (mode & 0o044 != 0).then_some(mode)
    }
}

/// Files on disk, beside the pipeline's file, and those that come with the program.
#[derive(Clone, Debug, Default)]
pub struct DiskFiles {
    base: PathBuf,
    carried: BTreeMap<String, Vec<u8>>,
}

impl DiskFiles {
    /// Files named relative to the folder of `pipeline_file`.
    pub fn next_to(pipeline_file: &Path) -> Self {
        let base = pipeline_file.parent().map(Path::to_path_buf).unwrap_or_default();
        Self { base, carried: BTreeMap::new() }
    }

    /// The same with files that come with the program: a name of theirs is not looked for on disk.
    #[must_use]
    pub fn carrying(mut self, files: &[(&str, &[u8])]) -> Self {
        self.carried.extend(files.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())));
        self
    }

    /// Where a file is on disk.
    fn path(&self, name: &str) -> PathBuf {
        self.base.join(name)
    }

    /// Where the bytes of a file are.
    pub fn place(&self, name: &str) -> FilePlace {
        match self.carried.get(name) {
            Some(bytes) => FilePlace::Memory(bytes.clone()),
            None => FilePlace::Disk(self.path(name)),
        }
    }
}

impl Files for DiskFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError> {
        match self.carried.get(name) {
            Some(bytes) => Ok(bytes.clone()),
            None => Ok(std::fs::read(self.path(name))?),
        }
    }

    fn shared_mode(&self, name: &str) -> Option<u32> {
        self.place(name).shared_mode()
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        if let Some(carried) = listed(&self.carried, name) {
            return Ok(carried);
        }
        let path = self.path(name);
        if path.is_file() {
            return Ok(vec![name.to_string()]);
        }
        let (folder, like) = match pattern::parts(name) {
            (folder, like) if pattern::is_one(name) => (folder, like),
            _ => (name.trim_end_matches('/'), "*"),
        };
        let mut names = Vec::new();
        for entry in std::fs::read_dir(self.path(if folder.is_empty() { "." } else { folder }))? {
            let entry = entry?;
            let file = entry.file_name();
            let shown = file.to_string_lossy();
            // What is broken, such as a link to nothing, stays in the list: reading it says why.
            let is_other = entry.path().metadata().is_ok_and(|found| !found.is_file());
            if is_other || !pattern::matches(like, &shown) {
                continue;
            }
            let file = file.to_str().ok_or_else(|| FilesError::Name(shown.to_string()))?;
            names.push(if folder.is_empty() { file.to_owned() } else { format!("{folder}/{file}") });
        }
        names.sort_by(|a, b| in_order(a, b));
        Ok(names)
    }
}

/// Files that are nowhere but in memory.
#[derive(Clone, Debug, Default)]
pub struct MemoryFiles {
    /// Bytes by name.
    pub files: BTreeMap<String, Vec<u8>>,
}

impl Files for MemoryFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError> {
        self.files.get(name).cloned().ok_or(FilesError::Unavailable("there is no such file"))
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        listed(&self.files, name).ok_or(FilesError::Unavailable("there is no such file"))
    }
}

/// The order of names of files: runs of digits by their value, so that `frame_9` comes before `frame_10`, and the rest as
/// text. Names that differ in leading zeros alone are in the order of their text.
pub fn in_order(a: &str, b: &str) -> Ordering {
    let (mut left, mut right) = (a.as_bytes(), b.as_bytes());
    loop {
        let digits = |text: &[u8]| text.iter().take_while(|c| c.is_ascii_digit()).count();
        let (m, n) = (digits(left), digits(right));
        let (first, second, order);
        if m > 0 && n > 0 {
            (first, left) = left.split_at(m);
            (second, right) = right.split_at(n);
            let (first, second) = (without_zeros(first), without_zeros(second));
            order = first.len().cmp(&second.len()).then_with(|| first.cmp(second));
        } else {
            match (left.split_first(), right.split_first()) {
                (Some((x, after)), Some((y, behind))) => {
                    order = x.cmp(y);
                    (left, right) = (after, behind);
                }
                (x, y) => return x.is_some().cmp(&y.is_some()).then_with(|| a.cmp(b)),
            }
        }
        if order != Ordering::Equal {
            return order;
        }
    }
}

fn without_zeros(digits: &[u8]) -> &[u8] {
    let zeros = digits.iter().take_while(|c| **c == b'0').count();
    &digits[zeros..]
}

/// The files of a map that a path names: a file by its own name, or the files of a pattern or a folder.
pub fn listed<T>(files: &BTreeMap<String, T>, name: &str) -> Option<Vec<String>> {
    if files.contains_key(name) {
        return Some(vec![name.to_string()]);
    }
    let every = pattern::inside(name, "*");
    let (folder, like) = pattern::parts(if pattern::is_one(name) { name } else { &every });
    let fits = |file: &&String| {
        let (of, rest) = pattern::parts(file);
        of == folder && pattern::matches(like, rest)
    };
    let mut inside: Vec<String> = files.keys().filter(fits).cloned().collect();
    inside.sort_by(|a, b| in_order(a, b));
    (!inside.is_empty()).then_some(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_comes_with_the_program_goes_before_one_on_disk_and_others_are_looked_for() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let files = DiskFiles::next_to(&folder.join("x.yaml")).carrying(&[("Cargo.toml", b"carried")]);
        assert_eq!(files.read("Cargo.toml").unwrap(), b"carried");
        assert!(files.read("src/lib.rs").unwrap().len() > 7);
        assert_eq!(files.list("Cargo.toml").unwrap(), ["Cargo.toml"]);
        assert!(files.read("nothing").is_err());
    }

    #[test]
    fn numbers_in_names_are_in_the_order_of_their_values() {
        let sorted = |names: &[&str]| names.is_sorted_by(|a, b| in_order(a, b) == Ordering::Less);
        assert!(sorted(&["f_2", "f_9", "f_10", "f_10b", "f_010c", "f_11"]));
        assert!(sorted(&["1.png", "2.png", "10.png", "a1", "a1b2", "a1b10", "b"]));
        assert!(sorted(&["f_9998", "f_10000", "f_99999999999999999999999", "f_100000000000000000000000"]));
        assert!(sorted(&["", "0", "00", "0a", "a"]));
        let files = ["s/frame_10000.png", "s/frame_9998.png", "s/._frame_1.png"];
        let retained = MemoryFiles { files: files.map(|n| (n.into(), Vec::new())).into() };
        assert_eq!(retained.list("s/*.png").unwrap(), ["s/frame_9998.png", "s/frame_10000.png"]);
    }

    #[test]
    fn a_pattern_or_a_folder_means_its_files_and_what_is_broken_is_not_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b_1.png", "a_1.png", "a_2.png", "notes.txt"] {
            std::fs::write(folder.path().join(name), name).unwrap();
        }
        std::fs::create_dir(folder.path().join("a_3.png")).unwrap();
        std::os::unix::fs::symlink("nowhere", folder.path().join("a_0.png")).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(folder.path().join("a_4.png")).unwrap();
        let disk = DiskFiles::next_to(&folder.path().parent().unwrap().join("x.yaml"));
        let name = folder.path().file_name().unwrap().to_str().unwrap();
        let under = |names: &[&str]| names.iter().map(|n| format!("{name}/{n}")).collect::<Vec<_>>();
        assert_eq!(disk.list(&format!("{name}/a_*.png")).unwrap(), under(&["a_0.png", "a_1.png", "a_2.png"]));
        assert_eq!(disk.list(name).unwrap().len(), 5);
        assert!(disk.read(&under(&["a_0.png"])[0]).is_err());
        let next_to = DiskFiles::next_to(&folder.path().join("x.yaml"));
        assert_eq!(next_to.list("*.txt").unwrap(), ["notes.txt"]);
        let retained = MemoryFiles {
            files: [("notes.txt", ""), ("s/a.png", ""), ("s/t/b.png", "")]
                .map(|(n, b)| (n.into(), b.into()))
                .into(),
        };
        assert_eq!(retained.list("*.txt").unwrap(), ["notes.txt"]);
        assert_eq!(
            (retained.list("s").unwrap(), retained.list("s/*.png").unwrap()),
            (vec!["s/a.png".into()], vec!["s/a.png".into()])
        );
        assert!(retained.list("s/*.pcd").is_err());
    }
}
