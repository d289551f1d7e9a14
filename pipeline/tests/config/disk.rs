//! Files that the tests' parameters may name.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;

use stillpoint_operator::files::{DiskFiles, MemoryFiles};
use stillpoint_operator::{Files, FilesError};
use stillpoint_pipeline::config::check;

use crate::good::FILES;
use crate::kinds::registry;

/// `models/face.onnx`, the folder `captures` with three files, and `empty` with none.
pub struct Disk;

fn retained() -> MemoryFiles {
    let names = ["models/face.onnx", "captures/000.png", "captures/001.png", "captures/notes.txt"];
    MemoryFiles { files: names.map(|name| (name.to_owned(), Vec::new())).into() }
}

impl Files for Disk {
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError> {
        retained().read(name).map_err(|_| FilesError::Unavailable("it is not there"))
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        match name {
            "empty" | "empty/*.png" => Ok(Vec::new()),
            _ => retained().list(name).map_err(|_| FilesError::Unavailable("it is not there")),
        }
    }
}

#[test]
fn a_name_that_is_no_text_is_a_fault_where_it_is_meant_and_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let images = folder.path().join("captures");
    std::fs::create_dir(&images).unwrap();
    std::fs::write(images.join("000.png"), "").unwrap();
    let text = FILES.iter().find(|(name, _)| *name == "images.yaml").unwrap().1;
    let disk = DiskFiles::next_to(&folder.path().join("images.yaml"));
    for (name, is_meant) in [(b"notes\xff.txt", false), (b"other\xff.png", true)] {
        std::fs::write(images.join(OsStr::from_bytes(name)), "").unwrap();
        let checked = check(text, "images.yaml", &[], &registry(), &disk);
        assert_eq!(checked.is_err(), is_meant);
        let message = checked.err().map_or_else(String::new, |faults| faults.to_string());
        assert_eq!(message.contains("is not UTF-8"), is_meant, "{message}");
    }
}
