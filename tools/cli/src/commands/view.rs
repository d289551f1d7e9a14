//! `stillpoint view`

use std::sync::Arc;
use std::sync::atomic::Ordering;

use clap::Args;
use stillpoint_operator::Registry;

use super::hz::watched;
use crate::exit::{Ended, Exit, Failure};
use crate::journals::LOOK;
use crate::signals::stop_flag;
use crate::subject::{Of, Subject};
use crate::view::{Commands, Past, Served, follow, serve};

/// Show a run or a session in a browser: image and face, the head in 3-D, channels against targets, beam and valves over
/// time, the graph with rates, paths, and the ledger. The page is read-only and on this machine alone.
#[derive(Args)]
pub struct View {
    #[command(flatten)]
    of: Of,
    /// Port on 127.0.0.1; 0 takes any that is free.
    #[arg(long, default_value_t = 8017)]
    port: u16,
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
        match subject {
            Subject::Session(path, session) => {
                if self.commands {
                    return Err(Failure::wrong("a session takes no commands: leave out --commands"));
                }
                let served = Past::open(of, path, *session, window.as_nanos() as u64, registry)?;
                self.begin(served, None)?;
                let stop = stop_flag()?;
                while !stop.load(Ordering::Relaxed) {
                    std::thread::sleep(LOOK);
                }
            }
            Subject::Run(attached) => {
                let commands = self.commands.then(|| Commands::to(attached.pid)).transpose();
                let commands = commands.map_err(|e| Failure::failed(format!("no token: {e}")))?;
                let stop = stop_flag()?;
                follow(*attached, window, registry, &stop, |served| self.begin(served, commands))?;
            }
        }
        Ok(Exit::Done)
    }

    /// Starts the server and prints its address.
    fn begin(&self, served: Served, commands: Option<Commands>) -> Result<Arc<Served>, Failure> {
        let served = Arc::new(served);
        let token = commands.as_ref().map(|commands| commands.token().to_owned());
        let bound = serve(self.port, &served, commands)?;
        match token {
            None => outln!("http://{bound}/ (this machine only, read-only; Ctrl-C ends it)"),
            Some(token) => outln!(
                "http://{bound}/#{token} (this machine only; whoever has this address can send commands; Ctrl-C ends it)"
            ),
        }
        Ok(served)
    }
}
