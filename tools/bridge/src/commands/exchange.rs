//! What the subcommands of the planning pool share: the place in the exchange of messages, and the end of a program.

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use stillpoint_remote::{Mailbox, RemoteError, Tls};

use crate::error::BridgeError;

/// First part of all keys.
pub const PREFIX: &str = "stillpoint";

/// Whether the program was asked to end.
#[derive(Clone)]
pub struct Ending(Arc<AtomicBool>);

impl Ending {
    /// From now on.
    pub fn watch() -> Result<Self, BridgeError> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register(signal, flag.clone())?;
        }
        Ok(Self(flag))
    }

    /// Without signals: by [`Ending::now`] alone.
    pub fn unsignalled() -> Self {
        Self(Arc::new(AtomicBool::new(false)))
    }

    /// Ends it.
    pub fn now(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it has been.
    pub fn is_time(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Whether it has been since this was called last.
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }
}

/// The place in the exchange as soon as the router is there; none if the program is to end before.
pub fn open(
    name: &str,
    endpoint: &str,
    tls: Option<Arc<Tls>>,
    is_time: impl Fn() -> bool,
) -> Result<Option<Mailbox>, BridgeError> {
    let mut reported = None;
    while !is_time() {
        match Mailbox::open(PREFIX, name, endpoint, tls.clone()) {
            Ok(mailbox) => return Ok(Some(mailbox)),
            Err(e @ (RemoteError::Session { .. } | RemoteError::Refused(_))) => {
                if reported.as_ref() != Some(&e) {
                    eprintln!("stillpoint-bridge: waiting for {endpoint}: {e}");
                }
                reported = Some(e);
                std::thread::sleep(Duration::from_millis(200));
            }
            Err(e) => return Err(e.into()),
        }
    }
    Ok(None)
}

/// The exit code of a subcommand; the reason of a failure goes to standard error.
pub fn ended(result: Result<(), BridgeError>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("stillpoint-bridge: {reason}");
            ExitCode::FAILURE
        }
    }
}
