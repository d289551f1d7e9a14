//! Files that the tests' parameters may name.

use stillpoint_pipeline::files::KeptFiles;
use stillpoint_pipeline::setup::Files;

/// `models/face.onnx`, the folder `captures` with three files, and `empty` with none.
pub struct Disk;

fn kept() -> KeptFiles {
    let names = ["models/face.onnx", "captures/000.png", "captures/001.png", "captures/notes.txt"];
    KeptFiles { files: names.map(|name| (name.to_owned(), Vec::new())).into() }
}

impl Files for Disk {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        kept().read(name).map_err(|_| "it is not there".into())
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        match name {
            "empty" | "empty/*.png" => Ok(Vec::new()),
            _ => kept().list(name).map_err(|_| "it is not there".into()),
        }
    }
}
