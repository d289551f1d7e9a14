//! The mechanics of air bladders and of a head that rests on them: plain mathematics, no pipeline.
//!
//! SI units and radians throughout; pressures are gauge unless a name says `absolute`.
//!
//! - [`dormand_prince`]: ordinary differential equations, without allocation
//! - [`shell`]: a bladder by itself (chapter 2)
//! - [`plant`]: heads on bladders, as the virtual rigs have them (SCIENCE C3 to C6)

#![forbid(unsafe_code)]

pub mod dormand_prince;
mod linear;
pub mod plant;
mod root;
pub mod shell;
