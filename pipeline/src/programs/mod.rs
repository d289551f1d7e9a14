//! Operators in programs of their own: `use: { program: ./my_op, kind: my.smoother }`.
//!
//! The process that holds such an operator starts the program, and speaks with it over a socket
//! (`stillpoint_operator::program`). Executors see an operator like any other.
//!
//! - `process`: the program as it was when the run began, and a process of it
//! - `describe`: from a program to a kind of operator
//! - `operator`: one incarnation

mod describe;
mod operator;
mod process;

pub(crate) use operator::Killed;

pub use describe::{describe, name_of, refuse_recorded, trust_recorded};
