//! Standard output while operators run.
//!
//! An operator that prints must not disturb other output: in a worker, standard output is the line to the supervisor, and
//! in the command it may be a JSON report. So everything that an operator prints goes to standard error.

use std::fs::File;
use std::os::fd::AsFd;

use rustix::stdio::{dup2_stdout, stderr, stdout};

/// Sends standard output to standard error until it is dropped.
pub struct StdoutRedirect {
    /// The original standard output.
    original: Option<File>,
}

impl StdoutRedirect {
    /// Begins the redirection. Where standard output is closed, nothing is printed anyway.
    pub fn to_stderr() -> Self {
        let original = stdout().try_clone_to_owned().ok().filter(|_| dup2_stdout(stderr()).is_ok());
        Self { original: original.map(File::from) }
    }

    /// Makes the redirection permanent, and gives the original standard output.
    pub fn into_original(mut self) -> Option<File> {
        self.original.take()
    }
}

impl Drop for StdoutRedirect {
    fn drop(&mut self) {
        if let Some(original) = &self.original {
            // Text without the end of its line was printed by an operator.
            let _ = std::io::Write::flush(&mut std::io::stdout());
            let _ = dup2_stdout(original.as_fd());
        }
    }
}
