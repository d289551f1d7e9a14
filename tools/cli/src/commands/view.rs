//! `stillpoint view`

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Args;
use stillpoint_operator::Registry;

use super::bridge;
use super::hz::watched;
use crate::exit::{Ended, Exit, Failure};
use crate::journals::LOOK;
use crate::signals::stop_flag;
use crate::subject::{Of, Subject};
use crate::view::{Commands, Past, Served, follow, serve, serve_viewers};

/// The port of the page, and that of viewers, which they expect.
const PAGE: u16 = 8017;
const FOXGLOVE: u16 = 8765;

/// Show a run or a session in a browser: image and face, the head in 3-D, channels against targets, beam and valves over
/// time, the graph with rates, paths, and the ledger. The page is read-only and on this machine alone.
#[derive(Args)]
pub struct View {
    #[command(flatten)]
    of: Of,
    /// Port on 127.0.0.1; 0 takes any that is free. Default: 8017, and 8765 with `--foxglove`.
    #[arg(long)]
    port: Option<u16>,
    /// Show it in Foxglove or Lichtblick instead of the page: serve their web socket, which `stillpoint-bridge` does. A
    /// session is played, paused and sought by their controls.
    #[arg(long, conflicts_with = "commands")]
    foxglove: bool,
    /// The time over which rates, latencies and losses are measured.
    #[arg(long = "for", value_name = "TIME", default_value = "2s")]
    time: String,
    /// Let the page send commands to the run. The printed address has a token; whoever has it can command the run as
    /// `stillpoint send` does.
    #[arg(long)]
    commands: bool,
}

impl View {
    /// Executes the subcommand.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let window = watched(&self.time)?;
        let subject = self.of.open(registry)?;
        let of = subject.of();
        // Set when the server of viewers ends by itself.
        let lost = Arc::new(AtomicBool::new(false));
        match subject {
            Subject::Session(path, session) => {
                if self.commands {
                    return Err(Failure::wrong("a session takes no commands: leave out --commands"));
                }
                let folder = path.clone();
                let served = Past::open(of, path, *session, window.as_nanos() as u64, registry)?;
                let stop = stop_flag()?;
                self.begin(served, None, folder, [&stop, &lost])?;
                while !stop.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                }
            }
            Subject::Run(attached) => {
                let commands = self.commands.then(|| Commands::to(attached.pid)).transpose();
                let commands = commands.map_err(|e| Failure::failed(format!("no token: {e}")))?;
                let stop = stop_flag()?;
                let folder = attached.folder();
                let begin = |served| self.begin(served, commands, folder, [&stop, &lost]);
                follow(*attached, window, registry, &stop, begin)?;
            }
        }
        if lost.load(Ordering::Relaxed) {
            return Err(Failure::failed("the server of viewers has ended: start this command again"));
        }
        Ok(Exit::Done)
    }

    /// Starts the server and prints its address.
    fn begin(
        &self,
        served: Served,
        commands: Option<Commands>,
        folder: PathBuf,
        flags: [&Arc<AtomicBool>; 2],
    ) -> Result<Arc<Served>, Failure> {
        let served = Arc::new(served);
        if self.foxglove {
            let port = self.port.unwrap_or(FOXGLOVE);
            let bound = serve_viewers(bridge::command()?, port, &served, folder, flags)?;
            outln!(
                "ws://127.0.0.1:{bound} (this machine only, read-only; Ctrl-C ends it): Foxglove and Lichtblick open it as \
                 \"Foxglove WebSocket\". Every web page that is open in a browser of this machine can read it, too"
            );
            return Ok(served);
        }
        let token = commands.as_ref().map(|commands| commands.token().to_owned());
        let bound = serve(self.port.unwrap_or(PAGE), &served, commands)?;
        match token {
            None => outln!("http://{bound}/ (this machine only, read-only; Ctrl-C ends it)"),
            Some(token) => outln!(
                "http://{bound}/#{token} (this machine only; whoever has this address can send commands; Ctrl-C ends it)"
            ),
        }
        Ok(served)
    }
}
