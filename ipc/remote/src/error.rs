//! Why a host cannot be opened.

use crate::{Role, TlsError};

/// Why a host or a router cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RemoteError {
    /// An endpoint is not written as one.
    #[error(
        "`{0}` is not an endpoint: write `tcp/ADDRESS:PORT` or `tls/ADDRESS:PORT` with a port from 1 to 65534, for example `tcp/10.0.0.7:7447`"
    )]
    Endpoint(String),
    /// Endpoints beside that of a router.
    #[error(
        "a host that reaches the others through the router `{0}` neither listens nor connects to them: remove the other endpoints"
    )]
    RouterAndMore(String),
    /// An encrypted endpoint, and no certificate.
    #[error(
        "`{0}` is encrypted, and this program has no certificate: give it certificate, key and authority"
    )]
    NoCertificate(String),
    /// A certificate, and an endpoint without encryption.
    #[error(
        "`{0}` is not encrypted, although this program has a certificate: write `tls/...`, or give no certificate"
    )]
    NotEncrypted(String),
    /// Certificate, key or authority cannot be used.
    #[error(transparent)]
    Tls(#[from] TlsError),
    /// The role of the certificate is not for this.
    #[error("the certificate of this program has the role `{}`, which may not {what}: use one with the role {instead}", role.name())]
    Role {
        /// Role of the certificate.
        role: Role,
        /// What it is to be used for.
        what: &'static str,
        /// Roles that may.
        instead: &'static str,
    },
    /// The name of a host does not begin with its role.
    #[error("the certificate of the host `{host}` has the role `{0}`, so its name must begin with `{0}`", role.name())]
    HostName {
        /// Name of the host.
        host: String,
        /// Role of its certificate.
        role: Role,
    },
    /// The other end refuses this one.
    #[error("{0}")]
    Refused(String),
    /// zenoh refuses the session.
    #[error("no session can be opened ({place}): {reason}; check that {check}")]
    Session {
        /// Where it listens, or connects.
        place: String,
        /// Message of zenoh.
        reason: String,
        /// What may be amiss there.
        check: &'static str,
    },
    /// A name cannot be used as a part of a key.
    #[error("`{0}` cannot be the name of a host: it needs 1 to 64 characters")]
    Name(String),
    /// A publication or subscription is refused.
    #[error("`{key}` cannot be declared: {reason}")]
    Declare {
        /// The key.
        key: String,
        /// Message of zenoh.
        reason: String,
    },
    /// A thread cannot be had.
    #[error("a thread cannot be started: {0}")]
    Thread(String),
}
