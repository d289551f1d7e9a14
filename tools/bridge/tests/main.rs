//! Whole runs on two hosts over loopback.
//!
//! The program `stillpoint` is built from the source folder first, unless STILLPOINT names one.

// A test that panics names the line; nothing else would be gained by errors.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod apart;
mod bench;
// A network and patients of the tests of games.
mod command;
#[path = "../../../stages/planning/network/tests/common/mod.rs"]
mod common;
mod cut;
mod foxglove;
mod games;
mod hosts;
mod killed;
mod metrics;
mod namespaces;
mod overhead;
mod pool;
mod pool_pipeline;
mod ros2;
// The patient and the search of the tests of the pool itself.
#[path = "../../../stages/planning/pool/tests/water.rs"]
mod water;
mod workers;
