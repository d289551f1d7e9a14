//! The mechanics of air bladders and of a head that rests on them: plain mathematics, no pipeline.
//!
//! SI units and radians throughout; pressures are gauge unless a name says `absolute`.
//!
//! - [`dormand_prince`]: ordinary differential equations, without allocation
//! - [`contact`]: bladders against a head: rolling, friction, grasp (chapter 3)
//! - [`dynamics`]: equations of motion, constrained and not (section 3.4)
//! - [`shell`]: a single bladder (chapter 2)
//! - [`random`]: random numbers from a seed
//! - [`plant`]: heads on bladders, as the virtual rigs have them (SCIENCE C3 to C6)

#![forbid(unsafe_code)]

pub mod contact;
pub mod dormand_prince;
pub mod dynamics;
mod linear;
pub mod plant;
pub mod random;
mod root;
pub mod shell;
