//! The subcommands, a file each; `exchange` is what those of the planning pool share.

pub mod bridge;
pub mod exchange;
pub mod foxglove;
pub mod listen;
pub mod pki;
pub mod plan_client;
pub mod pool;
pub mod router;
pub mod tls;
pub mod worker;
