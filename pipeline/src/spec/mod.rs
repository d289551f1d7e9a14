//! From YAML to a checked graph, with every fault of the file in one pass.
//!
//! ```
//! use stillpoint_pipeline::operator::Registry;
//! use stillpoint_pipeline::setup::Files;
//! use stillpoint_pipeline::spec::check;
//! # struct Disk;
//! # impl Files for Disk {
//! #     fn read(&self, _: &str) -> Result<Vec<u8>, String> { Err("none".into()) }
//! #     fn list(&self, _: &str) -> Result<Vec<String>, String> { Err("none".into()) }
//! # }
//!
//! let faults = check("stillpoint: 2\n", "head.yaml", &[], &Registry::default(), &Disk).err().unwrap();
//! assert!(faults.to_string().contains("head.yaml:1:13: `2` is no version that this build reads"));
//! ```
//!
//! Text to tree:
//! - `text`, `source`: texts and places in them
//! - `yaml`, `tree`: YAML as it was written, each key and value with its place
//! - `syntax`: what is said of a text that is no YAML
//! - `sets`: `--set operator.param=value`, applied to the tree
//! - `units`, `decimal`, `quantity`: numbers with units, read as SI
//!
//! Tree to parsed pipeline:
//! - `document`: the file; `operators`, `inputs`, `frames`, `processes`, `record`: its sections
//!
//! Parsed to checked pipeline:
//! - `machine`: what the file asks of the machine; `check`: the pass over all; `wiring`: kinds, ports and types; `sync`: inputs in step; `port_frames`: the frame of
//!   each port; `hosts`: what crosses from one host to another; `order`: upstream before downstream, cycles; `assemble`: the graph
//!
//! What is said about it:
//! - `faults`, `render`, `near`: faults for people and programs, nearest names
//! - `schema`, `reference`: JSON Schema for editors, the reference page

mod assemble;
mod check;
mod decimal;
mod document;
pub mod faults;
mod frames;
mod hosts;
mod inputs;
mod links;
pub mod machine;
pub mod near;
mod operators;
mod order;
mod port_frames;
mod processes;
pub mod quantity;
mod record;
pub mod reference;
mod render;
pub mod schema;
mod sets;
pub mod source;
mod sync;
mod syntax;
mod text;
pub mod tree;
pub mod units;
mod wiring;
pub mod yaml;

pub use check::{check, check_for};
pub use faults::{Code, Fault, Faults};
pub use machine::Machine;
pub use text::text;
