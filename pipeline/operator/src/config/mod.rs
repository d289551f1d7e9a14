//! The text of a config: a tree of marked keys and values, quantities with units, and faults with their places.
//!
//! - `text`, `source`, `places`: texts and places in them; `quote`: a text in a message
//! - `yaml`, `tree`: YAML as it was written, each key and value with its place
//! - `syntax`: the likeliest cause where a text is no YAML
//! - `units`, `decimal`, `quantity`: numbers with units, read as SI
//! - `faults`, `render`, `near`: faults for people and programs, nearest names

mod decimal;
pub mod faults;
pub mod near;
mod places;
pub mod quantity;
mod quote;
mod render;
pub mod source;
mod syntax;
mod text;
pub mod tree;
pub mod units;
pub mod yaml;

pub use text::text;
