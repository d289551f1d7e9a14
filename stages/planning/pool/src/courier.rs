//! Who carries messages.

/// To whom a message goes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum To {
    /// Everybody on the pool's network.
    All,
    /// The one of this name.
    One(String),
}

impl To {
    /// The one of this name.
    pub fn one(name: &str) -> Self {
        Self::One(name.to_owned())
    }
}

/// A message that arrived.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Who sent it.
    pub from: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Why no message will arrive any more.
#[derive(Debug, thiserror::Error)]
pub enum CourierError {
    /// What arrives is not a message.
    #[error("the process that carries messages to the pool sends what is not a message: {0}")]
    NotAMessage(std::io::Error),
    /// The process that carries messages has ended.
    #[error("the process that carries messages to the pool has ended")]
    Ended,
}

/// Carries messages and keeps the time. It may lose messages, repeat them, and change their order.
pub trait Courier {
    /// Nanoseconds since any moment; it does not go back.
    fn now(&self) -> u64;

    /// Sends a message, or loses it. It does not wait.
    fn send(&mut self, to: &To, bytes: Vec<u8>);

    /// The next message, waiting for one until this time at most.
    ///
    /// # Errors
    /// Nothing will arrive any more.
    fn receive(&mut self, until: u64) -> Result<Option<Arrival>, CourierError>;
}
