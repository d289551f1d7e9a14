//! The reference vectors of the mechanics.

#![allow(clippy::unwrap_used, clippy::panic)]

mod vectors;
