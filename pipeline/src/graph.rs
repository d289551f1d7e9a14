//! The checked pipeline. It can only be made by checking, and only it can run.

use std::net::SocketAddr;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use stillpoint_recorder::RosMessage;

use crate::frames::Frames;
use crate::operator::ros2::Subscription;
use crate::operator::{Listening, Policy, Stage, TIMING, WireForm};
use crate::params::CheckedParams;

/// A checked pipeline.
#[derive(Clone)]
pub struct Graph {
    /// Name of the pipeline.
    pub name: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The frames.
    pub frames: Frames,
    /// The operators, upstream before downstream; edges with a delay do not count. Ties stand in the order of the file.
    pub operators: Vec<OperatorNode>,
    /// The processes. Each operator is in exactly one; members stand upstream before downstream.
    pub processes: Vec<ProcessNode>,
    /// What a recording keeps besides the journal.
    pub record: Record,
    /// The hosts that exchange samples over the network.
    pub hosts: Vec<HostNode>,
    /// How the pipeline takes part in ROS 2, if it does.
    pub ros2: Option<Ros2Node>,
    /// The planning pools that operators of this pipeline reach over the network.
    pub pools: Vec<PoolNode>,
    /// Bounds of the time of paths.
    pub contracts: Vec<PathContract>,
    /// Which part of a pipeline this is; `None`: all of it.
    pub part: Option<HostedPart>,
}

/// A bound of the time that samples take from one topic to another.
#[derive(Clone, Debug, PartialEq)]
pub struct PathContract {
    /// The topic at the start.
    pub from: String,
    /// The topic at the end.
    pub to: String,
    /// From the acquisition at the start to the sending at the end, ns.
    pub within: u64,
    /// The share of samples that keep the bound: above 0, up to 1.
    pub share: f64,
    /// A run that breaks it ends with a failure.
    pub is_fault: bool,
}

/// How old a sample of an input may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AgeLimit {
    /// From its acquisition to the activation, ns.
    pub max: u64,
    /// What the operator does about an older one.
    pub otherwise: LateInput,
}

/// What an operator does about a sample that is too old. It is decided from the stamps of the activation, so it replays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LateInput {
    /// It takes the sample as any other; the sample is counted.
    Count,
    /// It does not see the sample.
    Skip,
    /// It does nothing in this activation, and sends nothing.
    Hold,
    /// The activation fails.
    Fault,
}

/// A part of a pipeline: what one host runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HostedPart {
    /// The host.
    pub host: String,
    /// Name of the whole pipeline.
    pub pipeline: String,
    /// Files and folders that params of operators on other hosts name: the check of the whole reads them, too.
    pub files: Vec<String>,
}

/// An operator of a checked pipeline.
#[derive(Clone)]
pub struct OperatorNode {
    /// Name in the pipeline.
    pub name: String,
    /// Its kind.
    pub stage: Stage,
    /// Its parameters.
    pub params: CheckedParams,
    /// Period of its timer, ns.
    pub every: Option<u64>,
    /// Time that the simulated executor charges for a step, ns.
    pub latency: u64,
    /// Longest step, ns, after which the process is ended.
    pub deadline: Option<u64>,
    /// Longest time from a tick of its timer to the activation, ns.
    pub start_within: Option<u64>,
    /// Inputs, in the order of the kind's ports.
    pub inputs: Vec<InputNode>,
    /// Outputs, in the order of the kind's ports.
    pub outputs: Vec<OutputNode>,
    /// Number of its process.
    pub process: usize,
    /// What it is the far end of in a live run, if it is that of a link.
    pub far_end: Option<Wire>,
    /// The form of the datagrams that come over that link, where its sender gives them one.
    pub wire_form: Option<WireForm>,
    /// The topics of ROS 2 that it takes in a live run.
    pub subscriptions: Vec<Subscription>,
    /// Where it listens for another program in a live run.
    pub listens: Option<Listening>,
    /// Files and folders that its params name, relative to the pipeline's file.
    pub files: Vec<String>,
}

/// An input of a checked pipeline.
#[derive(Clone, Debug)]
pub struct InputNode {
    /// Where its samples come from; `None` where an optional input is not connected.
    pub edge: Option<Edge>,
    /// How they are consumed.
    pub policy: Policy,
    /// For `Sync`: the first input of the set (its own number where it is the first).
    pub sync_leader: Option<usize>,
    /// Frame of the samples.
    pub frame: Option<String>,
    /// How old its samples may be.
    pub max_age: Option<AgeLimit>,
}

/// An edge, seen from its consumer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Number of the producing operator.
    pub operator: usize,
    /// Number of its output.
    pub output: usize,
    /// A sample is seen this long after its stamp, ns.
    pub delay: u64,
}

/// An output of a checked pipeline.
#[derive(Clone, Debug)]
pub struct OutputNode {
    /// `operator.port`.
    pub topic: String,
    /// Frame of the samples.
    pub frame: Option<String>,
    /// The most elements in a sample.
    pub capacity: usize,
    /// What its samples leave by. Only a live graph has any: see [`Graph::live`].
    pub links: Vec<Wire>,
}

/// What a link's samples go over in a live run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// A datagram each; the far end listens.
    Udp(SocketAddr),
    /// An edge between hosts, carried by the bridge of each: the number of the host that takes the samples.
    Host(usize),
    /// Messages of ROS 2, carried by the bridge.
    Ros2,
    /// Messages to a planning pool and back, carried by the bridge: the number of the pool.
    Pool(usize),
}

impl Wire {
    /// Whether the bridge carries it.
    pub fn is_bridged(&self) -> bool {
        matches!(self, Self::Host(_) | Self::Ros2 | Self::Pool(_))
    }
}

/// How a pipeline takes part in ROS 2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ros2Node {
    /// Endpoint of the router.
    pub connect: String,
    /// The domain.
    pub domain: u32,
    /// What is published, by all hosts.
    pub publications: Vec<Publication>,
}

/// Messages of ROS 2 of a topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Publication {
    /// The topic of the pipeline.
    pub of: String,
    /// The topic of ROS 2.
    pub topic: String,
    /// What is sent of each sample.
    pub message: RosMessage,
    /// The frame that a pose places, where it places one.
    pub child: String,
}

/// A planning pool.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoolNode {
    /// Name of the operator through which it is reached.
    pub name: String,
    /// Endpoint of a router or of a listening worker.
    pub connect: String,
    /// The files of a certificate; with them, the endpoint is `tls/...`.
    pub tls: Option<HostTls>,
}

/// A host that others reach over the network.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostNode {
    /// Its name.
    pub name: String,
    /// Endpoints at which others reach it.
    pub listen: Vec<String>,
    /// Endpoints of others.
    pub connect: Vec<String>,
    /// Endpoints of a router, through which it reaches the others.
    pub router: Vec<String>,
    /// The files of its certificate; with them, all its endpoints are `tls/...`.
    pub tls: Option<HostTls>,
}

/// The files by which a host shows what it is. Their names are known to every host, their content to none but its own.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostTls {
    /// Certificate, PEM.
    pub certificate: PathBuf,
    /// Key of the certificate, PEM.
    pub key: PathBuf,
    /// Certificate of the authority that signs the certificates of all hosts, PEM.
    pub authority: PathBuf,
}

/// What happens when a process ends without being asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Restart {
    /// The run ends.
    Never,
    /// It is started again, at most this often in a row.
    OnFault {
        /// Most restarts in a row.
        limit: u32,
        /// Wait before the first restart, ns; it doubles each time.
        backoff: u64,
    },
}

/// Scheduling class of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Priority {
    /// As the system does by default.
    Normal,
    /// SCHED_FIFO with this priority; memory is locked.
    Fifo(u8),
    /// The same where the machine allows it, else as the system does by default, which is said.
    FifoIfAllowed(u8),
}

impl Priority {
    /// The level of SCHED_FIFO that is asked for.
    #[must_use]
    pub fn level(self) -> Option<u8> {
        match self {
            Self::Normal => None,
            Self::Fifo(level) | Self::FifoIfAllowed(level) => Some(level),
        }
    }

    /// What a run has whose machine allows all: `normal`, or `fifo N`.
    #[must_use]
    pub fn full(self) -> String {
        self.level().map_or_else(|| "normal".to_owned(), |level| format!("fifo {level}"))
    }
}

/// A process of a checked pipeline.
#[derive(Clone, Debug)]
pub struct ProcessNode {
    /// Name: that of the group, or of the one operator.
    pub name: String,
    /// Numbers of its operators, upstream first.
    pub operators: Vec<usize>,
    /// Restart policy.
    pub restart: Restart,
    /// Core that it is bound to.
    pub core: Option<usize>,
    /// Scheduling class.
    pub priority: Priority,
    /// Time for which it runs after its supervisor died, ns: the hardware that it drives can end safely.
    pub outlives: u64,
    /// The host that it runs on where the pipeline is run in parts: see [`Graph::part`].
    pub host: String,
}

/// What a recording keeps besides the journal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Record {
    /// The outputs of sources, which replay cannot make.
    Sources,
    /// Every topic.
    All,
    /// The outputs of sources and these topics.
    Topics(Vec<String>),
}

impl OperatorNode {
    /// The inputs that are connected, with their edges; without that of changes of parameters, which the steps do not see.
    pub fn fed(&self) -> impl Iterator<Item = (usize, Edge)> {
        let set = self.stage.set_input();
        self.inputs.iter().enumerate().filter_map(move |(port, input)| {
            input.edge.filter(|_| set != Some(port)).map(|edge| (port, edge))
        })
    }
}

impl Graph {
    /// The graph of a live run: the edges into the far ends of links are cut, and their producers send over wires
    /// instead. An edge between hosts stays an edge where both of its ends are in this graph.
    pub fn live(mut self) -> Self {
        self.cut(|_, far| !matches!(far.far_end, Some(Wire::Host(_))));
        self.open_to_ros2();
        self.add_bridge();
        self
    }

    /// Cuts the edges into far ends for which `which` holds, of producer and far end.
    pub(crate) fn cut(&mut self, which: impl Fn(&OperatorNode, &OperatorNode) -> bool) {
        for far in 0..self.operators.len() {
            let Some(wire) = self.operators[far].far_end else { continue };
            for input in 0..self.operators[far].inputs.len() {
                let Some(edge) = self.operators[far].inputs[input].edge else { continue };
                if which(&self.operators[edge.operator], &self.operators[far]) {
                    self.operators[far].inputs[input].edge = None;
                    self.operators[edge.operator].outputs[edge.output].links.push(wire);
                }
            }
        }
    }

    /// Files and folders that params name, those of other hosts included.
    pub fn files(&self) -> impl Iterator<Item = &String> {
        let elsewhere = self.part.iter().flat_map(|part| &part.files);
        self.operators.iter().flat_map(|o| &o.files).chain(elsewhere)
    }

    /// How long something of this run may go on after its supervisor died, ns.
    pub fn outlives(&self) -> u64 {
        self.processes.iter().map(|p| p.outlives).max().unwrap_or(0)
    }

    /// Number of the operator of this name.
    pub fn operator(&self, name: &str) -> Option<usize> {
        self.operators.iter().position(|o| o.name == name)
    }

    /// Operator and output of a topic `operator.port`.
    pub fn topic(&self, topic: &str) -> Option<(usize, usize)> {
        self.operators
            .iter()
            .enumerate()
            .find_map(|(i, o)| o.outputs.iter().position(|p| p.topic == topic).map(|p| (i, p)))
    }

    /// Inputs that an output feeds, as (operator, input).
    pub fn consumers(&self, operator: usize, output: usize) -> impl Iterator<Item = (usize, usize)> {
        self.operators.iter().enumerate().flat_map(move |(i, o)| {
            o.inputs.iter().enumerate().filter_map(move |(p, input)| {
                input.edge.is_some_and(|e| e.operator == operator && e.output == output).then_some((i, p))
            })
        })
    }

    /// Whether this output answers changes of parameters.
    pub fn is_settings(&self, operator: usize, output: usize) -> bool {
        self.operators[operator].stage.settings_output() == Some(output)
    }

    /// Whether a recording keeps this output.
    pub fn is_recorded(&self, operator: usize, output: usize) -> bool {
        let node = &self.operators[operator];
        let source = node.stage.kind.role == crate::operator::Role::Source;
        // What was changed while the run went on is a part of every session.
        source
            || node.stage.settings_output() == Some(output)
            || match &self.record {
                Record::Sources => false,
                Record::All => true,
                Record::Topics(list) => list.contains(&node.outputs[output].topic),
            }
    }
}

/// Name of an operator's journal topic.
pub fn journal_topic(operator: &str) -> String {
    format!("{operator}.journal")
}

/// Name of the topic on which an operator answers changes of its parameters.
pub fn settings_topic(operator: &str) -> String {
    format!("{operator}.{}", crate::operator::SETTINGS.name)
}

/// Name of the topic of an operator's laps.
pub fn timing_topic(operator: &str) -> String {
    format!("{operator}.{TIMING}")
}
