//! Topics: a publish-subscribe service, an event service beside it, and the contract between their users.

use iceoryx2::prelude::*;
use iceoryx2::service::ipc;
use iceoryx2::service::port_factory::event::PortFactory as EventFactory;
use stillpoint_samples::{SampleKind, Shape};

use crate::domain::name_error;
use crate::erased::{self, DataFactory};
use crate::words::words;
use crate::{Domain, Listener, Notifier, Publisher, ShmError, Subscriber};

/// What users of a topic agree on. The creator's limits hold for all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contract {
    /// Name of the topic, `operator.port`.
    pub topic: String,
    /// Sample type, layout hash and frame: who says otherwise is refused.
    pub type_name: String,
    /// Bytes of header and body.
    pub meta_size: usize,
    /// Bytes of an element.
    pub element_size: usize,
    /// Alignment of an element.
    pub element_align: usize,
    /// Whether a sample has many elements.
    pub shape: Shape,
    /// The most elements of a sample.
    pub capacity: usize,
    /// The deepest buffer that a subscriber may ask for.
    pub buffer: usize,
    /// The most samples that a subscriber holds at a time.
    pub borrowed: usize,
    /// The most subscribers, taps included.
    pub subscribers: usize,
    /// The most publishers: one that lives, and dead ones that are not cleaned up yet.
    pub publishers: usize,
    /// The most processes that use the topic at a time.
    pub nodes: usize,
    /// Samples that the publisher's memory holds. The worst case over all subscribers would be far more.
    pub pool: usize,
}

impl Contract {
    /// The contract of `kind` in `frame`, with room for one consumer of depth 1 and taps.
    pub fn new(topic: &str, kind: &SampleKind, frame: Option<&str>, capacity: usize) -> Self {
        Self {
            topic: topic.to_string(),
            type_name: match frame {
                Some(frame) => format!("{} in {frame}", kind.type_name()),
                None => kind.type_name(),
            },
            meta_size: kind.meta_size(),
            element_size: kind.element_size,
            element_align: kind.element_align,
            shape: kind.shape,
            capacity: capacity.max(1),
            buffer: 1,
            borrowed: 2,
            subscribers: 8,
            publishers: 4,
            nodes: 64,
            pool: 8,
        }
    }

    /// Bytes of shared memory that a publisher of this topic takes.
    pub fn pool_bytes(&self) -> usize {
        // iceoryx2's own header precedes each sample.
        (self.capacity * self.element_size + self.meta_size + 128) * self.pool
    }
}

/// A topic of a run. It keeps the services alive, also while nobody has a port on them.
pub struct Topic {
    pub(crate) contract: Contract,
    data: DataFactory,
    event: EventFactory<ipc::Service>,
}

impl Topic {
    /// Creates the topic. The supervisor does it, for every topic of the graph, before any other process starts.
    pub fn create(domain: &Domain, contract: &Contract) -> Result<Self, ShmError> {
        let name = service_name(contract)?;
        let data = erased::create(domain, &name, contract)?;
        let event = event_builder(domain, &name, contract).create().map_err(|e| topic_error(contract, e))?;
        Ok(Self { contract: contract.clone(), data, event })
    }

    /// Opens a topic that the supervisor created.
    pub fn open(domain: &Domain, contract: &Contract) -> Result<Self, ShmError> {
        let name = service_name(contract)?;
        let data = erased::open(domain, &name, contract)?;
        let event = event_builder(domain, &name, contract).open().map_err(|e| topic_error(contract, e))?;
        Ok(Self { contract: contract.clone(), data, event })
    }

    /// What the users of the topic agree on.
    pub fn contract(&self) -> &Contract {
        &self.contract
    }

    /// A publisher.
    pub fn publisher(&self) -> Result<Publisher, ShmError> {
        Publisher::new(erased::publisher(&self.data, &self.contract)?, &self.contract)
    }

    /// A subscriber that keeps the newest `depth` samples. Samples sent before it has connected are not for it.
    pub fn subscriber(&self, depth: usize) -> Result<Subscriber, ShmError> {
        Subscriber::new(erased::subscriber(&self.data, &self.contract, depth)?, &self.contract)
    }

    /// Wakes the listeners of the topic.
    pub fn notifier(&self) -> Result<Notifier, ShmError> {
        let port =
            self.event.notifier_builder().create().map_err(|e| port_error(&self.contract, "notifier", e))?;
        Ok(Notifier::new(port))
    }

    /// Is woken by the topic's notifier. Only consumers make one: each listener costs the publisher time.
    pub fn listener(&self) -> Result<Listener, ShmError> {
        let port =
            self.event.listener_builder().create().map_err(|e| port_error(&self.contract, "listener", e))?;
        Ok(Listener::new(port, &self.contract))
    }
}

fn event_builder(
    domain: &Domain,
    name: &ServiceName,
    contract: &Contract,
) -> iceoryx2::service::builder::event::Builder<ipc::Service> {
    domain
        .node
        .service_builder(name)
        .event()
        .max_notifiers(contract.publishers)
        .max_listeners(contract.subscribers)
        .max_nodes(contract.nodes)
        .event_id_max_value(0)
}

fn service_name(contract: &Contract) -> Result<ServiceName, ShmError> {
    ServiceName::new(&contract.topic).map_err(|_| name_error(&contract.topic))
}

pub(crate) fn topic_error(contract: &Contract, e: impl std::fmt::Debug) -> ShmError {
    ShmError::Topic {
        topic: contract.topic.clone(),
        type_name: contract.type_name.clone(),
        reason: words(&e),
    }
}

pub(crate) fn port_error(contract: &Contract, port: &'static str, e: impl std::fmt::Debug) -> ShmError {
    ShmError::Port { topic: contract.topic.clone(), port, reason: words(&e) }
}
