//! Identification against vectors, a recorded reference, finite differences and simulated systems.

#![allow(clippy::unwrap_used, clippy::panic)]

mod claims;
