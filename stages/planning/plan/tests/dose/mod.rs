//! Dose: properties in water, the cache, broken files, and a reference.

mod broken;
mod cache;
mod couch;
mod generic;
mod nowhere;
pub mod phantom;
mod positions;
mod reference;
mod water;
