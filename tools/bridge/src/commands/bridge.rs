//! `stillpoint-bridge bridge`: the bridge of a run.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::Arc;

use clap::Args;
use stillpoint_operator::outside::ClockOffset;
use stillpoint_pipeline::graph::HostTls;
use stillpoint_pipeline::live::bridge::{
    BridgeSettings, Network, NetworkEvent, SentCounts, TakenCounts, bridge_main,
};
use stillpoint_remote::{Endpoints, Host, HostSettings, Identity, Remote, Tls, TlsFiles};
use stillpoint_transport::Transport;

/// First part of all keys.
const PREFIX: &str = "stillpoint";

/// Carry samples between this host and the others of a pipeline. `stillpoint run --host` starts it and tells it what to
/// carry.
#[derive(Args)]
pub struct Bridge {
    /// Name of the process in lists of processes.
    #[arg(hide = true)]
    name: Option<String>,
}

impl Bridge {
    /// Executes the subcommand.
    pub fn execute(self) -> ExitCode {
        bridge_main(|settings| Ok(Box::new(Zenoh::open(settings)?)))
    }
}

/// zenoh as the network of a run.
struct Zenoh(Arc<Host>);

impl Zenoh {
    fn open(settings: BridgeSettings) -> Result<Self, String> {
        let BridgeSettings { host, identity, incarnation, clock, arrived } = settings;
        let tls = host.tls.map(|HostTls { certificate, key, authority }| {
            Tls::load(&TlsFiles { certificate, key, authority }).map(Arc::new)
        });
        let tls = tls.transpose().map_err(|e| e.to_string())?;
        let opened = Host::open(HostSettings {
            prefix: PREFIX.to_owned(),
            name: host.name,
            endpoints: Endpoints { listen: host.listen, connect: host.connect, router: host.router, tls },
            identity: Identity {
                pipeline: identity.pipeline,
                hash: identity.hash,
                version: identity.version,
                cpu: identity.processor,
            },
            incarnation,
            clock: Arc::new(move || clock.now()),
            arrived,
        });
        opened.map(Self).map_err(|e| e.to_string())
    }
}

impl Network for Zenoh {
    fn transport(&self, edge: &str) -> Box<dyn Transport> {
        Box::new(Remote::new(&self.0, edge))
    }

    fn clock(&self, edge: &str) -> Option<ClockOffset> {
        let offset = self.0.offset_of(edge)?;
        Some(ClockOffset { offset: offset.offset, uncertainty: offset.uncertainty })
    }

    fn renewal(&self) -> Option<String> {
        self.0
            .is_outdated()
            .then(|| "a new certificate was written: the bridge begins anew with it".to_owned())
    }

    fn events(&self) -> Vec<NetworkEvent> {
        let events = self.0.events().into_iter();
        events.map(|event| NetworkEvent { is_fault: event.is_fault, text: event.text }).collect()
    }

    fn sent(&self) -> BTreeMap<String, SentCounts> {
        let counts = |sent: stillpoint_remote::Sent| SentCounts {
            offered: sent.offered,
            replaced: sent.replaced,
            unheard: sent.unheard,
            put: sent.put,
            waiting: sent.waiting,
            received: sent.received,
            refused: sent.refused,
        };
        self.0.sent().into_iter().map(|(edge, sent)| (edge, counts(sent))).collect()
    }

    fn taken(&self) -> BTreeMap<String, TakenCounts> {
        let counts = |taken: stillpoint_remote::Taken| TakenCounts {
            received: taken.received,
            refused: taken.refused,
            lost: taken.lost + taken.missing,
        };
        self.0.taken().into_iter().map(|(edge, taken)| (edge, counts(taken))).collect()
    }
}
