//! Standard output while operators run.
//!
//! In a worker, standard output is the pipe to the supervisor, and in the command it may be a JSON report. So while
//! operators run, the text that they print goes to standard error.

use std::fs::File;
use std::os::fd::AsFd;

use rustix::stdio::{dup2_stdout, stderr, stdout};

/// While this value exists, printed text goes to standard error.
pub struct Aside {
    /// What standard output was.
    before: Option<File>,
}

impl Aside {
    /// Redirects standard output. If it is closed, nothing can be printed anyway.
    pub fn begin() -> Self {
        let before = stdout().try_clone_to_owned().ok().filter(|_| dup2_stdout(stderr()).is_ok());
        Self { before: before.map(File::from) }
    }

    /// Leads it aside for good, and gives what it was.
    pub fn keep(mut self) -> Option<File> {
        self.before.take()
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            // What was printed and waits for the end of its line belongs to the operators.
            let _ = std::io::Write::flush(&mut std::io::stdout());
            let _ = dup2_stdout(before.as_fd());
        }
    }
}
