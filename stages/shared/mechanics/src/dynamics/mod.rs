//! Equations of motion (section 3.4, SCIENCE C1, C2).
//!
//! - [`reduced`]: a head and the bodies that it carries along, in the head's coordinates

pub mod reduced;
