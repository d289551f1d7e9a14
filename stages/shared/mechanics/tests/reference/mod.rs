//! Formulas of the dissertation, corrected, that the product does not use: the reference vectors hold them, and plants
//! are compared with them.

pub mod constrained;
pub mod inertia;
pub mod spherical;
pub mod traction;
