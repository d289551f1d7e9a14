//! From YAML to a checked graph, with every fault of the file in one pass.
//!
//! ```
//! use stillpoint_operator::{Files, Registry};
//! use stillpoint_pipeline::config::check;
//! # struct Disk;
//! # impl Files for Disk {
//! #     fn read(&self, _: &str) -> Result<Vec<u8>, String> { Err("none".into()) }
//! #     fn list(&self, _: &str) -> Result<Vec<String>, String> { Err("none".into()) }
//! # }
//!
//! let faults = check("stillpoint: 2\n", "head.yaml", &[], &Registry::default(), &Disk).err().unwrap();
//! assert!(faults.to_string().contains("head.yaml:1:13: `2` is not a version that this build reads"));
//! ```
//!
//! Text to tree: `config` of the crate `stillpoint_operator`; `sets`: `--set operator.param=value`, applied to the tree
//!
//! Tree to parsed pipeline:
//! - `fields`: values that several sections have; `document`: the file; `operators`, `inputs`, `frames`, `processes`, `host_section`, `ros2_section`, `record`: its sections
//!
//! Parsed to checked pipeline:
//! - `machine`: what the file asks of the machine; `check`: the pass over all; `wiring`: kinds, ports and types; `sync`: inputs in step; `port_frames`: the frame of
//!   each port; `hosts`: what crosses from one host to another; `ros2`: what goes to ROS 2 and comes from it; `confirm`: references that nobody looks at; `identity`: heads that nobody tells from other things; `contracts`: bounds of time; `order`: upstream before downstream, cycles; `assemble`: the graph
//!
//! What is said about it:
//! - `schema`, `reference`: JSON Schema for editors, the reference page

mod assemble;
mod check;
mod confirm;
mod contracts;
mod document;
mod fields;
mod frames;
mod host_section;
mod hosts;
mod identity;
mod inputs;
mod links;
mod machine;
mod operators;
mod order;
mod port_frames;
mod processes;
mod record;
pub mod reference;
mod ros2;
mod ros2_section;
pub mod schema;
mod sets;
mod sync;
mod wiring;

pub use check::{check, check_for};
pub use machine::Machine;
pub use stillpoint_operator::config::faults::{self, Code, Fault, Faults};
pub use stillpoint_operator::config::{near, quantity, source, text, tree, units, yaml};
