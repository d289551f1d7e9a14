//! Equations of motion (section 3.4, SCIENCE C1, C2).
//!
//! - [`spherical`]: a mass in spherical coordinates
//! - [`reduced`]: a head and the bodies that it carries along, in the head's coordinates
//! - [`constrained`]: bodies under constraints, redundant ones and contacts that let go among them

pub mod constrained;
pub mod reduced;
pub mod spherical;
