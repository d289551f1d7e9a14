//! Samples through shared memory, on iceoryx2.
//!
//! A [`Domain`] is one run's corner of shared memory; a [`Topic`] in it is a publish-subscribe service with an event
//! service beside it. Ports carry bytes: a [`Contract`] says what they mean.
//!
//! - `domain`, `node_counter`: node and config of a run, sweep of dead runs; the object that other users must not open
//! - `contract`, `topic`: what the users of a topic agree on; its services
//! - `erased`: the calls of iceoryx2 that carry any type
//! - `ports`: publisher, subscriber, loan, received sample
//! - `realtime`: scheduling class and locked memory
//! - `wake`: notifier, listener, waiting on several of them
//! - `error`, `refusal`: why shared memory did not do as asked; iceoryx2's errors as ours

mod contract;
mod domain;
mod erased;
mod error;
mod node_counter;
mod ports;
mod realtime;
mod refusal;
mod topic;
mod wake;

pub use contract::Contract;
pub use domain::{Domain, VISITOR, sweep};
pub use error::{CounterFault, PortKind, PortRefusal, ShmError};
pub use ports::{Loan, Publisher, Received, Subscriber};
pub use realtime::{RealTimeError, real_time, real_time_if_allowed};
pub use topic::Topic;
pub use wake::{Listener, Notifier, Wake};
