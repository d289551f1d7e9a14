//! From YAML to a checked graph: what is accepted, and what is said about what is not.

mod broken;
mod disk;
mod garbage;
mod good;
mod kinds;
mod params;
mod schema;
mod sets;
mod speed;
mod suggestions;
