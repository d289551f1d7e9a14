//! The files of a recording that a parameter names.

use stillpoint_operator::Setup;
use stillpoint_operator::SetupError;

/// A file of a recording, as it is on disk.
pub struct RecordedFile {
    /// Its name, for messages.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Reads the files that `path` names, in the order of their names. Names are sorted as text, so numbers in names need
/// leading zeros.
///
/// # Errors
/// A path or a file that cannot be read.
pub fn read(setup: &Setup<'_>, path: &str) -> Result<Vec<RecordedFile>, SetupError> {
    let names = setup.files.list(path).map_err(|e| SetupError(format!("{path}: {e}")))?;
    names.into_iter().map(|name| Ok(RecordedFile { bytes: setup.file(&name)?, name })).collect()
}
