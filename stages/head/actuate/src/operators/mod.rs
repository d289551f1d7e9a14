//! The operators of this family, a file each.
//!
//! - `valves`: `actuate.valves`, duties to datagrams
//! - `watch`: what `actuate.valves` sees on its inputs
//! - `params`: parameters that both share
//! - `beam`: `gate.beam`, the lease of the beam; `limits`: those of its limits that change while it runs
//! - `far_end`: `actuate.far_end`, datagrams to duties
//! - `commission`: `actuate.commission`, the guided sequence that finds what valves and bladders are

mod beam;
mod commission;
mod far_end;
mod limits;
mod params;
mod valves;
mod watch;

pub use beam::{BeamParams, GateBeam};
pub use commission::{ActuateCommission, CommissionParams, READINGS};
pub use far_end::{ActuateFarEnd, FarEndParams};
pub use params::FreshnessParams;
pub use valves::{ActuateValves, ValvesParams};
