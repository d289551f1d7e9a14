//! `plan-client`: carries messages between the pipes of the asking process and the network.

use std::io::{stdin, stdout};
use std::process::ExitCode;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use clap::Args;
use stillpoint_arguments::TlsArgs;
use stillpoint_pool::pipe::{read_frame, write_frame};
use stillpoint_remote::{Mailbox, Tls};

use super::exchange::{ended, open};
use super::tls::{Use, allow, load};
use crate::error::BridgeError;

/// Carry the messages of `stillpoint plan --pool`, which starts it: frames on standard input and output.
#[derive(Args)]
pub struct PlanClient {
    /// Endpoint of a router or of a listening worker.
    #[arg(long, value_name = "ENDPOINT")]
    connect: String,
    #[command(flatten)]
    tls: TlsArgs,
}

impl PlanClient {
    /// Executes the subcommand: it ends with its input.
    pub fn execute(self) -> ExitCode {
        ended(self.try_execute())
    }

    fn try_execute(self) -> Result<(), BridgeError> {
        let born = SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos();
        let name = format!("plan-{}-{born:x}", std::process::id());
        let tls = load(&self.tls)?;
        allow(tls.as_deref(), &Use::Ask)?;
        let place: Arc<OnceLock<Mailbox>> = Arc::default();
        let filled = place.clone();
        std::thread::spawn(move || {
            if let Err(reason) = carry(&name, &self.connect, tls, &filled) {
                eprintln!("stillpoint-bridge: {reason}");
                std::process::exit(1);
            }
        });
        let mut input = stdin().lock();
        while let Ok(Some((to, message))) = read_frame(&mut input) {
            // A message before the router is there is lost; the asking process sends it again.
            if let Some(mailbox) = place.get() {
                mailbox.send(Some(to.as_str()).filter(|to| !to.is_empty()), message);
            }
        }
        Ok(())
    }
}

/// Hands on what arrives, until the asking process has ended.
fn carry(
    name: &str,
    endpoint: &str,
    tls: Option<Arc<Tls>>,
    place: &OnceLock<Mailbox>,
) -> Result<(), BridgeError> {
    let Some(opened) = open(name, endpoint, tls, || false)? else { return Ok(()) };
    let mailbox = place.get_or_init(|| opened);
    let mut output = stdout().lock();
    loop {
        let Some((from, bytes)) = mailbox.receive(Duration::from_secs(1)) else { continue };
        if write_frame(&mut output, &from, &bytes).is_err() {
            return Ok(());
        }
    }
}
