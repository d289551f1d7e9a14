//! Machines that are fitted to curves of a water tank.

mod outside;
mod recovered;
mod tank;
