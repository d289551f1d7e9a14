//! One node of ROS 2, in the convention of its middleware `rmw_zenoh`: topics that it publishes and takes, through the
//! router of ROS 2.
//!
//! A session of its own, a client of the router, is opened by a thread that tries until the router is there; nobody waits
//! for it. Each topic that is published has a bounded queue, from which the same thread puts. Messages are bytes here:
//! what they mean, nobody asks.
//!
//! - `session`: the thread: it opens the session, declares what is there, and puts
//! - `outbox`: messages of a topic that wait to be put
//! - `graph`: who publishes and takes which topic, from the liveliness tokens of others

mod graph;
mod outbox;
mod session;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;

use stillpoint_ros2::{NO_HASH, TopicName, rihs01, type_of_key};

use crate::shared::lock;
use crate::{HostEvent, RemoteError, Sent};
use graph::RosGraph;
use outbox::Outbox;

/// What a node is.
#[derive(Clone, Debug)]
pub struct Ros2Settings {
    /// Endpoint of the router, `tcp/ADDRESS:PORT`.
    pub connect: String,
    /// The domain.
    pub domain: u32,
    /// Name of the node.
    pub node: String,
    /// Bytes of the longest message that is taken.
    pub longest: usize,
}

/// A message that arrived.
pub struct Ros2Message<'a> {
    /// It is of the type that was asked for.
    pub is_of_type: bool,
    /// What stands beside it; empty where it has none.
    pub attachment: &'a [u8],
    /// The message in CDR, in pieces.
    pub payload: &'a zenoh::bytes::ZBytes,
}

/// Takes messages, on a thread of zenoh: it must return at once.
pub type TakeMessage = Arc<dyn Fn(&Ros2Message<'_>) + Send + Sync>;

/// A topic: its name, and name and hash of its type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TypedTopic {
    pub name: TopicName,
    pub type_name: String,
    pub hash: String,
}

impl TypedTopic {
    fn new(topic: &str, (type_name, text): (&str, &str)) -> Result<Self, RemoteError> {
        let refused = |reason: String| RemoteError::Declare { key: topic.to_owned(), reason };
        Ok(Self {
            name: TopicName::parse(topic).map_err(|e| refused(e.to_string()))?,
            type_name: type_name.to_owned(),
            hash: rihs01(type_name, text).map_err(|e| refused(e.to_string()))?,
        })
    }

    /// Whether the key of a message says this type. Programs of ROS 2 Humble have no hashes.
    fn is_of(&self, key: &str) -> bool {
        type_of_key(key)
            .is_some_and(|(name, hash)| name == self.type_name && (hash == self.hash || hash == NO_HASH))
    }
}

/// A topic that is taken.
pub(crate) struct Taking {
    pub topic: TypedTopic,
    pub take: TakeMessage,
}

/// What the thread of a node shares with its topics.
pub(crate) struct Shared {
    pub settings: Ros2Settings,
    /// Topics that are published, with the names of their counts.
    pub outboxes: Mutex<Vec<(String, Arc<Outbox>)>>,
    /// Topics that are taken.
    pub takings: Mutex<Vec<Arc<Taking>>>,
    /// Messages that are put each second.
    pub repeated: Mutex<Vec<(Arc<Outbox>, Vec<u8>)>>,
    pub graph: Mutex<RosGraph>,
    pub news: Mutex<bool>,
    pub signal: Condvar,
    /// The session has its router.
    pub is_connected: AtomicBool,
    pub is_closed: AtomicBool,
}

impl Shared {
    /// There is something to declare or to put.
    pub fn wake(&self) {
        *lock(&self.news) = true;
        self.signal.notify_one();
    }
}

/// One node of ROS 2.
pub struct Ros2 {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Ros2 {
    /// Begins to look for the router. It waits for nothing.
    ///
    /// # Errors
    /// The endpoint is not written as one, or a thread cannot be had.
    pub fn open(settings: Ros2Settings) -> Result<Self, RemoteError> {
        session::config(&settings)?;
        let shared = Arc::new(Shared {
            graph: Mutex::new(RosGraph::default()),
            settings,
            outboxes: Mutex::default(),
            takings: Mutex::default(),
            repeated: Mutex::default(),
            news: Mutex::new(false),
            signal: Condvar::new(),
            is_connected: AtomicBool::new(false),
            is_closed: AtomicBool::new(false),
        });
        let of_thread = shared.clone();
        let thread = std::thread::Builder::new()
            .name("ros2".to_owned())
            .spawn(move || session::run(&of_thread))
            .map_err(|e| RemoteError::Thread(e.to_string()))?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// A topic to publish, of this type: its name and its `ros2msg` text. `name` is that of its counts.
    ///
    /// # Errors
    /// The topic has no name of ROS 2, or the text describes no type.
    pub fn publisher(
        &self,
        name: &str,
        topic: &str,
        schema: (&str, &str),
    ) -> Result<Ros2Publisher, RemoteError> {
        let outbox = Arc::new(Outbox::new(TypedTopic::new(topic, schema)?));
        lock(&self.shared.graph).gives(topic);
        lock(&self.shared.outboxes).push((name.to_owned(), outbox.clone()));
        self.shared.wake();
        Ok(Ros2Publisher { shared: self.shared.clone(), outbox })
    }

    /// Takes the messages of a topic, also those of another type.
    ///
    /// # Errors
    /// The topic has no name of ROS 2, or the text describes no type.
    pub fn take(&self, topic: &str, schema: (&str, &str), take: TakeMessage) -> Result<(), RemoteError> {
        let topic = TypedTopic::new(topic, schema)?;
        lock(&self.shared.graph).takes(topic.name.as_str(), &topic.type_name);
        lock(&self.shared.takings).push(Arc::new(Taking { topic, take }));
        self.shared.wake();
        Ok(())
    }

    /// Puts a message each second, as one that does not change: those who come later get it, too.
    ///
    /// # Errors
    /// The topic has no name of ROS 2, or the text describes no type.
    pub fn repeat(&self, topic: &str, schema: (&str, &str), message: Vec<u8>) -> Result<(), RemoteError> {
        let outbox = Arc::new(Outbox::new(TypedTopic::new(topic, schema)?));
        lock(&self.shared.repeated).push((outbox, message));
        self.shared.wake();
        Ok(())
    }

    /// Whether the node has its router.
    pub fn is_connected(&self) -> bool {
        self.shared.is_connected.load(Ordering::Relaxed)
    }

    /// What happened since the last call.
    pub fn events(&self) -> Vec<HostEvent> {
        lock(&self.shared.graph).events()
    }

    /// The counts of the topics that are published, by the names that they were given.
    pub fn sent(&self) -> BTreeMap<String, Sent> {
        lock(&self.shared.outboxes).iter().map(|(name, outbox)| (name.clone(), outbox.sent())).collect()
    }
}

impl Drop for Ros2 {
    fn drop(&mut self) {
        self.shared.is_closed.store(true, Ordering::Relaxed);
        self.shared.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The sending end of a topic.
pub struct Ros2Publisher {
    shared: Arc<Shared>,
    outbox: Arc<Outbox>,
}

impl Ros2Publisher {
    /// Sends a message in CDR: it never waits. `None` is one that could not be made, which is counted.
    pub fn send(&self, message: Option<Vec<u8>>) {
        self.outbox.offer(message);
        self.shared.wake();
    }

    /// Whether somebody takes the topic.
    pub fn has_listener(&self) -> bool {
        self.outbox.has_listener()
    }
}
