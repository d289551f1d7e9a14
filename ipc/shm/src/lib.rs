//! Samples through shared memory, on iceoryx2.
//!
//! A [`Domain`] is one run's corner of shared memory; a [`Topic`] in it is a publish-subscribe service with an event
//! service beside it. Ports carry bytes: a [`Contract`] says what they mean.
//!
//! - `domain`: node and config of a run, sweep of dead runs
//! - `topic`: services and their contract
//! - `erased`: the calls of iceoryx2 that carry any type
//! - `ports`: publisher, subscriber, loan, received sample
//! - `realtime`: scheduling class and locked memory
//! - `wake`: notifier, listener, waiting on several of them
//! - `words`: what iceoryx2 answers, in words

mod domain;
mod erased;
mod ports;
mod realtime;
mod topic;
mod wake;
mod words;

pub use domain::{Domain, sweep};
pub use ports::{Loan, Publisher, Received, Subscriber};
pub use realtime::real_time;
pub use topic::{Contract, Topic};
pub use wake::{Listener, Notifier, Wake};

/// Why shared memory did not do as asked.
#[derive(Clone, Debug, thiserror::Error)]
pub enum ShmError {
    /// The node of this process could not be made.
    #[error("no iceoryx2 node in {root}: {reason}")]
    Node {
        /// Root folder of the domain.
        root: String,
        /// Why, and what to do.
        reason: String,
    },
    /// A service could not be created or opened.
    #[error("topic {topic} ({type_name}): {reason}")]
    Topic {
        /// Name of the topic.
        topic: String,
        /// Contract text.
        type_name: String,
        /// Why, and what to do.
        reason: String,
    },
    /// A port could not be made or used.
    #[error("{port} on topic {topic}: {reason}")]
    Port {
        /// Name of the topic.
        topic: String,
        /// Kind of port.
        port: &'static str,
        /// Why, and what to do.
        reason: String,
    },
    /// A name that iceoryx2 does not take.
    #[error(
        "`{name}` cannot name a part of shared memory: it is too long, or has a character that no file name has"
    )]
    Name {
        /// The name.
        name: String,
    },
}
