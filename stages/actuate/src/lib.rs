//! Valves and beam: what leaves the program, and what forbids it.
//!
//! - [`key`]: the key that both ends share, and its file
//! - [`message`]: what a datagram says: an order, for a time, in a session
//! - [`datagram`]: its bytes, which carry a keyed code
//! - [`refusal`]: why a datagram is refused, and counts
//! - [`receiver`]: the far end: which are accepted, and what is to be done now
//! - [`far_end`]: valves and beam together, the beam off before anything vents

#![forbid(unsafe_code)]

pub mod datagram;
pub mod far_end;
pub mod key;
pub mod message;
pub mod receiver;
pub mod refusal;

pub use datagram::{EncodeError, LONGEST, decode, encode};
pub use far_end::{Doing, FarEnd};
pub use key::{Key, KeyError, KeyFile};
pub use message::{Message, Order, Receiving, Safe, Session, VALVES};
pub use receiver::{Act, Clock, Receiver, Receives};
pub use refusal::{Counts, Refusal};
