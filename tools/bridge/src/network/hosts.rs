//! Samples between the hosts of a pipeline.

use std::collections::BTreeMap;
use std::sync::Arc;

use stillpoint_operator::outside::ClockOffset;
use stillpoint_pipeline::graph::HostTls;
use stillpoint_pipeline::live::bridge::{BridgeSettings, NetworkEvent, SentCounts, TakenCounts};
use stillpoint_remote::{Endpoints, Host, HostIdentity, HostSettings, Remote, Tls, TlsFiles};
use stillpoint_transport::Transport;

use crate::error::BridgeError;

/// First part of all keys.
const PREFIX: &str = "stillpoint";

/// This host among the others.
pub struct Hosts(Arc<Host>);

impl Hosts {
    /// Opens it; `None` where the pipeline has no hosts.
    pub fn open(settings: BridgeSettings) -> Result<Option<Self>, BridgeError> {
        let BridgeSettings { host, identity, incarnation, clock, arrived, .. } = settings;
        let Some(host) = host else { return Ok(None) };
        let tls = host.tls.map(|HostTls { certificate, key, authority }| {
            Tls::load(&TlsFiles { certificate, key, authority }).map(Arc::new)
        });
        let tls = tls.transpose()?;
        let opened = Host::open(HostSettings {
            prefix: PREFIX.to_owned(),
            name: host.name,
            endpoints: Endpoints { listen: host.listen, connect: host.connect, router: host.router, tls },
            identity: HostIdentity {
                pipeline: identity.pipeline,
                hash: identity.hash,
                version: identity.version,
                cpu: identity.processor,
            },
            incarnation,
            clock: Arc::new(move || clock.now()),
            arrived,
        });
        Ok(Some(Self(opened?)))
    }

    pub fn transport(&self, edge: &str) -> Box<dyn Transport> {
        Box::new(Remote::new(&self.0, edge))
    }

    pub fn clock(&self, edge: &str) -> Option<ClockOffset> {
        let offset = self.0.offset_of(edge)?;
        Some(ClockOffset { offset: offset.offset, uncertainty: offset.uncertainty })
    }

    pub fn renewal(&self) -> Option<String> {
        self.0
            .is_outdated()
            .then(|| "a new certificate was written: the bridge begins anew with it".to_owned())
    }

    pub fn events(&self) -> Vec<NetworkEvent> {
        super::events(self.0.events()).collect()
    }

    pub fn sent(&self) -> BTreeMap<String, SentCounts> {
        self.0.sent().into_iter().map(|(edge, sent)| (edge, super::sent_counts(sent))).collect()
    }

    pub fn taken(&self) -> BTreeMap<String, TakenCounts> {
        let counts = |taken: stillpoint_remote::Taken| TakenCounts {
            received: taken.received,
            refused: taken.refused,
            lost: taken.lost + taken.missing,
        };
        self.0.taken().into_iter().map(|(edge, taken)| (edge, counts(taken))).collect()
    }
}
