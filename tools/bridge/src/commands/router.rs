//! `stillpoint-bridge router`

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use stillpoint_arguments::Router;
use stillpoint_remote::{Router as Session, Tls};

use super::exchange::{Ending, PREFIX, ended};
use super::tls::load;
use crate::error::BridgeError;

/// How often the files of the certificate are looked at.
const LOOK: Duration = Duration::from_millis(250);

/// Executes the subcommand.
pub fn execute(arguments: Router) -> ExitCode {
    ended(try_execute(arguments))
}

fn try_execute(arguments: Router) -> Result<(), BridgeError> {
    let ending = Ending::watch()?;
    Hub::open(arguments.listen, load(&arguments.tls)?)?.run(&ending);
    Ok(())
}

/// A router that takes a new certificate when there is one. zenoh reads the certificate of a listening session once, so
/// the router, which holds nothing else, is closed and opened anew; the others come back by themselves.
pub struct Hub {
    router: Session,
    listen: Vec<String>,
    tls: Option<Arc<Tls>>,
    reported: Option<String>,
}

impl Hub {
    /// Listens.
    pub fn open(listen: Vec<String>, tls: Option<Arc<Tls>>) -> Result<Self, BridgeError> {
        let router = Session::open(PREFIX, listen.clone(), tls.clone())?;
        eprintln!("stillpoint-bridge: the router listens at {}", listen.join(", "));
        Ok(Self { router, listen, tls, reported: None })
    }

    /// Opens itself anew if there is a new certificate.
    fn renew(&mut self) {
        let failed = match self.tls.as_ref().map(|tls| tls.renewed()) {
            None | Some(Ok(None)) => return,
            Some(Ok(Some(tls))) => {
                self.router.close();
                match Self::open(self.listen.clone(), Some(Arc::new(tls))) {
                    Ok(hub) => {
                        *self = hub;
                        eprintln!("stillpoint-bridge: the router has a new certificate");
                        return;
                    }
                    // The next look tries again.
                    Err(e) => e.to_string(),
                }
            }
            Some(Err(e)) => format!("the new certificate is not used: {e}"),
        };
        if self.reported.as_ref() != Some(&failed) {
            eprintln!("stillpoint-bridge: {failed}");
            self.reported = Some(failed);
        }
    }

    /// Looks for new certificates until the program is to end.
    pub fn run(mut self, ending: &Ending) {
        while !ending.is_time() {
            std::thread::sleep(LOOK);
            self.renew();
        }
        self.router.close();
    }
}
