//! The mathematics and the operators of the family: on vectors, on surfaces that are made, on rendered data.

#![allow(clippy::unwrap_used, clippy::panic)]

mod centroid;
mod head;
mod rendered;
mod shapes;
mod simulated;
mod summit;
mod tracking;
mod vectors;
