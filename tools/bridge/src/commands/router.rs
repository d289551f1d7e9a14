//! `stillpoint-bridge router`

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use stillpoint_arguments::Router;
use stillpoint_remote::{Roster, Router as Session, Tls};

use super::exchange::{Ending, PREFIX, ended};
use super::tls::load;
use crate::error::BridgeError;
use crate::metrics::{self, Served};

/// How often the files of the certificate are looked at, and figures are made.
const LOOK: Duration = Duration::from_millis(250);

/// Executes the subcommand.
pub fn execute(arguments: Router) -> ExitCode {
    ended(try_execute(arguments))
}

fn try_execute(arguments: Router) -> Result<(), BridgeError> {
    let ending = Ending::watch()?;
    let served = arguments.metrics.map(Served::at).transpose()?;
    let roster = served.is_some().then(Arc::<Roster>::default);
    let hub = Hub::open(arguments.listen, load(&arguments.tls)?, roster.clone())?;
    hub.run(&ending, || {
        if let (Some(served), Some(roster)) = (&served, &roster) {
            served.update(|| metrics::of_router(&roster.members()));
        }
    });
    Ok(())
}

/// A router that takes a new certificate when there is one. zenoh reads the certificate of a listening session once, so
/// the router, which holds nothing else, is closed and opened anew; the others come back by themselves.
pub struct Hub {
    router: Session,
    listen: Vec<String>,
    tls: Option<Arc<Tls>>,
    roster: Option<Arc<Roster>>,
    reported: Option<String>,
}

impl Hub {
    /// Listens. A roster takes the greetings of those who are connected.
    pub fn open(
        listen: Vec<String>,
        tls: Option<Arc<Tls>>,
        roster: Option<Arc<Roster>>,
    ) -> Result<Self, BridgeError> {
        let router = Session::with_roster(PREFIX, listen.clone(), tls.clone(), roster.as_ref())?;
        eprintln!("stillpoint-bridge: the router listens at {}", listen.join(", "));
        Ok(Self { router, listen, tls, roster, reported: None })
    }

    /// Opens itself anew if there is a new certificate.
    fn renew(&mut self) {
        let failed = match self.tls.as_ref().map(|tls| tls.renewed()) {
            None | Some(Ok(None)) => return,
            Some(Ok(Some(tls))) => {
                self.router.close();
                match Self::open(self.listen.clone(), Some(Arc::new(tls)), self.roster.clone()) {
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

    /// Looks for new certificates until the program is to end, and calls `each` with each look.
    pub fn run(mut self, ending: &Ending, each: impl Fn()) {
        while !ending.is_time() {
            std::thread::sleep(LOOK);
            self.renew();
            each();
        }
        self.router.close();
    }
}
