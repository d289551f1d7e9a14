//! The reasons why an end of a link cannot be opened, why a sample cannot be sent, and why no sample passes.

use std::net::SocketAddr;

use stillpoint_samples::BytesError;

/// Why an end of a link cannot be opened, or a sample not be sent or received.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TransportError {
    /// No socket listens at the address.
    #[error(
        "no datagrams can be taken at {address}: {reason}; end the program that listens there, or give the link another port"
    )]
    Listen {
        /// The receiver's address.
        address: SocketAddr,
        /// What the system says.
        reason: String,
    },
    /// No socket can be had at the path.
    #[error(
        "no program can be listened to at {path}: {reason}; name another path, or end the program that listens there"
    )]
    Socket {
        /// Path of the socket.
        path: String,
        /// What the system says.
        reason: String,
    },
    /// A socket cannot be had.
    #[error("the link to {address} cannot be opened: {reason}")]
    Open {
        /// The other end's address.
        address: SocketAddr,
        /// What the system says.
        reason: String,
    },
    /// The sample is not one of the channel.
    #[error("a sample did not go over its link: {0}")]
    Sample(BytesError),
    /// The sample is longer than the transport carries.
    #[error("a sample of {bytes} bytes did not go over its link, which carries at most {longest}")]
    TooLong {
        /// Bytes of the sample.
        bytes: usize,
        /// Bytes that the transport carries.
        longest: usize,
    },
    /// The system did not take a sample.
    #[error("a datagram to {address} could not be sent: {reason}")]
    Send {
        /// The receiver's address.
        address: SocketAddr,
        /// What the system says.
        reason: String,
    },
    /// The system gives no messages any more.
    #[error("datagrams cannot be taken: {reason}")]
    Receive {
        /// What the system says.
        reason: String,
    },
    /// This end was closed.
    #[error("this end of the link is closed")]
    Closed,
    /// Any other reason, of a transport outside this crate.
    #[error("{0}")]
    Other(String),
}

/// The reason why no sample passes between two ends that reach each other.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LinkRefusal {
    /// The other end has another type of sample, layout or frame.
    #[error("the server at {peer} sends `{found}`, not `{expected}`: nothing is taken from it")]
    OtherChannel {
        /// The other end.
        peer: String,
        /// What it says it carries.
        found: String,
        /// What this end expects.
        expected: String,
    },
    /// The other end sends samples that are longer than this end has room for.
    #[error("the server at {peer} sends a sample of {bytes} bytes, more than the {longest} of this pipeline")]
    TooLong {
        /// The other end.
        peer: String,
        /// Bytes of the sample.
        bytes: usize,
        /// Bytes that this end has room for.
        longest: usize,
    },
    /// Any other reason, of a transport outside this crate.
    #[error("{0}")]
    Other(String),
}
