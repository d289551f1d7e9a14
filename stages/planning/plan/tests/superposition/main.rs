//! Dose by superposition: against Monte Carlo, its calibration, its bytes, and its columns against its beams.

#![allow(clippy::unwrap_used, clippy::panic)]

mod beams;
mod columns;
mod fitted;
mod monte_carlo;
mod optimised;
mod patients;
