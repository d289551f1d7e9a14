//! What the command says, on standard output and on standard error.
//!
//! The macros stand in for those of the same names in `std`, which panic where a stream is closed or a disk full. A run
//! does not end because nobody looks: who went away is told nothing more, and what else could not be written is said at
//! the end, and the command has failed.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write};
use std::sync::Mutex;

/// The first reason for which standard output could not be written, a reader who went away excepted.
static UNWRITTEN: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes to standard output; a failure to write is told when the command ends.
#[macro_export]
macro_rules! out {
    ($($words:tt)*) => { _ = $crate::output::out(format_args!($($words)*)) };
}
/// The same, and a line's end.
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
/// The same, and a line's end.
#[macro_export]
macro_rules! errln {
    () => { $crate::err!("\n") };
    ($($words:tt)*) => { $crate::err!("{}\n", format_args!($($words)*)) };
}

/// Says something on standard output; whether it could be written.
pub fn out(words: Arguments<'_>) -> bool {
    kept(io::stdout().write_fmt(words))
}

/// Says something on standard error. Where that cannot be written there is nowhere to say so.
pub fn err(words: Arguments<'_>) {
    let mut stderr = io::stderr();
    let _ = stderr.write_fmt(words).and_then(|()| stderr.flush());
}

/// Keeps why standard output could not be written; whether it could.
pub fn kept(written: io::Result<()>) -> bool {
    let Err(reason) = written else { return true };
    if reason.kind() != ErrorKind::BrokenPipe
        && let Ok(mut unwritten) = UNWRITTEN.lock()
    {
        unwritten.get_or_insert(reason);
    }
    false
}

/// Writes what is left; why something could not be written, if so.
pub fn finish() -> Option<io::Error> {
    kept(io::stdout().flush());
    UNWRITTEN.lock().ok()?.take()
}
