//! Messages to and from ROS 2.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use stillpoint_cdr::schema;
use stillpoint_operator::ros2::{Content, Delivery, LONGEST_ATTACHMENT, Subscription};
use stillpoint_pipeline::clock::SessionClock;
use stillpoint_pipeline::live::bridge::{
    BridgeSettings, MessageSender, NetworkEvent, Ros2Def, SentCounts, TakenCounts,
};
use stillpoint_remote::{Ros2, Ros2Message, Ros2Publisher, Ros2Settings};
use stillpoint_transport::{LinkState, Origin, Receiver, TransportError};

use crate::error::BridgeError;

/// Topic of the static frames.
const STATIC_FRAMES: &str = "/tf_static";
/// Messages of an operator that wait, if they are small; one on top costs the oldest.
const MOST: usize = 64;
/// Bytes that wait, beside the newest message.
const MOST_BYTES: usize = 8 << 20;

/// The node of a run.
pub struct Ros2Node {
    node: Ros2,
    clock: SessionClock,
    arrived: Arc<dyn Fn() + Send + Sync>,
    inboxes: Mutex<BTreeMap<String, Arc<Inbox>>>,
}

impl Ros2Node {
    /// Begins to look for the router.
    pub fn open(def: &Ros2Def, settings: &BridgeSettings) -> Result<Self, BridgeError> {
        let Ros2Def { connect, domain, node, longest, frames } = def.clone();
        let node = Ros2::open(Ros2Settings { connect, domain, node, longest })?;
        if !frames.is_empty() {
            node.repeat(STATIC_FRAMES, schema::TRANSFORMS, frames)?;
        }
        let (clock, arrived) = (settings.clock, settings.arrived.clone());
        Ok(Self { node, clock, arrived, inboxes: Mutex::default() })
    }

    pub fn publisher(
        &self,
        name: &str,
        topic: &str,
        schema: (&str, &str),
    ) -> Result<Box<dyn MessageSender>, TransportError> {
        let publisher = self.node.publisher(name, topic, schema);
        Ok(Box::new(Publishes(publisher.map_err(|e| TransportError::Other(e.to_string()))?)))
    }

    pub fn subscriber(
        &self,
        name: &str,
        subscriptions: &[Subscription],
    ) -> Result<Box<dyn Receiver>, TransportError> {
        let inbox = Arc::new(Inbox::default());
        self.inboxes().insert(name.to_owned(), inbox.clone());
        for (number, subscription) in (0_u32..).zip(subscriptions) {
            let known = schema::ALL.into_iter().find(|(name, _)| *name == subscription.type_name);
            let of_type = known.ok_or_else(|| {
                TransportError::Other(format!("there is no type {}", subscription.type_name))
            })?;
            let (inbox, clock, arrived) = (inbox.clone(), self.clock, self.arrived.clone());
            let longest = subscription.longest;
            let take = move |message: &Ros2Message<'_>| {
                inbox.offer(number, clock.now(), message, longest);
                arrived();
            };
            let taken = self.node.take(&subscription.topic, of_type, Arc::new(take));
            taken.map_err(|e| TransportError::Other(e.to_string()))?;
        }
        Ok(Box::new(Subscribes(inbox)))
    }

    pub fn events(&self) -> Vec<NetworkEvent> {
        super::events(self.node.events()).collect()
    }

    pub fn sent(&self) -> BTreeMap<String, SentCounts> {
        self.node.sent().into_iter().map(|(name, sent)| (name, super::sent_counts(sent))).collect()
    }

    pub fn taken(&self) -> BTreeMap<String, TakenCounts> {
        let counts = |inbox: &Inbox| TakenCounts { received: inbox.state().came, refused: 0, lost: 0 };
        self.inboxes().iter().map(|(name, inbox)| (name.clone(), counts(inbox))).collect()
    }

    fn inboxes(&self) -> MutexGuard<'_, BTreeMap<String, Arc<Inbox>>> {
        self.inboxes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The sending end of a topic.
struct Publishes(Ros2Publisher);

impl MessageSender for Publishes {
    fn send(&mut self, message: Option<Vec<u8>>) {
        self.0.send(message);
    }

    fn state(&self) -> LinkState {
        if self.0.has_listener() { LinkState::Open } else { LinkState::Waiting }
    }
}

/// Messages of an operator that wait to be handed over.
#[derive(Default)]
struct Inbox(Mutex<Waiting>);

#[derive(Default)]
struct Waiting {
    deliveries: VecDeque<Vec<u8>>,
    bytes: usize,
    /// Buffers to be used again.
    spare: Vec<Vec<u8>>,
    /// Messages that came.
    came: u64,
    /// Messages that newer ones replaced since the last call.
    discarded: u64,
}

impl Inbox {
    fn state(&self) -> MutexGuard<'_, Waiting> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn offer(&self, subscription: u32, now: u64, message: &Ros2Message<'_>, longest: usize) {
        let mut delivery = self.state().spare.pop().unwrap_or_default();
        let content = if !message.is_of_type {
            Err(Content::OtherType)
        } else if message.payload.len() > longest {
            Err(Content::TooLong)
        } else if message.attachment.len() > LONGEST_ATTACHMENT {
            Err(Content::Attachment)
        } else {
            Ok((message.attachment, message.payload.slices()))
        };
        // Without the lock: a long message takes its time.
        Delivery::write(subscription, now, content, &mut delivery);
        let mut state = self.state();
        state.came += 1;
        state.bytes += delivery.len();
        state.deliveries.push_back(delivery);
        while state.deliveries.len() > 1 && (state.deliveries.len() > MOST || state.bytes > MOST_BYTES) {
            let Some(oldest) = state.deliveries.pop_front() else { break };
            state.bytes -= oldest.len();
            state.discarded += 1;
            state.keep(oldest);
        }
    }
}

impl Waiting {
    /// Keeps a buffer for the next message.
    fn keep(&mut self, buffer: Vec<u8>) {
        if self.spare.len() < 3 {
            self.spare.push(buffer);
        }
    }
}

/// The taking end of the topics of an operator.
struct Subscribes(Arc<Inbox>);

impl Receiver for Subscribes {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        let mut state = self.0.state();
        let Some(mut next) = state.deliveries.pop_front() else { return Ok(None) };
        state.bytes -= next.len();
        std::mem::swap(bytes, &mut next);
        state.keep(next);
        Ok(Some(Origin { sender: None }))
    }

    fn discarded(&mut self) -> u64 {
        std::mem::take(&mut self.0.state().discarded)
    }

    fn keeps_waiting(&self) -> bool {
        true
    }

    fn state(&self) -> LinkState {
        LinkState::Open
    }

    fn close(&mut self) {}
}
