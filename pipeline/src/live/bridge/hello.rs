//! The first message to the bridge. The bridge knows no kinds of operators, so it cannot check the pipeline itself: the
//! supervisor tells it each edge with its topics.

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use stillpoint_operator::files::{DiskFiles, FilePlace, Files};
use stillpoint_samples::{SampleKind, Shape};
use stillpoint_shm::Contract;
use stillpoint_transport::Channel;

use super::ros2::{PublicationDef, Ros2Def, SubscriptionDef};
use crate::clock::SessionClock;
use crate::far_end;
use crate::graph::{Graph, HostNode, HostTls, PoolNode};
use crate::live::contracts;
use crate::run_source::RunSource;
use crate::session::hex;

/// What a host runs. Two hosts exchange samples only if all of it is equal.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BridgeIdentity {
    /// Name of the pipeline.
    pub pipeline: String,
    /// Hash of the pipeline's text, settings and files.
    pub hash: String,
    /// Version of the program.
    pub version: String,
    /// Architecture of the processor.
    pub processor: String,
}

/// The first message to the bridge.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HelloBridge {
    /// Root folder of the domain.
    pub root: PathBuf,
    /// Prefix of the domain.
    pub prefix: String,
    /// The session's clock.
    pub clock: SessionClock,
    /// This host, where the pipeline runs on several.
    pub host: Option<HostNode>,
    /// The planning pools that operators reach.
    pub pools: Vec<PoolNode>,
    /// How the run takes part in ROS 2, where it does.
    pub ros2: Option<Ros2Def>,
    /// What it runs.
    pub identity: BridgeIdentity,
    /// Cores of real-time processes: the bridge keeps away from them.
    pub real_time_cores: Vec<usize>,
    /// The topics that leave.
    pub leaves: Vec<Leaving>,
    /// The edges that arrive.
    pub arrives: Vec<Arriving>,
}

/// A topic that leaves for other hosts or for ROS 2.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Leaving {
    /// Number of the operator that sends it.
    pub operator: usize,
    /// Number of the output.
    pub port: usize,
    /// The edges over which it leaves: one for each host or pool.
    pub edges: Vec<String>,
    /// What is published of it.
    pub publications: Vec<PublicationDef>,
    /// Its topic.
    #[serde(with = "ContractDef")]
    pub contract: Contract,
    /// Its samples.
    pub channel: ChannelDef,
    /// Samples that wait for the bridge.
    pub depth: usize,
}

/// An edge that arrives over the network, or what arrives from ROS 2.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Arriving {
    /// Number of the operator that takes its samples.
    pub operator: usize,
    /// The edge; of what comes from ROS 2, name of the operator.
    pub edge: String,
    /// Where the bridge hands over its samples.
    #[serde(with = "ContractDef")]
    pub landing: Contract,
    /// Where it comes from.
    pub from: ArrivesFrom,
}

/// Where something arrives from.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum ArrivesFrom {
    /// Another host: samples.
    Host(ChannelDef),
    /// ROS 2: messages of these topics.
    Ros2(Vec<SubscriptionDef>),
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Contract")]
struct ContractDef {
    topic: String,
    type_name: String,
    meta_size: usize,
    element_size: usize,
    element_align: usize,
    #[serde(with = "ShapeDef")]
    shape: Shape,
    capacity: usize,
    buffer: usize,
    borrowed: usize,
    subscribers: usize,
    publishers: usize,
    nodes: usize,
    pool: usize,
    history: usize,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Shape")]
enum ShapeDef {
    Fixed,
    Slice,
}

/// What goes over an edge: all that a transport needs to know of a type of sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ChannelDef {
    name: String,
    #[serde(with = "ShapeDef")]
    shape: Shape,
    body_size: usize,
    element_size: usize,
    element_align: usize,
    hash: u64,
    frame: Option<String>,
    capacity: usize,
}

impl ChannelDef {
    fn of(graph: &Graph, operator: usize, port: usize) -> Self {
        let node = &graph.operators[operator];
        let (kind, output) = (node.stage.kind.outputs[port].sample, &node.outputs[port]);
        Self {
            name: kind.name.to_owned(),
            shape: kind.shape,
            body_size: kind.body_size,
            element_size: kind.element_size,
            element_align: kind.element_align,
            hash: kind.hash,
            frame: output.frame.clone(),
            capacity: output.capacity,
        }
    }

    /// The channel. Its type of sample lives as long as the program, as all types do, and has sizes but no fields.
    pub fn channel(&self) -> Channel {
        let kind = Box::leak(Box::new(SampleKind {
            name: Box::leak(self.name.clone().into_boxed_str()),
            about: "",
            shape: self.shape,
            body: &[],
            element: &[],
            bare: None,
            body_size: self.body_size,
            element_size: self.element_size,
            element_align: self.element_align,
            hash: self.hash,
        }));
        Channel { kind, frame: self.frame.clone(), capacity: self.capacity }
    }
}

impl HelloBridge {
    /// What the bridge needs to know; `None` where there is nothing for it to carry.
    pub fn of(
        graph: &Graph,
        identity: BridgeIdentity,
        root: PathBuf,
        prefix: String,
        clock: SessionClock,
    ) -> Option<Self> {
        let part = graph.part.as_ref();
        let host = part.and_then(|part| graph.hosts.iter().find(|h| h.name == part.host)).cloned();
        let is_here = |pool: &&PoolNode| graph.operator(&pool.name).is_some();
        let pools: Vec<PoolNode> = graph.pools.iter().filter(is_here).cloned().collect();
        let ros2 = Ros2Def::of(graph);
        if host.is_none() && pools.is_empty() && ros2.is_none() {
            return None;
        }
        let mut leaves: Vec<Leaving> = Vec::new();
        for (operator, port, edge) in graph.leaves() {
            leaving(&mut leaves, graph, operator, port).edges.push(edge);
        }
        for (operator, port, publication) in graph.publishes() {
            let publications = &mut leaving(&mut leaves, graph, operator, port).publications;
            publications.push(PublicationDef::of(publication));
        }
        let arriving = |operator: usize, from: ArrivesFrom| Arriving {
            operator,
            edge: graph.operators[operator].name.clone(),
            landing: contracts::landing(graph, operator),
            from,
        };
        let from_hosts = graph
            .arrives()
            .map(|o| arriving(o, ArrivesFrom::Host(ChannelDef::of(graph, o, far_end::SAMPLE))));
        let from_ros2 = graph.subscribes().map(|o| {
            let taken = graph.operators[o].subscriptions.iter().map(SubscriptionDef::of);
            arriving(o, ArrivesFrom::Ros2(taken.collect()))
        });
        let arrives = from_hosts.chain(from_ros2);
        let fifo = graph.processes.iter().filter(|p| p.priority.level().is_some());
        let real_time_cores: BTreeSet<usize> = fifo.filter_map(|p| p.core).collect();
        Some(Self {
            arrives: arrives.collect(),
            leaves,
            root,
            prefix,
            clock,
            host,
            pools,
            ros2,
            identity,
            real_time_cores: real_time_cores.into_iter().collect(),
        })
    }
}

/// The entry of an output among those that leave.
fn leaving<'l>(leaves: &'l mut Vec<Leaving>, graph: &Graph, operator: usize, port: usize) -> &'l mut Leaving {
    let known = leaves.iter().position(|l| (l.operator, l.port) == (operator, port));
    let place = known.unwrap_or_else(|| {
        let contract = contracts::output(graph, operator, port);
        let kind = graph.operators[operator].stage.kind.outputs[port].sample;
        leaves.push(Leaving {
            operator,
            port,
            edges: Vec::new(),
            publications: Vec::new(),
            depth: contracts::bridge_depth(kind, contract.capacity),
            contract,
            channel: ChannelDef::of(graph, operator, port),
        });
        leaves.len() - 1
    });
    &mut leaves[place]
}

impl HelloBridge {
    /// The same with the files of the certificate where they are on disk: beside the pipeline.
    #[must_use]
    pub fn with_files_of(mut self, files: &DiskFiles) -> Self {
        let of_host = self.host.iter_mut().filter_map(|host| host.tls.as_mut());
        let of_pools = self.pools.iter_mut().filter_map(|pool| pool.tls.as_mut());
        for HostTls { certificate, key, authority } in of_host.chain(of_pools) {
            for file in [certificate, key, authority] {
                if let FilePlace::Disk(place) = files.place(&file.to_string_lossy()) {
                    *file = place;
                }
            }
        }
        self
    }
}

/// What a host runs that runs a part of this graph. Files that cannot be read count as missing.
pub fn identity_of(graph: &Graph, source: &RunSource) -> BridgeIdentity {
    let mut hash = Sha256::new();
    let mut add = |bytes: &[u8]| {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    add(source.text.as_bytes());
    // Each host runs another part of the same pipeline.
    source.sets.iter().filter(|set| !set.starts_with("host=")).for_each(|set| add(set.as_bytes()));
    let names = graph.files().flat_map(|name| source.files.list(name).unwrap_or_default());
    for name in names.collect::<BTreeSet<_>>() {
        add(name.as_bytes());
        add(&source.files.read(&name).unwrap_or_default());
    }
    BridgeIdentity {
        pipeline: graph.part.as_ref().map_or_else(|| graph.name.clone(), |part| part.pipeline.clone()),
        hash: hex(&hash.finalize()),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        processor: std::env::consts::ARCH.to_owned(),
    }
}
