//! The first line of a stream, by which the two ends know that they understand each other.

use crate::Channel;

/// The first line of a server: a receiver that expects another line takes no sample.
pub fn greeting(channel: &Channel) -> String {
    format!("stillpoint stream 1 {}\n", channel.name())
}
