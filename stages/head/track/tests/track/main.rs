//! The mathematics and the operators of the family: on vectors, on surfaces that are made, on rendered data.

#![allow(clippy::unwrap_used, clippy::panic)]

mod behind_face;
mod centroid;
mod covariance;
#[path = "../../../segment/tests/drawn.rs"]
mod drawn;
mod drawn_motion;
mod head;
mod identity;
mod living;
mod on_faces;
mod planned;
mod rendered;
#[path = "../../../segment/tests/scene.rs"]
mod scene;
mod shapes;
mod simulated;
mod steady;
mod summit;
mod tracking;
mod vectors;
