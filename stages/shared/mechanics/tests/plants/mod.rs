//! The plants through time.
//!
//! - `energy`: the energy balance over a minute
//! - `rolling`: contacts that roll: constraints, forward map, sliding, fixed contacts beside them

mod energy;
mod rolling;
