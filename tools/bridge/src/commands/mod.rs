//! The subcommands, a file each; `exchange` is what those of the planning pool share.

pub mod bridge;
mod exchange;
pub mod plan_client;
pub mod pool;
pub mod router;
pub mod worker;
