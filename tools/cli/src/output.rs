//! Text on standard output and standard error.
//!
//! The print macros of `std` panic if a stream is closed or a disk is full. These macros do not, because a run must not
//! end when its reader leaves. A closed pipe is ignored; any other failure to write is reported when the command ends, and
//! the command fails.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::sync::Mutex;

/// The first reason for which standard output could not be written, except a closed pipe.
static UNWRITTEN: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes to standard output; a failure to write is reported when the command ends.
#[macro_export]
macro_rules! out {
    ($($words:tt)*) => { _ = $crate::output::out(format_args!($($words)*)) };
}
/// The same, with a newline.
#[macro_export]
macro_rules! outln {
    () => { $crate::out!("\n") };
    ($($words:tt)*) => { $crate::out!("{}\n", format_args!($($words)*)) };
}
/// Writes to standard error; a failure to write is ignored.
#[macro_export]
macro_rules! err {
    ($($words:tt)*) => { $crate::output::err(format_args!($($words)*)) };
}
/// The same, with a newline.
#[macro_export]
macro_rules! errln {
    () => { $crate::err!("\n") };
    ($($words:tt)*) => { $crate::err!("{}\n", format_args!($($words)*)) };
}

/// Writes to standard output; false if it could not be written.
pub fn out(words: Arguments<'_>) -> bool {
    checked(io::stdout().write_fmt(words))
}

/// Writes to standard error. A failure is ignored, because there is no other stream for it.
pub fn err(words: Arguments<'_>) {
    let mut stderr = io::stderr();
    let _ = stderr.write_fmt(words).and_then(|()| stderr.flush());
}

/// Stores why standard output could not be written; true if it could.
pub fn checked(written: io::Result<()>) -> bool {
    let Err(reason) = written else { return true };
    if reason.kind() != ErrorKind::BrokenPipe
        && let Ok(mut unwritten) = UNWRITTEN.lock()
    {
        unwritten.get_or_insert(reason);
    }
    false
}

/// Flushes standard output; gives the first failure to write, if there was one.
pub fn finish() -> Option<io::Error> {
    checked(io::stdout().flush());
    UNWRITTEN.lock().ok()?.take()
}
