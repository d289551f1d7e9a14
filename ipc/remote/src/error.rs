//! Why a host cannot be opened.

/// Why a host or a router cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RemoteError {
    /// An endpoint is not written as one.
    #[error(
        "`{0}` is no endpoint: write `tcp/ADDRESS:PORT` with a port from 1 to 65534, for example `tcp/10.0.0.7:7447`"
    )]
    Endpoint(String),
    /// Endpoints beside that of a router.
    #[error(
        "a host that reaches the others through the router `{0}` neither listens nor connects to them: remove the other endpoints"
    )]
    RouterAndMore(String),
    /// zenoh refuses the session.
    #[error(
        "no session can be opened ({place}): {reason}; check that the ports are free and that the address is one of this machine"
    )]
    Session {
        /// Where it listens, or connects.
        place: String,
        /// Message of zenoh.
        reason: String,
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
