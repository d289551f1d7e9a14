//! Transports: what carries samples from one program to another, where shared memory does not reach.
//!
//! A link has two ends. The producer's process opens a [`Sender`], the consumer's process a [`Receiver`], both for the
//! same [`Channel`]: a type of sample, its frame and its greatest size. Neither end waits for the other: what cannot be
//! delivered is lost, and the sequence numbers in the headers show it.
//!
//! - `channel`: what goes over a link
//! - `datagrams`: one UDP datagram per sample, the payload alone
//! - `stream`: messages of another program on this host, over a socket of the Unix domain
//! - `conformance`: the test body that every transport has to pass
//! - `error`: why an end cannot be opened or a sample not be sent

// Outsiders use it.
#![warn(missing_docs)]

mod channel;
pub mod conformance;
mod datagrams;
mod error;
mod stream;

pub use channel::Channel;
pub use datagrams::Datagrams;
pub use error::{LinkRefusal, TransportError};
pub use stream::StreamReceiver;

use std::net::SocketAddr;

use stillpoint_samples::Pieces;

/// What a transport delivers of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carries {
    /// Header, body and elements.
    Samples,
    /// Only the elements, of at most this many bytes: the far end may be a device without headers.
    Payload {
        /// The most bytes that are delivered.
        longest: usize,
    },
}

/// How one end of a link stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkState {
    /// The other end is not there, or not yet.
    Waiting,
    /// Samples can pass. A transport without connections is always open.
    Open,
    /// The other end is there, but no sample passes, for this reason.
    Refused(LinkRefusal),
    /// This end was closed.
    Closed,
}

/// Carries samples over one link. Implementations may stand in crates of their own; they have to pass
/// [`conformance::conforms`].
pub trait Transport: Send + Sync {
    /// What it delivers of a sample.
    fn carries(&self) -> Carries;

    /// Opens the producer's end.
    ///
    /// # Errors
    /// The address or the name of the link cannot be used.
    fn open_sender(&self, channel: &Channel) -> Result<Box<dyn Sender>, TransportError>;

    /// Opens the consumer's end. The producer's end may come later, go, and come again.
    ///
    /// # Errors
    /// The address or the name of the link cannot be used.
    fn open_receiver(&self, channel: &Channel) -> Result<Box<dyn Receiver>, TransportError>;
}

/// The producer's end of a link.
pub trait Sender: Send {
    /// Sends a sample to every connected receiver. It never waits for a receiver: a newer sample replaces one that was
    /// not sent yet.
    ///
    /// # Errors
    /// The sample is not of the channel's type, or could not be handed to the system. What is lost later shows in the
    /// sequence numbers alone.
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError>;

    /// How this end stands.
    fn state(&self) -> LinkState;

    /// Closes this end. No sample is sent any more; the address is free when this returns, or soon after.
    fn close(&mut self);
}

/// What a receiver knows of where a message came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The sender's address, where every message has one of its own.
    pub sender: Option<SocketAddr>,
}

/// The consumer's end of a link.
pub trait Receiver: Send {
    /// Puts the oldest message that waits into `bytes`, whose memory may be exchanged. `None`: none waits. It never
    /// blocks.
    ///
    /// # Errors
    /// The system takes nothing any more.
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError>;

    /// Messages that this end discarded since the last call, as too many waited.
    fn discarded(&mut self) -> u64;

    /// Whether messages that are not taken wait at this end, a bounded number of them, rather than in the system.
    fn keeps_waiting(&self) -> bool;

    /// How this end stands.
    fn state(&self) -> LinkState;

    /// Closes this end. What waits is discarded.
    fn close(&mut self);
}
