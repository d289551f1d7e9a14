//! `stillpoint-bridge`: what of stillpoint goes over the network between hosts. It is a program of its own, because zenoh
//! takes more processor time to build than all the rest.
//!
//! - `commands`: a file per subcommand
//! - `network`: zenoh as the network of a run

mod commands;
mod network;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// What of stillpoint goes over the network between hosts.
#[derive(Parser)]
#[command(name = "stillpoint-bridge", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Bridge(commands::bridge::Bridge),
    Router(commands::router::Router),
    Worker(commands::worker::Worker),
    Pool(commands::pool::Pool),
    Pki(commands::pki::Pki),
    PlanClient(commands::plan_client::PlanClient),
}

fn main() -> ExitCode {
    match Arguments::parse().command {
        Command::Bridge(command) => command.execute(),
        Command::Router(command) => command.execute(),
        Command::Worker(command) => command.execute(),
        Command::Pool(command) => command.execute(),
        Command::Pki(command) => command.execute(),
        Command::PlanClient(command) => command.execute(),
    }
}
