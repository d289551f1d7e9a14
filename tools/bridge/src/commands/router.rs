//! `stillpoint-bridge router`

use std::process::ExitCode;

use clap::Args;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// Pass on samples between hosts that cannot reach each other. Such hosts name its endpoint as `router` in the pipeline.
/// It holds no state and runs until Ctrl-C.
#[derive(Args)]
pub struct Router {
    /// Endpoint at which hosts reach it, as `tcp/ADDRESS:PORT`; the next port is used, too.
    #[arg(long, value_name = "ENDPOINT", required = true)]
    listen: Vec<String>,
}

impl Router {
    /// Executes the subcommand.
    pub fn execute(self) -> ExitCode {
        let failed = |reason: String| {
            eprintln!("stillpoint-bridge: {reason}");
            ExitCode::FAILURE
        };
        let mut signals = match Signals::new([SIGINT, SIGTERM, SIGHUP]) {
            Ok(signals) => signals,
            Err(error) => return failed(format!("signals cannot be taken: {error}")),
        };
        let places = self.listen.join(", ");
        match stillpoint_remote::Router::open(self.listen) {
            Ok(router) => {
                eprintln!("stillpoint-bridge: the router listens at {places}");
                signals.forever().next();
                router.close();
                ExitCode::SUCCESS
            }
            Err(error) => failed(error.to_string()),
        }
    }
}
