//! Operators in Python: `use: ops/speed.py:Speed`.
//!
//! - `describe`: from the source of a class to a kind of operator
//! - `declared`: what a class declares, as the checker and the executors need it
//! - `operator`: one incarnation, behind the trait of all operators
//! - `lend`: arrays over memory that a step borrows

mod declared;
mod describe;
mod lend;
mod operator;

pub use describe::{describe, refuse_recorded};
pub use operator::lend_inputs;
