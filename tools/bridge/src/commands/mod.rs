//! The subcommands, a file each.

pub mod bridge;
pub mod router;
