//! Operators in a program of their own, which a pipeline starts: `use: { program: ./my_op, kind: my.smoother }`.
//!
//! The program needs this crate alone. Its `main` is one call:
//!
//! ```no_run
//! # const MY_STAGES: &[stillpoint_operator::Stage] = &[];
//! fn main() -> std::process::ExitCode {
//!     stillpoint_operator::program::main(MY_STAGES)
//! }
//! ```
//!
//! The process that would hold the operator starts the program and speaks with it over a socket, which is the standard input
//! of the program: see [`SERVE`]. Each message is a JSON value with byte strings; the process asks, the program answers. What the
//! program prints goes to the standard error of the run.
//!
//! - `wire`: messages on the socket
//! - `description`: kinds of operators as JSON, and back
//! - `params`: parameters as they are in the file, with their places, and what a kind says of them
//! - `buffers`: the outputs of a step, in memory
//! - `serve`: the program's side

pub(crate) mod buffers;
pub mod description;
pub mod params;
mod serve;
pub mod wire;

pub(crate) use serve::panic_text;
pub use serve::{frames_to_json, main};

/// Version of the messages. Both sides must have the same.
pub const PROTOCOL: u64 = 1;
/// The argument with which a program of operators is started.
pub const SERVE: &str = "--serve";
/// The argument with which a program prints its kinds.
pub const DESCRIBE: &str = "--describe";
