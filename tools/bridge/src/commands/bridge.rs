//! `stillpoint-bridge bridge`: the bridge of a run.

use std::process::ExitCode;

use clap::Args;
use stillpoint_pipeline::live::bridge::{Network, bridge_main};

use crate::network::Zenoh;

/// Carry samples between this host and the others of a pipeline, and messages to and from planning pools and ROS 2.
/// `stillpoint run` starts it and tells it what to carry.
#[derive(Args)]
pub struct Bridge {
    /// Name of the process in lists of processes.
    #[arg(hide = true)]
    name: Option<String>,
}

impl Bridge {
    /// Executes the subcommand.
    pub fn execute(self) -> ExitCode {
        bridge_main(|settings| Zenoh::open(settings).map(|zenoh| Box::new(zenoh) as Box<dyn Network>))
    }
}
