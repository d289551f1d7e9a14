//! A reference that is known before the patient lies down: the surface of the planning CT, and where it is found.
//!
//! - `model`: the surface from all sides, and what a camera sees of it
//! - `register`: where it is in a frame, from anywhere near the planned place, or why it is not this patient

mod model;
mod register;

pub use register::{Fit, Foreign, Limits, Planned, Registered};
