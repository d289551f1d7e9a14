//! Files that the tests' parameters may name.

use stillpoint_pipeline::setup::Files;

/// `models/face.onnx`, and the folder `captures` with two files.
pub struct Disk;

const CAPTURES: [&str; 2] = ["captures/000.png", "captures/001.png"];

impl Files for Disk {
    fn read(&self, name: &str) -> Result<Vec<u8>, String> {
        if name == "models/face.onnx" || CAPTURES.contains(&name) {
            Ok(Vec::new())
        } else {
            Err("it is not there".into())
        }
    }

    fn list(&self, name: &str) -> Result<Vec<String>, String> {
        match name {
            "captures" => Ok(CAPTURES.map(String::from).to_vec()),
            "empty" => Ok(Vec::new()),
            _ => self.read(name).map(|_| vec![name.to_owned()]),
        }
    }
}
