//! The files of a recording that a parameter names.

use stillpoint_operator::files::Files;
use stillpoint_operator::{Setup, SetupError};

use crate::checks::{Checked, Fault};

/// A file of a recording, as it is on disk.
pub struct RecordedFile {
    /// Its name, for messages.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Reads the files that `path` names, in the order of their names, with numbers in names by their value, and looks at
/// each. A damaged file is left out, or refused where `strict`.
///
/// # Errors
/// A path or a file that cannot be read, or what `look` finds in a file.
pub fn read<T>(
    setup: &Setup<'_>,
    path: &str,
    strict: bool,
    look: impl FnMut(&RecordedFile) -> Result<T, Fault>,
) -> Result<Vec<(RecordedFile, T)>, SetupError> {
    checked(setup.files, path, strict, look)
        .map(|checked| checked.items)
        .map_err(|fault| SetupError(fault.to_string()))
}

/// What a run says about the files that `path` names; nothing where they cannot be read, which their operator says.
pub fn remarks<T>(
    files: &dyn Files,
    path: &str,
    strict: bool,
    look: impl FnMut(&RecordedFile) -> Result<T, Fault>,
) -> Vec<String> {
    let checked = checked(files, path, strict, look);
    let remark = checked.ok().and_then(|checked| checked.remark("files"));
    remark.into_iter().map(|remark| format!("{path}: {remark}")).collect()
}

/// The files that `look` finds nothing wrong with, each with what it made of them.
type Looked<T> = Checked<(RecordedFile, T)>;

fn checked<T>(
    files: &dyn Files,
    path: &str,
    strict: bool,
    mut look: impl FnMut(&RecordedFile) -> Result<T, Fault>,
) -> Result<Looked<T>, Fault> {
    let names = files.list(path).map_err(|e| Fault::Params(format!("{path}: {e}")))?;
    let each = names.into_iter().map(|name| {
        let bytes = files.read(&name).map_err(|e| Fault::Params(format!("{name}: {e}")))?;
        let file = RecordedFile { name, bytes };
        match look(&file) {
            Ok(made) => Ok((file, made)),
            Err(fault) => Err(fault.of(&file.name)),
        }
    });
    Checked::of(each, strict)
}

/// Refuses more points or pixels than the parameter of this name allows.
///
/// # Errors
/// How many there are.
pub fn at_most(most: u32, found: usize, what: &str, parameter: &str) -> Result<(), Fault> {
    match found <= most as usize {
        true => Ok(()),
        false => Err(Fault::Params(format!("it has {found} {what}: raise `{parameter}`"))),
    }
}
