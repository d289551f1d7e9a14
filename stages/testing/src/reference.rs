//! Reference data that is no part of the project: where tests and benches find it, and what they say where it is not.

use std::path::{Path, PathBuf};

/// A folder of the reference data: of `$STILLPOINT_DATA`, else of `../shared/data` beside the workspace. `None` with a
/// message where it is not there.
pub fn folder(name: &str) -> Option<PathBuf> {
    let reference_folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("STILLPOINT_DATA").map_or(reference_folder, PathBuf::from).join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: STILLPOINT_DATA names no folder of reference data with `{name}` in it");
    None
}
