//! A pipeline in parts: the operators of one host, which run without the others.

use crate::config::near::shown;
use crate::graph::{Graph, HostedPart, OperatorNode, Priority, ProcessNode, Record, Restart, Wire};

/// The host of processes that name none.
pub const MAIN: &str = "main";
/// Name of the process that carries the samples between hosts.
pub const BRIDGE: &str = "bridge";
/// The bridge is started again after each fault, as the network's other ends may be at fault.
const BRIDGE_RESTART: Restart = Restart::OnFault { limit: u32::MAX, backoff: 100_000_000 };

/// What is wrong with an endpoint of a program with or without a certificate, and what to write instead.
pub fn endpoint_fault(text: &str, has_tls: bool) -> Option<(String, &'static str)> {
    let (scheme, rest) = text.split_once('/').unwrap_or_default();
    let stands = matches!(scheme, "tcp" | "tls") && is_address(rest);
    if !stands {
        return Some((
            format!("{} is not an endpoint", shown(text)),
            "write `tcp/ADDRESS:PORT` or, with a certificate, `tls/ADDRESS:PORT`, for example `tls/10.0.0.7:7447`; the \
             next port is used, too",
        ));
    }
    let (message, help) = match (scheme == "tls", has_tls) {
        (false, true) => {
            ("is not encrypted, although this host has a certificate", "write `tls/...`, or remove `tls`")
        }
        (true, false) => (
            "is encrypted, and this host has no certificate",
            "add `tls: { certificate: FILE, key: FILE, authority: FILE }`",
        ),
        _ => return None,
    };
    Some((format!("{} {message}", shown(text)), help))
}

/// Whether a text is `ADDRESS:PORT`, with a port that has a next one.
pub fn is_address(text: &str) -> bool {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || ".-_:[]".contains(c);
    text.rsplit_once(':').is_some_and(|(host, port)| {
        !host.is_empty()
            && host.chars().all(is_plain)
            && port.parse::<u16>().is_ok_and(|port| port != 0 && port != u16::MAX)
    })
}

/// Name of the operator that takes a topic on another host: also that of the edge.
pub fn edge_name(operator: &str, port: &str, host: &str) -> String {
    format!("{operator}_{port}_{host}")
}

impl Graph {
    /// The part that runs on a host. What comes from another host comes over a wire, and what goes there leaves by one;
    /// the check has seen to it that every edge between hosts is a link.
    pub fn part(mut self, host: &str) -> Self {
        let homes: Vec<String> = self.processes.iter().map(|p| p.host.clone()).collect();
        self.cut(|from, far| homes[from.process] != homes[far.process]);
        let stays = |process: usize| homes[process] == host;
        let operators = renumbered(self.operators.iter().map(|o| stays(o.process)));
        let processes = renumbered((0..homes.len()).map(stays));
        let elsewhere =
            self.operators.iter().filter(|o| !stays(o.process)).flat_map(|o| o.files.clone()).collect();
        self.part = Some(HostedPart { host: host.to_owned(), pipeline: self.name.clone(), files: elsewhere });
        self.operators.retain(|o| stays(o.process));
        for node in &mut self.operators {
            node.process = processes[node.process];
            for input in &mut node.inputs {
                input.edge = input.edge.map(|e| crate::graph::Edge { operator: operators[e.operator], ..e });
            }
        }
        self.processes.retain(|p| p.host == host);
        for process in &mut self.processes {
            for operator in &mut process.operators {
                *operator = operators[*operator];
            }
        }
        if let Record::Topics(topics) = &mut self.record {
            let here =
                |topic: &String| self.operators.iter().flat_map(|o| &o.outputs).any(|o| o.topic == *topic);
            topics.retain(here);
        }
        self.add_bridge();
        if host != MAIN {
            self.name = format!("{}-{host}", self.name);
        }
        self
    }

    /// Whether samples go over the network in a live run: to other hosts, to ROS 2 or to a planning pool, or come from there.
    pub fn has_bridge(&self) -> bool {
        let between_hosts = self.leaves().next().is_some() || self.arrives().next().is_some();
        between_hosts || self.publishes().next().is_some() || self.subscribes().next().is_some()
    }

    /// Adds the process of the bridge behind all others, where one is needed and not there.
    pub(crate) fn add_bridge(&mut self) {
        if !self.has_bridge() || self.processes.iter().any(|p| p.operators.is_empty()) {
            return;
        }
        self.processes.push(ProcessNode {
            name: BRIDGE.to_owned(),
            operators: Vec::new(),
            restart: BRIDGE_RESTART,
            core: None,
            priority: Priority::Normal,
            outlives: 0,
            host: self.part.as_ref().map_or_else(|| MAIN.to_owned(), |part| part.host.clone()),
        });
    }

    /// The outputs that leave over the network, with the name of the edge.
    pub fn leaves(&self) -> impl Iterator<Item = (usize, usize, String)> {
        self.operators.iter().enumerate().flat_map(move |(operator, node)| {
            node.outputs.iter().enumerate().flat_map(move |(port, output)| {
                output.links.iter().filter_map(move |wire| {
                    let name = match wire {
                        Wire::Host(host) => {
                            let host = &self.hosts.get(*host)?.name;
                            edge_name(&node.name, node.stage.kind.outputs[port].name, host)
                        }
                        Wire::Pool(pool) => self.pools.get(*pool)?.name.clone(),
                        Wire::Udp(_) | Wire::Ros2 => return None,
                    };
                    Some((operator, port, name))
                })
            })
        })
    }

    /// The operators whose samples come over the network.
    pub fn arrives(&self) -> impl Iterator<Item = usize> {
        let is_cut = |n: &OperatorNode| {
            matches!(n.far_end, Some(Wire::Host(_) | Wire::Pool(_)))
                && n.inputs.iter().all(|i| i.edge.is_none())
        };
        (0..self.operators.len()).filter(move |o| is_cut(&self.operators[*o]))
    }
}

/// The new number of each operator that stays; the number of the others is not used.
fn renumbered(stays: impl Iterator<Item = bool>) -> Vec<usize> {
    stays
        .scan(0, |next, stays| {
            let number = *next;
            *next += usize::from(stays);
            Some(number)
        })
        .collect()
}
