//! The bridge: the process of a run that carries samples between hosts, and to and from ROS 2. Shared memory is on one side of it, a network on
//! the other, so that no stage ever waits for the network.
//!
//! The network is no part of this crate: a program of its own brings it (`tools/bridge`) and calls [`bridge_main`].
//!
//! - `network`: what a network must do
//! - `hello`: the first message to the bridge, with all that it needs to know of the graph
//! - `process`: the body of the process
//! - `ros2`: samples as messages of ROS 2
//! - `edges`: the samples of one edge, from shared memory to the network or back
//! - `accounts`: the counts of the bridge, and the lines of the ledger that follow from them
//! - `program`: where the program of the bridge is

mod accounts;
mod edges;
mod hello;
mod network;
mod process;
mod program;
mod ros2;

pub use accounts::{BridgeAccounts, BridgeReport};
pub use hello::{BridgeIdentity, HelloBridge, identity_of};
pub use network::{BridgeSettings, MessageSender, Network, NetworkEvent, SentCounts, TakenCounts};
pub use process::bridge_main;
pub use program::{BRIDGE_VARIABLE, BridgeMissing, bridge_launch};
pub use ros2::Ros2Def;
