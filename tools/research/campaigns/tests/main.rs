//! The command `stillpoint-research`: arguments with which a campaign measures nothing, a small campaign, and self-play.

// A test stops at the first surprise; clippy knows test functions, but not what they call.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

/// Of the tests of whole systems: a folder in which a program runs.
#[allow(dead_code, reason = "a part of it serves here")]
#[path = "../../../../tests/tests/bench.rs"]
mod bench;
mod campaigns;
mod selfplay;

/// The program that a [`bench::Bench`] runs.
const PROGRAM: &str = env!("CARGO_BIN_EXE_stillpoint-research");
