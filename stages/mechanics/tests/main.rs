//! The reference vectors of the mechanics, and the energy balance of its plants.

#![allow(clippy::unwrap_used, clippy::panic)]

mod energy;
mod vectors;
