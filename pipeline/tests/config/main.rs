//! From YAML to a checked graph: what is accepted, and what is said about what is not.

// What fails here is a test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

mod broken;
mod disk;
mod garbage;
mod good;
mod hosts;
mod includes;
mod kinds;
mod machine;
mod others;
mod params;
mod programs;
mod resolved;
mod ros2;
mod schema;
mod sets;
mod speed;
mod starting;
mod suggestions;
mod variables;
