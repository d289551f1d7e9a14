//! The mechanics of air bladders and of a head that rests on them: plain mathematics, no pipeline.
//!
//! SI units and radians throughout; pressures are gauge unless a name says `absolute`.
//!
//! - [`dormand_prince`]: ordinary differential equations, without allocation
//! - [`shell`]: a bladder by itself (chapter 2)

#![forbid(unsafe_code)]

pub mod dormand_prince;
mod root;
pub mod shell;
