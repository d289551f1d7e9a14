//! Fluence problems: vectors, complete problems, problems made to be hard.

mod data;
mod goals;
mod independent;
mod interior;
mod problems;
mod vectors;
