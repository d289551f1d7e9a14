//! The reference vectors of the mechanics, and what its plants do through time.

#![allow(clippy::unwrap_used, clippy::panic)]

/// Of the crate: its linear systems are no part of its interface.
#[path = "../src/linear.rs"]
mod linear;
mod plants;
mod reference;
mod vectors;
