//! Where the files that parameters name are read from.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use stillpoint_recorder::Session;

use crate::graph::Graph;
use crate::pattern;
use crate::session::{FILES, HASHES, hex};
use crate::setup::Files;

/// Files on disk, beside the pipeline's file, and those that come with the program.
#[derive(Clone, Debug, Default)]
pub struct DiskFiles {
    base: PathBuf,
    carried: BTreeMap<String, Vec<u8>>,
}

impl DiskFiles {
    /// Files named relative to the folder of `pipeline_file`.
    pub fn beside(pipeline_file: &Path) -> Self {
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
}

/// Where the bytes of a file are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Place {
    Disk(PathBuf),
    Here(Vec<u8>),
}

/// The files of a run as they were when it began: every process reads these, also one that is started again.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Snapshot {
    files: BTreeMap<String, Place>,
}

impl Snapshot {
    /// The files that a graph names, where they are.
    pub fn of(graph: &Graph, disk: &DiskFiles) -> Result<Self, String> {
        let mut files = BTreeMap::new();
        for name in graph.operators.iter().flat_map(|o| &o.files) {
            for file in disk.list(name).map_err(|e| format!("{name}: {e}"))? {
                let place = match disk.carried.get(&file) {
                    Some(bytes) => Place::Here(bytes.clone()),
                    None => Place::Disk(disk.path(&file)),
                };
                files.insert(file, place);
            }
        }
        Ok(Self { files })
    }

    /// Copies of them in `folder`: what happens to the originals from now on is not seen.
    pub fn copied_to(&self, folder: &Path) -> Result<Self, String> {
        let mut files = BTreeMap::new();
        std::fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        for (number, (name, place)) in self.files.iter().enumerate() {
            let copy = folder.join(number.to_string());
            let copied = match place {
                Place::Disk(path) => std::fs::copy(path, &copy).map(|_| ()),
                Place::Here(bytes) => std::fs::write(&copy, bytes),
            };
            copied.map_err(|e| format!("{name}: {e}"))?;
            files.insert(name.clone(), Place::Disk(copy));
        }
        Ok(Self { files })
    }
}

impl Files for Snapshot {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        match self.files.get(name).ok_or("it is not among the files of this run")? {
            Place::Disk(path) => std::fs::read(path).map_err(|e| e.to_string()),
            Place::Here(bytes) => Ok(bytes.clone()),
        }
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "it is not among the files of this run".to_string())
    }
}

/// A file by its own name, or those that a pattern or a folder means.
fn listed<T>(files: &BTreeMap<String, T>, name: &str) -> Option<Vec<String>> {
    if files.contains_key(name) {
        return Some(vec![name.to_string()]);
    }
    let every = pattern::inside(name, "*");
    let (folder, like) = pattern::parts(if pattern::is_one(name) { name } else { &every });
    let fits = |file: &&String| {
        let (of, rest) = pattern::parts(file);
        of == folder && pattern::matches(like, rest)
    };
    let inside: Vec<String> = files.keys().filter(fits).cloned().collect();
    (!inside.is_empty()).then_some(inside)
}

impl Files for DiskFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        match self.carried.get(name) {
            Some(bytes) => Ok(bytes.clone()),
            None => std::fs::read(self.path(name)).map_err(|e| e.to_string()),
        }
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
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
        for entry in std::fs::read_dir(self.path(if folder.is_empty() { "." } else { folder }))
            .map_err(|e| e.to_string())?
        {
            let entry = entry.map_err(|e| e.to_string())?;
            let file = entry.file_name();
            let shown = file.to_string_lossy();
            // What is broken, such as a link to nothing, stays in the list: reading it says why.
            let is_other = entry.path().metadata().is_ok_and(|found| !found.is_file());
            if is_other || !pattern::matches(like, &shown) {
                continue;
            }
            let file = file.to_str().ok_or_else(|| format!("the name of the file {shown} is not UTF-8"))?;
            names.push(if folder.is_empty() { file.to_owned() } else { format!("{folder}/{file}") });
        }
        names.sort();
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
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        self.files.get(name).cloned().ok_or_else(|| "there is no such file".to_string())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "there is no such file".to_string())
    }
}

/// The files that a session kept when it began. One that was lost or changed since stands in its folder as before, but
/// cannot be read.
#[derive(Clone, Debug, Default)]
pub struct SessionFiles {
    files: BTreeMap<String, Result<Vec<u8>, String>>,
}

impl SessionFiles {
    /// The files among the attachments of a session, held against the hashes that its metadata says.
    pub fn of(session: &Session) -> Self {
        let mut files: BTreeMap<String, Result<Vec<u8>, String>> = session
            .attachments()
            .iter()
            .filter_map(|(name, a)| Some((name.strip_prefix(FILES)?.to_string(), Ok(a.bytes.clone()))))
            .collect();
        for (name, hash) in session.metadata().get(HASHES).into_iter().flatten() {
            let wrong = match files.get(name) {
                Some(Ok(bytes)) if hex(&Sha256::digest(bytes)) == *hash => continue,
                Some(_) => "the bytes of this file in the session are not those that were recorded",
                None => "the session lacks this file",
            };
            files.insert(name.clone(), Err(wrong.to_string()));
        }
        Self { files }
    }

    /// The files that cannot be read, with the reason.
    pub fn lacking(&self) -> impl Iterator<Item = (&str, &str)> {
        self.files.iter().filter_map(|(name, file)| Some((name.as_str(), file.as_ref().err()?.as_str())))
    }
}

impl Files for SessionFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        self.files
            .get(name)
            .cloned()
            .unwrap_or_else(|| Err("the session does not keep this file".to_string()))
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        listed(&self.files, name).ok_or_else(|| "the session does not keep it".to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_comes_with_the_program_goes_before_one_on_disk_and_others_are_looked_for() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
        let files = DiskFiles::beside(&folder.join("x.yaml")).carrying(&[("Cargo.toml", b"carried")]);
        assert_eq!(files.read("Cargo.toml").unwrap(), b"carried");
        assert!(files.read("src/lib.rs").unwrap().len() > 7);
        assert_eq!(files.list("Cargo.toml").unwrap(), ["Cargo.toml"]);
        assert!(files.read("nothing").is_err());
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
        let disk = DiskFiles::beside(&folder.path().parent().unwrap().join("x.yaml"));
        let name = folder.path().file_name().unwrap().to_str().unwrap();
        let under = |names: &[&str]| names.iter().map(|n| format!("{name}/{n}")).collect::<Vec<_>>();
        assert_eq!(disk.list(&format!("{name}/a_*.png")).unwrap(), under(&["a_0.png", "a_1.png", "a_2.png"]));
        assert_eq!(disk.list(name).unwrap().len(), 5);
        assert!(disk.read(&under(&["a_0.png"])[0]).is_err());
        let beside = DiskFiles::beside(&folder.path().join("x.yaml"));
        assert_eq!(beside.list("*.txt").unwrap(), ["notes.txt"]);
        let kept = MemoryFiles {
            files: [("notes.txt", ""), ("s/a.png", ""), ("s/t/b.png", "")]
                .map(|(n, b)| (n.into(), b.into()))
                .into(),
        };
        assert_eq!(kept.list("*.txt").unwrap(), ["notes.txt"]);
        assert_eq!(
            (kept.list("s").unwrap(), kept.list("s/*.png").unwrap()),
            (vec!["s/a.png".into()], vec!["s/a.png".into()])
        );
        assert!(kept.list("s/*.pcd").is_err());
    }
}
