//! `stillpoint calibrate`
//!
//! - `camera`: camera to couch: arguments, entry of `frames:` and drift
//! - `balls`, `board`, `edges`: what it is measured by
//! - `depth`: unit of the depth, by a plate at two distances
//! - `images`: the images of a session

mod balls;
mod board;
mod camera;
mod depth;
mod edges;
mod images;

use clap::{Args, Subcommand};

use crate::exit::Ended;

/// Place a depth camera over the couch, and check its depth, from recorded images.
#[derive(Args)]
pub struct Calibrate {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Place a camera over the couch by balls, a printed board or the couch's edges, or check its place.
    Camera(Box<camera::Camera>),
    /// Check the unit of the depth by a flat plate at two distances.
    Depth(depth::Depth),
}

impl Calibrate {
    /// Executes the subcommand.
    pub fn execute(&self) -> Ended {
        match &self.command {
            Command::Camera(c) => c.execute(),
            Command::Depth(c) => c.execute(),
        }
    }
}
