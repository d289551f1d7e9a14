//! The reference vectors of the mechanics, and what its plants do through time.

#![allow(clippy::unwrap_used, clippy::panic)]

mod plants;
mod vectors;
