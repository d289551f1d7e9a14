//! The convention in which programs of ROS 2 exchange messages over zenoh, as the middleware `rmw_zenoh` has it. This crate
//! knows no network: it makes and reads texts and bytes.
//!
//! A message is a publication at the key `DOMAIN/TOPIC/TYPE/HASH`. Its payload is the message in CDR, and its attachment
//! names its number, time and sender. Who is there is told by liveliness tokens, from which `ros2 topic list` and RViz
//! know nodes, publishers and subscriptions.
//!
//! ```
//! use stillpoint_ros2::{TopicName, key, rihs01};
//! let topic = TopicName::parse("/chatter")?;
//! let hash = rihs01("std_msgs/msg/String", "string data\n").expect("a description");
//! assert_eq!(hash, "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18");
//! assert_eq!(key(0, &topic, "std_msgs/msg/String", &hash), format!("0/chatter/std_msgs::msg::dds_::String_/{hash}"));
//! # Ok::<(), stillpoint_ros2::NameError>(())
//! ```
//!
//! - `names`: names of topics, nodes and types, and the keys of publications
//! - `attachment`: what stands beside each message
//! - `token`: liveliness tokens, and the identity of a sender that follows from its token
//! - `hash`: hashes of types (RIHS01) from their descriptions
//!
//! Sources: the design document of `rmw_zenoh`; REP 2011 and REP 2016 for the hashes.

mod attachment;
mod hash;
mod names;
mod token;

pub use attachment::{Attachment, AttachmentError};
pub use hash::{DescriptionError, rihs01};
pub use names::{NameError, TopicName, any_type, key, node_name, type_of_key};
pub use token::{EndKind, Ended, NodePlace, Qos, end_token, gid, node_token, tokens, who};

/// The largest domain.
pub const LARGEST_DOMAIN: u32 = 232;
/// The hash that programs before the hashes (ROS 2 Humble) give all types.
pub const NO_HASH: &str = "TypeHashNotSupported";
