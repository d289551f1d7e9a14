//! What a network must do for the bridge.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use stillpoint_operator::outside::ClockOffset;
use stillpoint_operator::ros2::Subscription;
use stillpoint_transport::{LinkState, Receiver, Transport, TransportError};

use super::hello::BridgeIdentity;
use super::ros2::Ros2Def;
use crate::clock::SessionClock;
use crate::graph::{HostNode, PoolNode};

/// All that a network needs to know of a run.
pub struct BridgeSettings {
    /// This host, where the pipeline runs on several.
    pub host: Option<HostNode>,
    /// The planning pools that operators reach; each is an edge of this name.
    pub pools: Vec<PoolNode>,
    /// How the run takes part in ROS 2, where it does.
    pub ros2: Option<Ros2Def>,
    /// What it runs: hosts that do not run the same exchange nothing.
    pub identity: BridgeIdentity,
    /// Number of this life of the bridge: a later life has a higher number.
    pub incarnation: u64,
    /// The clock of the session.
    pub clock: SessionClock,
    /// To be called when a sample has arrived. It returns at once.
    pub arrived: Arc<dyn Fn() + Send + Sync>,
}

/// Something that happened on the network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkEvent {
    /// What happened.
    pub text: String,
    /// Nothing passes any more, or never did.
    pub is_fault: bool,
}

/// The counts of the sending end of an edge: `offered = replaced + unheard + put + waiting`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SentCounts {
    /// Samples given to the network.
    pub offered: u64,
    /// Samples that newer ones replaced before they left.
    pub replaced: u64,
    /// Samples that no host was there to take.
    pub unheard: u64,
    /// Samples that left.
    pub put: u64,
    /// Samples that wait.
    pub waiting: u64,
    /// Samples of `put` that the other host says it has.
    pub received: u64,
    /// Samples of `put` that the other host has refused.
    pub refused: u64,
}

/// The counts of the taking end of an edge: what left the other host since this end was opened is
/// `received + refused + lost`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TakenCounts {
    /// Samples that arrived.
    pub received: u64,
    /// Samples that arrived and were not valid.
    pub refused: u64,
    /// Samples that did not arrive.
    pub lost: u64,
}

/// Sends messages to a topic of ROS 2. It never waits: newer messages replace older ones that were not sent yet.
pub trait MessageSender: Send {
    /// Sends a message in CDR. `None`: a sample that no message can say, which counts as refused.
    fn send(&mut self, message: Option<Vec<u8>>);

    /// How the topic stands: `Open` where somebody takes its messages.
    fn state(&self) -> LinkState;
}

/// A network between hosts, and to ROS 2.
pub trait Network {
    /// The transport of an edge.
    ///
    /// # Errors
    /// The network has no such edge.
    fn transport(&self, edge: &str) -> Result<Box<dyn Transport>, TransportError>;

    /// The sending end of a topic of ROS 2, of this type: its name and its description. `name` is that of its counts.
    ///
    /// # Errors
    /// The network has no ROS 2, or does not take the topic.
    fn publisher(
        &self,
        name: &str,
        topic: &str,
        schema: (&str, &str),
    ) -> Result<Box<dyn MessageSender>, TransportError>;

    /// The taking end of topics of ROS 2, whose messages come as
    /// [`Delivery`](stillpoint_operator::ros2::Delivery). `name` is that of its counts.
    ///
    /// # Errors
    /// The network has no ROS 2, or does not take a topic.
    fn subscriber(
        &self,
        name: &str,
        subscriptions: &[Subscription],
    ) -> Result<Box<dyn Receiver>, TransportError>;

    /// The clock of the host from which the samples of an edge come, where it is measured.
    fn clock(&self, edge: &str) -> Option<ClockOffset>;

    /// Why the network is to be opened anew, if it is: this process ends, and another one opens it.
    fn renewal(&self) -> Option<String> {
        None
    }

    /// What happened since the last call.
    fn events(&self) -> Vec<NetworkEvent>;

    /// The counts of the sending ends, by edge.
    fn sent(&self) -> BTreeMap<String, SentCounts>;

    /// The counts of the taking ends, by edge.
    fn taken(&self) -> BTreeMap<String, TakenCounts>;
}
