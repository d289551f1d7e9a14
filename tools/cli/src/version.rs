//! `stillpoint --version`: what a report of a fault needs. A replay is exact on the same build and CPU features.

use stillpoint_pipeline::program::Program;
use stillpoint_pipeline::session::identity;

/// Whether the command line is `--version` alone. Clap would evaluate the text of it at every start.
pub fn is_asked() -> bool {
    Program::arguments() == ["--version"]
}

/// Prints version, build and CPU.
pub fn print() {
    let facts = identity();
    let fact = |name: &str| facts.get(name).map_or("unknown", String::as_str);
    outln!("stillpoint {}", env!("CARGO_PKG_VERSION"));
    outln!("build {} ({}, {})", fact("build"), fact("profile"), fact("architecture"));
    outln!("cpu {}", fact("cpu"));
    outln!("cpu features {}", fact("cpu_features"));
}
