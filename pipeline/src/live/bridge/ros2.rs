//! Samples as messages of ROS 2: what of a run goes there and comes from there.

use serde::{Deserialize, Serialize};
use stillpoint_operator::ros2::Subscription;
use stillpoint_recorder::{RosMessage, static_frames};
use stillpoint_samples::{Pieces, SampleKind};
use stillpoint_transport::{Channel, LinkState, Sender, TransportError};

use super::network::{MessageSender, Network};
use crate::graph::{Graph, Publication};
use crate::session;

/// How a run takes part in ROS 2.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ros2Def {
    /// Endpoint of the router.
    pub connect: String,
    /// The domain.
    pub domain: u32,
    /// Name of the node.
    pub node: String,
    /// Bytes of the longest message that is taken.
    pub longest: usize,
    /// The message for `/tf_static`; empty where the run publishes nothing, or has no frames.
    pub frames: Vec<u8>,
}

impl Ros2Def {
    /// Of a graph, where it takes part.
    pub fn of(graph: &Graph) -> Option<Self> {
        let node = graph.ros2.as_ref()?;
        let is_part = graph.publishes().next().is_some() || graph.subscribes().next().is_some();
        let frames = session::static_transforms(graph);
        let sends_frames = !frames.is_empty() && graph.publishes().next().is_some();
        let longest = graph.subscribes().flat_map(|o| &graph.operators[o].subscriptions).map(|s| s.longest);
        is_part.then(|| Self {
            longest: longest.max().unwrap_or(0),
            connect: node.connect.clone(),
            domain: node.domain,
            node: stillpoint_ros2::node_name(&graph.name),
            frames: if sends_frames { static_frames(&frames) } else { Vec::new() },
        })
    }
}

/// What is published of an output.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PublicationDef {
    /// Name of its counts.
    pub name: String,
    /// The topic of ROS 2.
    pub topic: String,
    /// Name of the message's type.
    pub type_name: String,
    /// The frame that a pose places.
    pub child: String,
}

impl PublicationDef {
    /// Of a publication.
    pub fn of(publication: &Publication) -> Self {
        let Publication { topic, message, child, .. } = publication;
        // Several poses may place frames on /tf.
        let name = match message {
            RosMessage::TfMessage => format!("ros2:{topic}:{child}"),
            _ => format!("ros2:{topic}"),
        };
        Self { name, topic: topic.clone(), type_name: message.type_name().to_owned(), child: child.clone() }
    }
}

/// A topic of ROS 2 that an operator takes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubscriptionDef {
    topic: String,
    type_name: String,
    longest: usize,
}

impl SubscriptionDef {
    /// Of a subscription.
    pub fn of(subscription: &Subscription) -> Self {
        let Subscription { topic, type_name, longest } = subscription.clone();
        Self { topic, type_name, longest }
    }

    /// The subscription.
    pub fn subscription(&self) -> Subscription {
        let Self { topic, type_name, longest } = self.clone();
        Subscription { topic, type_name, longest }
    }
}

/// Publishes the samples of an output as messages of one type.
pub struct Publishing {
    message: RosMessage,
    kind: &'static SampleKind,
    frame: String,
    child: String,
    sender: Box<dyn MessageSender>,
}

impl Publishing {
    /// Opens it.
    ///
    /// # Errors
    /// The network has no ROS 2, or does not take the topic.
    pub fn open(
        publication: &PublicationDef,
        channel: &Channel,
        network: &dyn Network,
    ) -> Result<Self, TransportError> {
        let message = RosMessage::from_name(&publication.type_name)
            .ok_or_else(|| TransportError::Other(format!("there is no {}", publication.type_name)))?;
        Ok(Self {
            message,
            kind: channel.kind,
            frame: channel.frame.clone().unwrap_or_default(),
            child: publication.child.clone(),
            sender: network.publisher(&publication.name, &publication.topic, message.schema())?,
        })
    }
}

impl Sender for Publishing {
    fn send(&mut self, sample: Pieces<'_>) -> Result<(), TransportError> {
        let sample = sample.check(self.kind).map_err(TransportError::Sample)?;
        let mut message = Vec::new();
        let says = self.message.encode(self.kind, &sample, &self.frame, &self.child, &mut message);
        self.sender.send(says.then_some(message));
        Ok(())
    }

    fn state(&self) -> LinkState {
        self.sender.state()
    }

    fn close(&mut self) {}
}
