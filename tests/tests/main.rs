//! Whole systems: real processes, real shared memory, real recordings.
//!
//! - `bench`: a folder of its own, in which the kit's command is run as people run it
//! - `conformance`: the two equalities, for every pipeline

mod bench;
mod conformance;
