//! For the tests of operators: a pipeline's text run in the simulated executor, and one operator fed by hand.
//!
//! - [`mod@run`]: a whole pipeline, and all that it sent
//! - [`mod@bench`]: one operator, activated with samples that a test makes
//! - `quiet`: one operator, of which a step can be watched alone
//! - [`mod@sample`]: samples as bytes
//! - [`mod@perception`]: the reference data of perception
//! - [`mod@reference`]: data that is no part of the project
//! - [`mod@feed`]: kinds that stand upstream of an operator on a bench
//! - [`mod@board`]: grey images of a checkerboard

pub mod bench;
pub mod board;
pub mod feed;
pub mod perception;
mod quiet;
pub mod reference;
pub mod run;
pub mod sample;

pub use bench::Bench;
pub use quiet::Quiet;
pub use run::{Run, run, run_keeping};
/// The pipeline, for tests of crates that do not depend on it.
pub use stillpoint_pipeline as pipeline;
