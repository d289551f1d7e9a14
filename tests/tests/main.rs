//! Whole systems: real processes, real shared memory, real recordings.
//!
//! - `bench`: a folder of its own, in which the kit's command is run as people run it
//! - `conformance`: the two equalities, for every pipeline
//! - `live`: failures in a live run
//! - `replaying`: what is the same is found the same, and what is not is named
//! - `tampered`: a session written anew, with something in it changed

mod bench;
mod conformance;
mod live;
mod replaying;
mod tampered;
