//! The transport between hosts: publications over zenoh behind the seam [`stillpoint_transport::Transport`].
//!
//! A [`Host`] is one end of the network: two zenoh sessions, one for small samples and beats, one for bulk, each with a
//! TCP connection of its own. Each edge that leaves or reaches the host is a [`Remote`], a transport of one channel.
//!
//! zenoh discards without a message, and waits before it discards. So each sender has a bounded queue of its own, from
//! which a thread puts; the beats of each host carry the counts of its senders and receivers, so that lost tails are
//! seen; and a peer is alive only as long as its beats arrive.
//!
//! - `tls`: the certificate of a program
//! - `access`: roles, and what a peer of each role may send and take
//! - `probe`: why another end refuses this one
//! - `pki`: a small authority that makes certificates
//! - `watch`: the thread that finds out why nobody is heard
//! - `endpoints`: where a host listens and connects, and the zenoh session for it
//! - `identity`: what two hosts compare before anything flows
//! - `beat`: the message by which a host is alive, with the counts of its ends
//! - `attachment`: what precedes the body of a sample on the wire
//! - `names`: keys of publications
//! - `clocks`: the offset between the clocks of two hosts
//! - `peers`: what a host knows of the others
//! - `host`: the sessions and the ends; `shared`: what its threads share; `beating`: the thread that beats
//! - `declare`: publishers and subscribers
//! - `sender`, `receiver`: the two ends of an edge
//! - `lane`: the thread that puts
//! - `mailbox`: messages between named programs, for the planning pool
//! - `ros2`: one node of ROS 2
//! - `router`: a router between hosts that cannot reach each other; `roster`: those who greet through it

mod access;
mod attachment;
mod beat;
mod beating;
mod clocks;
mod declare;
mod endpoints;
mod error;
mod host;
mod identity;
mod lane;
mod mailbox;
mod names;
mod peers;
mod pki;
mod probe;
mod receiver;
mod remote;
mod ros2;
mod roster;
mod router;
mod sender;
mod shared;
mod tls;
mod watch;

pub use access::Role;
pub use attachment::Attachment;
pub use beat::{Beat, BeatError, Seen, Sends, Takes};
pub use clocks::Offset;
pub use endpoints::Endpoints;
pub use error::RemoteError;
pub use host::{Host, HostSettings};
pub use identity::HostIdentity;
pub use mailbox::Mailbox;
pub use peers::{HostEvent, PEER_SILENCE, PeerReport, PeerState};
pub use pki::{Authority, Issued, PkiError};
pub use probe::{Answer, probe};
pub use receiver::Taken;
pub use remote::Remote;
pub use ros2::{Ros2, Ros2Message, Ros2Publisher, Ros2Settings, TakeMessage};
pub use roster::{Member, Roster};
pub use router::Router;
pub use sender::Sent;
pub use tls::{Tls, TlsError, TlsFiles};
