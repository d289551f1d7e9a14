//! `rig.one_bladder`, `rig.three_bladders` and `rig.eight_bladders` in the simulated executor.

#![allow(clippy::unwrap_used, clippy::panic)]

mod contacts;
mod faults;
mod motion;
mod script;
