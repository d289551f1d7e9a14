//! `stillpoint-bridge`: what of stillpoint goes over the network between hosts. It is a program of its own, because zenoh
//! takes more processor time to build than all the rest.
//!
//! - `commands`: a file per subcommand
//! - `network`: zenoh as the network of a run
//! - `viewers`: a run or a session in Foxglove
//! - `metrics`: figures of a worker and of a router as Prometheus text
//! - `error`: why it cannot go on

mod commands;
mod error;
mod metrics;
mod network;
mod viewers;

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
    Router(stillpoint_arguments::Router),
    Worker(stillpoint_arguments::Worker),
    Pool(stillpoint_arguments::Pool),
    Pki(stillpoint_arguments::Pki),
    PlanClient(commands::plan_client::PlanClient),
    Listen(commands::listen::Listen),
    Foxglove(commands::foxglove::Foxglove),
}

fn main() -> ExitCode {
    match Arguments::parse().command {
        Command::Bridge(command) => command.execute(),
        Command::Router(command) => commands::router::execute(command),
        Command::Worker(command) => commands::worker::execute(&command),
        Command::Pool(command) => commands::pool::execute(&command),
        Command::Pki(command) => commands::pki::execute(command),
        Command::PlanClient(command) => command.execute(),
        Command::Listen(command) => command.execute(),
        Command::Foxglove(command) => command.execute(),
    }
}
