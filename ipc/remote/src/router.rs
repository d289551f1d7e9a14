//! A router between hosts that cannot reach each other.

use std::sync::Arc;

use zenoh::pubsub::Subscriber;
use zenoh::{Session, Wait};

use crate::endpoints::Mode;
use crate::lane::Lane;
use crate::{Endpoints, RemoteError, Role, Roster, Tls};

/// Passes on what hosts send that are connected to it. It holds no state: it may be restarted at any time.
pub struct Router {
    sessions: [Session; 2],
    _greetings: Option<[Subscriber<()>; 2]>,
}

impl Router {
    /// Listens at these endpoints, for keys that begin with `prefix` if there is a certificate.
    ///
    /// # Errors
    /// An endpoint is not written as one, a port is taken, or the certificate is not that of a router.
    pub fn open(prefix: &str, listen: Vec<String>, tls: Option<Arc<Tls>>) -> Result<Self, RemoteError> {
        Self::with_roster(prefix, listen, tls, None)
    }

    /// The same with a roster, which takes the greetings of those who are connected.
    ///
    /// # Errors
    /// As [`Router::open`].
    pub fn with_roster(
        prefix: &str,
        listen: Vec<String>,
        tls: Option<Arc<Tls>>,
        roster: Option<&Arc<Roster>>,
    ) -> Result<Self, RemoteError> {
        if let Some(tls) = tls.as_ref().filter(|tls| tls.role() != Role::Router) {
            let role = tls.role();
            return Err(RemoteError::Role { role, what: "pass on what others send", instead: "`router`" });
        }
        let endpoints = Endpoints { listen, tls, ..Endpoints::default() };
        endpoints.check()?;
        let open = |lane| endpoints.open(Mode::Router, lane, prefix);
        let sessions = [open(Lane::Small)?, open(Lane::Bulk)?];
        let greetings = roster.map(|roster| roster.subscribe(&sessions[0], prefix)).transpose()?;
        Ok(Self { sessions, _greetings: greetings })
    }

    /// Ends it.
    pub fn close(&self) {
        for session in &self.sessions {
            let _ = session.close().wait();
        }
    }
}
