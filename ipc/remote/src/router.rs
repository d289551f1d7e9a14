//! A router between hosts that cannot reach each other.

use zenoh::{Session, Wait};

use crate::endpoints::Mode;
use crate::lane::Lane;
use crate::{Endpoints, RemoteError};

/// Passes on what hosts send that are connected to it. It holds no state: it may be restarted at any time.
pub struct Router {
    sessions: [Session; 2],
}

impl Router {
    /// Listens at these endpoints.
    ///
    /// # Errors
    /// An endpoint is not written as one, or a port is taken.
    pub fn open(listen: Vec<String>) -> Result<Self, RemoteError> {
        let endpoints = Endpoints { listen, ..Endpoints::default() };
        Ok(Self {
            sessions: [endpoints.open(Mode::Router, Lane::Small)?, endpoints.open(Mode::Router, Lane::Bulk)?],
        })
    }

    /// Ends it.
    pub fn close(&self) {
        for session in &self.sessions {
            let _ = session.close().wait();
        }
    }
}
