//! Fluence problems: vectors, complete problems, problems made to be hard.

mod data;
mod goals;
mod independent;
mod problems;
mod vectors;
