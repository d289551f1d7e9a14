//! The limits that the system sets a process (`ulimit`): an error that comes of one names it.

use std::error::Error;
use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::thread::JoinHandle;

use rustix::io::Errno;
use rustix::process::{Resource, getrlimit};

/// A limit that a call of the system ran into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// A file may have at most so many bytes.
    FileSize(u64),
    /// The user may have at most so many processes and threads; `None`: another limit than the user's is reached.
    Processes(Option<u64>),
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FileSize(bytes) => {
                write!(
                    f,
                    "a file may have at most {bytes} bytes here: raise `ulimit -f`, or `LimitFSIZE` of the service"
                )
            }
            Self::Processes(Some(count)) => write!(
                f,
                "this user may have {count} processes and threads at once: raise `ulimit -u`, or `LimitNPROC` of the service"
            ),
            Self::Processes(None) => write!(
                f,
                "the container or the service may have no more processes and threads: raise `pids.max` of its control \
                 group, or `TasksMax` of the service"
            ),
        }
    }
}

/// The limit of this process that an error, or one of its causes, comes of.
pub fn limit_behind(error: &(dyn Error + 'static)) -> Option<Limit> {
    let mut cause = Some(error);
    let mut code = None;
    while let (Some(error), None) = (cause, code) {
        code = error.downcast_ref::<io::Error>().and_then(io::Error::raw_os_error);
        cause = error.source();
    }
    let code = code?;
    match Errno::from_raw_os_error(code) {
        Errno::FBIG => getrlimit(Resource::Fsize).current.map(Limit::FileSize),
        Errno::AGAIN => Some(Limit::Processes(getrlimit(Resource::Nproc).current)),
        _ => None,
    }
}

/// The limit that an error comes of, as the rest of its sentence; empty where there is none.
pub(crate) fn named(error: &(dyn Error + 'static)) -> String {
    limit_behind(error).map(|limit| format!(" ({limit})")).unwrap_or_default()
}

/// Why a process or a thread cannot be started: what the system says, and the limit behind it.
#[derive(Debug)]
pub struct StartError(pub io::Error);

impl fmt::Display for StartError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.0, named(&self.0))
    }
}

impl Error for StartError {}

/// Starts a thread, or says which limit forbids it.
pub fn start_thread<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>, StartError> {
    std::thread::Builder::new().spawn(work).map_err(StartError)
}

/// Has a write beyond the limit of file sizes fail with an error. Otherwise SIGXFSZ ends the process without a message.
pub fn fail_at_the_limit_of_file_sizes() {
    // A flag that nobody reads: the signal is taken and has no effect.
    let nobody = Arc::new(AtomicBool::new(false));
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, nobody);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_that_comes_of_a_limit_names_it_and_another_names_none() {
        let of = |code: Errno| limit_behind(&io::Error::from(code));
        assert_eq!(of(Errno::NOSPC), None);
        assert!(matches!(of(Errno::AGAIN), Some(Limit::Processes(_))));
        assert_eq!(of(Errno::FBIG), getrlimit(Resource::Fsize).current.map(Limit::FileSize));
        // The error of a library that holds the system's error.
        let inner = stillpoint_recorder::WriteError::Mcap(io::Error::from(Errno::AGAIN).into());
        assert!(limit_behind(&inner).is_some());
        assert!(StartError(io::Error::from(Errno::AGAIN)).to_string().contains("processes and threads"));
        assert!(Limit::FileSize(512).to_string().contains("at most 512 bytes here: raise `ulimit -f`"));
        assert!(
            Limit::Processes(Some(60))
                .to_string()
                .contains("60 processes and threads at once: raise `ulimit -u`")
        );
    }
}
