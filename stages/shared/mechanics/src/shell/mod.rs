//! A single air bladder: an incompressible spherical shell of Mooney-Rivlin rubber (chapter 2, SCIENCE A).
//!
//! - `material`: moduli and radii, strain energy
//! - `kinematics`: radii, stretches and volumes of an inflated shell; invariants
//! - [`pressure`]: the pressure that a stretch takes, in closed form; limit points
//! - [`inverse`]: the stretch at a pressure
//! - [`air`]: the stretch that an amount of air gives
//! - `stress`: Cauchy stress through the wall
//! - [`rubber`]: creep and hysteresis of the wall
//!
//! A state of a shell is its inner stretch, `lambda_i = r_i / R_i`: 1 at rest, above 1 inflated.

pub mod air;
pub mod inverse;
mod kinematics;
mod material;
pub mod pressure;
pub mod rubber;
mod stress;

pub use material::{Shell, ShellError};
