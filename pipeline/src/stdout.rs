//! Standard output while operators run.
//!
//! An operator that prints must not disturb other output: in a worker, standard output is the line to the supervisor, and
//! in the command it may be a JSON report. So everything that an operator prints goes to standard error.

use std::fs::File;
use std::os::fd::AsFd;
use std::sync::{Mutex, MutexGuard, PoisonError};

use rustix::stdio::{dup2_stdout, stderr, stdout};

/// Sends standard output to standard error until it, and all that exist at the same time in other threads, are dropped.
pub struct StdoutRedirect {
    is_permanent: bool,
}

/// The redirection of this process.
#[derive(Default)]
struct Redirected {
    /// How many ask for it.
    count: usize,
    /// The original standard output.
    original: Option<File>,
}

static REDIRECTED: Mutex<Redirected> = Mutex::new(Redirected { count: 0, original: None });

fn redirected() -> MutexGuard<'static, Redirected> {
    REDIRECTED.lock().unwrap_or_else(PoisonError::into_inner)
}

impl StdoutRedirect {
    /// Begins the redirection. Where standard output is closed, nothing is printed anyway.
    pub fn to_stderr() -> Self {
        let mut redirected = redirected();
        if redirected.count == 0 {
            let original = stdout().try_clone_to_owned().ok().filter(|_| dup2_stdout(stderr()).is_ok());
            redirected.original = original.map(File::from);
        }
        redirected.count += 1;
        Self { is_permanent: false }
    }

    /// Makes the redirection permanent, and gives the original standard output, to the first that asks.
    pub fn into_original(mut self) -> Option<File> {
        self.is_permanent = true;
        redirected().original.take()
    }
}

impl Drop for StdoutRedirect {
    fn drop(&mut self) {
        if self.is_permanent {
            return;
        }
        let mut redirected = redirected();
        redirected.count -= 1;
        if redirected.count == 0
            && let Some(original) = redirected.original.take()
        {
            // Text without the end of its line was printed by an operator.
            let _ = std::io::Write::flush(&mut std::io::stdout());
            let _ = dup2_stdout(original.as_fd());
        }
    }
}
