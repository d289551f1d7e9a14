//! The program of this process: its executable; or a library inside of another program, such as an interpreter.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;
use std::sync::OnceLock;

/// What a process needs to know of its program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Program {
    /// The executable that starts the program.
    pub executable: PathBuf,
    /// Arguments of the executable in front of those of the program.
    pub lead: Vec<OsString>,
    /// Variables of the environment with which the program is started, in addition to those of this process.
    pub environment: Vec<(String, String)>,
    /// The file that holds the code, of which a session keeps the hash.
    pub code: PathBuf,
    /// The arguments of the program, without its name.
    pub arguments: Vec<OsString>,
}

static HOSTED: OnceLock<Program> = OnceLock::new();

impl Program {
    /// The program of this process.
    ///
    /// # Errors
    /// The path of the executable is not known.
    pub fn here() -> io::Result<Self> {
        if let Some(hosted) = HOSTED.get() {
            return Ok(hosted.clone());
        }
        let executable = std::env::current_exe()?;
        let arguments = std::env::args_os().skip(1).collect();
        Ok(Self { code: executable.clone(), executable, arguments, ..Self::default() })
    }

    /// The arguments of the program of this process, without its name.
    pub fn arguments() -> Vec<OsString> {
        HOSTED.get().map_or_else(|| std::env::args_os().skip(1).collect(), |hosted| hosted.arguments.clone())
    }

    /// Declares that the program of this process is inside of another one. Only the first call has an effect.
    pub fn is_hosted(self) {
        let _ = HOSTED.set(self);
    }
}
