//! From YAML to a checked graph, with every fault of the file in one pass.
//!
//! ```
//! use stillpoint_operator::Registry;
//! use stillpoint_operator::files::MemoryFiles;
//! use stillpoint_pipeline::config::check;
//!
//! let files = MemoryFiles::default();
//! let faults = check("stillpoint: 2\n", "head.yaml", &[], &Registry::default(), &files).err().unwrap();
//! assert!(faults.to_string().contains("head.yaml:1:13: `2` is not a version that this build reads"));
//! ```
//!
//! Text to tree: `config` of the crate `stillpoint_operator`; `includes`: what other files hold; `sets`: `--set operator.param=value`, applied to the tree; `paths`, `variables`: variables of the environment in paths
//!
//! Tree to parsed pipeline:
//! - `fields`: values that several sections have; `document`: the file; `operators`, `inputs`, `frames`, `processes`, `host_section`, `ros2_section`, `record`: its sections
//!
//! Parsed to checked pipeline:
//! - `machine`: what the file asks of the machine; `check`: the pass over all; `wiring`: kinds, ports and types; `sync`: inputs in step; `port_frames`: the frame of
//!   each port; `hosts`: what crosses from one host to another; `ros2`: what goes to ROS 2 and comes from it; `confirm`: references that nobody looks at; `identity`: heads that nobody tells from other things; `script_settings`: parameters that a script changes; `contracts`: bounds of time; `order`: upstream before downstream, cycles; `assemble`: the graph; `start`: what the start of an operator refuses
//!
//! What is said about it, and kept of it:
//! - `composed`, `write`: the pipeline as one text that needs nothing else; `resolved`: all of its values, each with where it came from
//! - `schema`, `reference`: JSON Schema for editors, the reference page

mod assemble;
mod check;
mod composed;
mod confirm;
mod contracts;
mod document;
mod fields;
mod frames;
mod host_section;
mod hosts;
mod identity;
mod includes;
mod inputs;
mod links;
mod machine;
mod operators;
mod order;
mod paths;
mod port_frames;
mod processes;
mod record;
pub mod reference;
mod resolved;
mod ros2;
mod ros2_section;
pub mod schema;
mod script_settings;
mod sets;
mod start;
mod sync;
mod variables;
mod wiring;
mod write;

pub use check::{check, check_for};
pub use composed::{Composed, compose_for, compose_to_rerun};
pub use machine::Machine;
pub use resolved::{Resolved, resolve_for};
pub use stillpoint_operator::config::faults::{self, Code, Fault, Faults};
pub use stillpoint_operator::config::{near, quantity, source, text, tree, units, yaml};
