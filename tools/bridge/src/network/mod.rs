//! zenoh as the network of a run.
//!
//! - `hosts`: samples between the hosts of a pipeline
//! - `pool`: messages to and from the workers of a planning pool
//! - `ros2`: messages to and from ROS 2

mod hosts;
mod pool;
mod ros2;

use std::collections::BTreeMap;

use stillpoint_operator::outside::ClockOffset;
use stillpoint_operator::ros2::Subscription;
use stillpoint_pipeline::graph::PoolNode;
use stillpoint_pipeline::live::bridge::{
    BridgeSettings, MessageSender, Network, NetworkEvent, SentCounts, TakenCounts,
};
use stillpoint_remote::HostEvent;
use stillpoint_transport::{Receiver, Transport, TransportError};

use crate::error::BridgeError;

use hosts::Hosts;
use pool::PoolEdge;
use ros2::Ros2Node;

/// zenoh as the network of a run.
pub struct Zenoh {
    hosts: Option<Hosts>,
    /// By edge.
    pools: BTreeMap<String, PoolEdge>,
    ros2: Option<Ros2Node>,
}

impl Zenoh {
    /// Opens what the run takes part in.
    ///
    /// # Errors
    /// An endpoint, a port, a certificate or a router with which nothing can pass between hosts.
    pub fn open(settings: BridgeSettings) -> Result<Self, BridgeError> {
        let ros2 = settings.ros2.as_ref().map(|def| Ros2Node::open(def, &settings)).transpose()?;
        let open = |pool: &PoolNode| Ok((pool.name.clone(), PoolEdge::open(pool, settings.arrived.clone())?));
        let pools = settings.pools.iter().map(open).collect::<Result<_, BridgeError>>()?;
        Ok(Self { hosts: Hosts::open(settings)?, pools, ros2 })
    }

    fn ros2(&self) -> Result<&Ros2Node, TransportError> {
        self.ros2.as_ref().ok_or_else(|| TransportError::Other("the run takes no part in ROS 2".to_owned()))
    }
}

fn events(of: Vec<HostEvent>) -> impl Iterator<Item = NetworkEvent> {
    of.into_iter().map(|event| NetworkEvent { is_fault: event.is_fault, text: event.text })
}

fn sent_counts(sent: stillpoint_remote::Sent) -> SentCounts {
    SentCounts {
        offered: sent.offered,
        replaced: sent.replaced,
        unheard: sent.unheard,
        put: sent.put,
        waiting: sent.waiting,
        received: sent.received,
        refused: sent.refused,
    }
}

impl Network for Zenoh {
    fn transport(&self, edge: &str) -> Result<Box<dyn Transport>, TransportError> {
        match (self.pools.get(edge), &self.hosts) {
            (Some(pool), _) => Ok(pool.transport()),
            (None, Some(hosts)) => Ok(hosts.transport(edge)),
            (None, None) => Err(TransportError::Other(format!("this run has no edge `{edge}`"))),
        }
    }

    fn publisher(
        &self,
        name: &str,
        topic: &str,
        schema: (&str, &str),
    ) -> Result<Box<dyn MessageSender>, TransportError> {
        self.ros2()?.publisher(name, topic, schema)
    }

    fn subscriber(
        &self,
        name: &str,
        subscriptions: &[Subscription],
    ) -> Result<Box<dyn Receiver>, TransportError> {
        self.ros2()?.subscriber(name, subscriptions)
    }

    fn clock(&self, edge: &str) -> Option<ClockOffset> {
        if self.pools.contains_key(edge) {
            // A message is acquired when it arrives.
            return Some(ClockOffset { offset: 0, uncertainty: 0 });
        }
        self.hosts.as_ref().and_then(|hosts| hosts.clock(edge))
    }

    fn renewal(&self) -> Option<String> {
        self.hosts.as_ref().and_then(Hosts::renewal)
    }

    fn events(&self) -> Vec<NetworkEvent> {
        let of_hosts = self.hosts.iter().flat_map(Hosts::events);
        let of_pools = self.pools.values().flat_map(PoolEdge::take_events);
        of_hosts.chain(of_pools).chain(self.ros2.iter().flat_map(Ros2Node::events)).collect()
    }

    fn sent(&self) -> BTreeMap<String, SentCounts> {
        let of_hosts = self.hosts.iter().flat_map(Hosts::sent);
        let of_pools = self.pools.iter().map(|(edge, pool)| (edge.clone(), pool.sent()));
        of_hosts.chain(of_pools).chain(self.ros2.iter().flat_map(Ros2Node::sent)).collect()
    }

    fn taken(&self) -> BTreeMap<String, TakenCounts> {
        let of_hosts = self.hosts.iter().flat_map(Hosts::taken);
        let of_pools = self.pools.iter().map(|(edge, pool)| (edge.clone(), pool.taken()));
        of_hosts.chain(of_pools).chain(self.ros2.iter().flat_map(Ros2Node::taken)).collect()
    }
}
