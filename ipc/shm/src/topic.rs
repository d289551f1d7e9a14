//! Topics: a publish-subscribe service with an event service beside it.

use iceoryx2::prelude::*;
use iceoryx2::service::ipc;
use iceoryx2::service::port_factory::event::PortFactory as EventFactory;

use crate::contract::Contract;
use crate::domain::Domain;
use crate::erased::{self, DataFactory};
use crate::error::{PortKind, ShmError, name_error, port_error, topic_error};
use crate::ports::{Publisher, Subscriber};
use crate::wake::{Listener, Notifier};

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
        // Whether samples are kept is for the creator to say.
        let history = data.static_config().history_size();
        Ok(Self { contract: Contract { history, ..contract.clone() }, data, event })
    }

    /// What the users of the topic agree on.
    pub fn contract(&self) -> &Contract {
        &self.contract
    }

    /// A publisher.
    pub fn publisher(&self) -> Result<Publisher, ShmError> {
        Ok(Publisher::new(erased::publisher(&self.data, &self.contract)?, &self.contract))
    }

    /// A subscriber that keeps the newest `depth` samples. Samples sent before it has connected are not for it.
    pub fn subscriber(&self, depth: usize) -> Result<Subscriber, ShmError> {
        Ok(Subscriber::new(erased::subscriber(&self.data, &self.contract, depth, 0)?, &self.contract))
    }

    /// A subscriber with the deepest buffer, and its depth. It also receives what the publishers that live have kept from
    /// before it connects to them ([`Contract::history`]).
    pub fn subscriber_with_history(&self) -> Result<(Subscriber, usize), ShmError> {
        let (depth, history) = (self.contract.deepest(), self.contract.history);
        let port = erased::subscriber(&self.data, &self.contract, depth, history)?;
        Ok((Subscriber::new(port, &self.contract), depth))
    }

    /// Wakes the listeners of the topic.
    pub fn notifier(&self) -> Result<Notifier, ShmError> {
        let port = self.event.notifier_builder().create();
        Ok(Notifier::new(port.map_err(|e| port_error(&self.contract.topic, PortKind::Notifier, e))?))
    }

    /// Is woken by the topic's notifier. Only consumers make one: each listener costs the publisher time.
    pub fn listener(&self) -> Result<Listener, ShmError> {
        let port = self.event.listener_builder().create();
        let port = port.map_err(|e| port_error(&self.contract.topic, PortKind::Listener, e))?;
        Ok(Listener::new(port, &self.contract.topic))
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
