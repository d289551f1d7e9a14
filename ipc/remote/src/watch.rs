//! The thread that finds out why nobody is heard, and whether there is a new certificate.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::shared::Shared;

/// How long nobody is heard before the other ends are asked.
const ALONE: Duration = Duration::from_millis(300);
/// Time between two questions while nobody is heard.
const RETRY: Duration = Duration::from_secs(5);
/// How often the files of the certificate are looked at.
const LOOK: Duration = Duration::from_millis(250);
/// Days before its end from which a certificate is told to expire.
const SOON_DAYS: i64 = 14;

/// The body of the thread.
pub fn run(shared: &Shared) {
    let endpoints = shared.endpoints();
    if let Some(tls) = endpoints.tls.as_ref().filter(|tls| tls.days_left() < SOON_DAYS) {
        let certificate = tls.files().certificate.display();
        shared.note(format!("the certificate {certificate} expires on {}: make a new one", tls.until()));
    }
    let (mut ask_at, mut message) = (Instant::now() + ALONE, None);
    let mut unusable = None;
    while shared.goes_on_after(LOOK) {
        if !shared.is_alone() {
            (ask_at, message) = (Instant::now() + ALONE, None);
        } else if Instant::now() >= ask_at {
            let reason = endpoints.refusal();
            if let Some(reason) = reason.as_ref().filter(|_| reason != message && shared.is_alone()) {
                shared.fault(format!("this host is refused: {reason}"));
            }
            (ask_at, message) = (Instant::now() + RETRY, reason);
        }
        // A host that only connects reads the files whenever it connects.
        let listening = endpoints.tls.as_ref().filter(|_| !endpoints.listen.is_empty());
        match listening.map(|tls| tls.renewed()) {
            None | Some(Ok(None)) => unusable = None,
            Some(Ok(Some(_))) => shared.is_outdated.store(true, Ordering::Relaxed),
            Some(Err(error)) => {
                // Files are written one after the other: what is wrong twice stays wrong.
                let error = error.to_string();
                match &unusable {
                    Some((text, false)) if *text == error => {
                        shared.fault(format!("the new certificate is not used: {error}"));
                        unusable = Some((error, true));
                    }
                    Some((text, _)) if *text == error => {}
                    _ => unusable = Some((error, false)),
                }
            }
        }
    }
}
