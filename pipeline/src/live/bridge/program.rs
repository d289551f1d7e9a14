//! Where the program of the bridge is.

use std::path::PathBuf;

use crate::live::children::Launch;

/// The environment variable that names the program of the bridge.
pub const BRIDGE_VARIABLE: &str = "STILLPOINT_BRIDGE";
/// Its name, beside the program of the run.
const PROGRAM: &str = "stillpoint-bridge";
/// Its argument that makes it the bridge of a run.
const ROLE: &str = "bridge";

/// The program of the bridge is not there.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "this pipeline exchanges samples with other hosts, with a planning pool or with ROS 2, and the program for that is not at {}: build it with `{}` in the \
     source folder, or name it in {BRIDGE_VARIABLE}", place.display(), build()
)]
pub struct BridgeMissing {
    /// Where it was looked for.
    pub place: PathBuf,
}

/// The command that builds the bridge beside a program of this build.
fn build() -> String {
    let profile = if cfg!(debug_assertions) { "" } else { " --release" };
    format!("cargo build{profile} --manifest-path tools/bridge/Cargo.toml --target-dir target")
}

/// How the bridge of a run is started.
pub fn bridge_launch(launch: &Launch) -> Result<Launch, BridgeMissing> {
    let sibling = || launch.program.with_file_name(PROGRAM);
    let program = std::env::var_os(BRIDGE_VARIABLE).map_or_else(sibling, PathBuf::from);
    if !program.is_file() {
        return Err(BridgeMissing { place: program });
    }
    Ok(Launch { program, lead: Vec::new(), environment: Vec::new(), worker: ROLE, recorder: launch.recorder })
}
