//! The files of a recording that a parameter names: one file, or those of a folder whose names fit.

use stillpoint_pipeline::Setup;
use stillpoint_pipeline::operator::SetupError;

use crate::pattern;

/// A file of a recording, as it is on disk.
pub struct RecordedFile {
    /// Its name, for messages.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Reads the files of `place` (a file or a folder) whose names fit `pattern`, in the order of their names. Numbers in
/// names count by their digits, so they need leading zeros.
///
/// # Errors
/// A place or a file that cannot be read; no file whose name fits.
pub fn read(setup: &Setup<'_>, place: &str, pattern: &str) -> Result<Vec<RecordedFile>, SetupError> {
    let names = setup.files.list(place).map_err(|e| SetupError(format!("{place}: {e}")))?;
    let fits = |name: &String| name == place || pattern::matches(pattern, base_name(name));
    let mut files = Vec::new();
    for name in names.into_iter().filter(fits) {
        files.push(RecordedFile { bytes: setup.file(&name)?, name });
    }
    if files.is_empty() {
        return Err(SetupError(format!("no file in {place} has a name like `{pattern}`: change `names`")));
    }
    files.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(files)
}

fn base_name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}
