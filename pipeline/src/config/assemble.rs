//! The graph: everything in topological order, with processes and recording resolved.

use std::collections::{BTreeMap, BTreeSet};

use super::document::Document;
use super::faults::{Code, Findings};
use super::inputs::Topic;
use super::near::{shown, suggestion};
use super::operators::ParsedOperator;
use super::port_frames::PortFrames;
use super::processes::RESTART;
use super::record::Parsed;
use super::source::Marked;
use super::sync::Consumption;
use super::wiring::Wired;
use crate::graph::{
    AgeLimit, Edge, Graph, InputNode, OperatorNode, OutputNode, PoolNode, Priority, ProcessNode, Record,
    Ros2Node, Wire,
};
use crate::hosts::{BRIDGE, MAIN};
use crate::operator::TIMING;
use crate::params::CheckedParams;
use crate::{far_end, pool_client, settings};

/// Names of processes that every run has.
const RESERVED: [&str; 2] = ["recorder", "supervisor"];

/// Processes; members are numbers of operators by their place in the file. Operators that no process names get one
/// each.
pub fn processes(document: &Document<'_>, links_stand: bool, findings: &Findings) -> Vec<ProcessNode> {
    let numbers = document.numbers();
    let mut home: BTreeMap<usize, &str> = BTreeMap::new();
    let mut processes = Vec::new();
    for parsed in &document.processes {
        let name = parsed.name.value.as_str();
        let mut operators = Vec::new();
        for member in &parsed.operators {
            let Some(&number) = numbers.get(member.value.as_str()) else {
                // The far end of a link that is at fault is not there, and that is said already.
                let is_far_end = document
                    .operators
                    .iter()
                    .any(|o| member.value.starts_with(&format!("{}_", o.name.value)));
                if links_stand || !is_far_end {
                    unknown_operator(document, member, findings);
                }
                continue;
            };
            match home.insert(number, name) {
                Some(other) => {
                    let help = match other == name {
                        true => "name it once".to_owned(),
                        false => format!("take it out of `{other}` or of `{name}`"),
                    };
                    let message = format!("{} is in the process `{other}` already", shown(&member.value));
                    findings.say(member.span, Code::ProcessShared, message, help);
                }
                None => operators.push(number),
            }
        }
        processes.push(ProcessNode {
            name: name.to_owned(),
            operators,
            restart: parsed.restart,
            core: parsed.core.as_ref().map(|core| core.value),
            priority: parsed.priority,
            outlives: parsed.outlives,
            host: parsed.host.value.clone(),
        });
    }
    let is_pool = |o: &ParsedOperator<'_>| o.kind.as_ref().is_some_and(|k| k.value == pool_client::KIND_NAME);
    let has_bridge =
        !document.hosts.is_empty() || document.ros2.is_some() || document.operators.iter().any(is_pool);
    // Every operator that no process names has one of its own.
    let alone =
        document.operators.iter().enumerate().filter(|(n, _)| !home.contains_key(n)).map(|(_, o)| &o.name);
    for name in document.processes.iter().map(|p| &p.name).chain(alone) {
        let is_bridge = has_bridge && name.value == BRIDGE;
        if is_bridge || RESERVED.contains(&name.value.as_str()) {
            findings.say(
                name.span,
                Code::BadName,
                format!("a run has a process named {} of its own", shown(&name.value)),
                "give the process another name",
            );
        }
    }
    for parsed in &document.processes {
        let name = parsed.name.value.as_str();
        if let Some(number) = numbers.get(name)
            && !home.contains_key(number)
        {
            findings.say(
                parsed.name.span,
                Code::DuplicateName,
                format!(
                    "{} is also an operator outside this process, whose own process has that name",
                    shown(name)
                ),
                "give the process another name, or make the operator a member",
            );
        } else if let Some(number) = numbers.get(name)
            && home.get(number).is_some_and(|h| *h != name)
        {
            findings.say(
                parsed.name.span,
                Code::DuplicateName,
                format!("{} is also an operator of another process", shown(name)),
                "give the process another name",
            );
        }
    }
    for (number, operator) in document.operators.iter().enumerate() {
        if !home.contains_key(&number) {
            processes.push(ProcessNode {
                name: operator.name.value.clone(),
                operators: vec![number],
                restart: RESTART,
                core: None,
                priority: Priority::Normal,
                outlives: 0,
                host: MAIN.to_owned(),
            });
        }
    }
    processes
}

fn unknown_operator(document: &Document<'_>, name: &Marked<String>, findings: &Findings) {
    let names = document.operators.iter().map(|o| o.name.value.as_str());
    findings.say(
        name.span,
        Code::UnknownOperator,
        format!("there is no operator {}", shown(&name.value)),
        suggestion(&name.value, names, "operators", findings),
    );
}

/// What is recorded.
pub fn record(document: &Document<'_>, wired: &[Wired], findings: &Findings) -> Record {
    let topics = match &document.record {
        Parsed::Sources => return Record::Sources,
        Parsed::All => return Record::All,
        Parsed::Topics(topics) => topics,
    };
    let mut retained = BTreeSet::new();
    let mut list = Vec::new();
    for topic in topics {
        if output(document, wired, topic, findings).is_none() {
            continue;
        }
        let name = format!("{}.{}", topic.value.operator.value, topic.value.port.value);
        if !retained.insert(name.clone()) {
            findings.say(
                topic.span,
                Code::DuplicateName,
                format!("{} is listed twice", shown(&name)),
                "remove one of them",
            );
        } else {
            list.push(name);
        }
    }
    Record::Topics(list)
}

/// Operator and output of a topic that a section names.
pub fn output(
    document: &Document<'_>,
    wired: &[Wired],
    topic: &Marked<Topic>,
    findings: &Findings,
) -> Option<(usize, usize)> {
    let (operator, port) = (&topic.value.operator, &topic.value.port);
    let Some(&number) = document.numbers().get(operator.value.as_str()) else {
        unknown_operator(document, operator, findings);
        return None;
    };
    let stage = wired[number].stage.as_ref()?;
    let name = format!("{}.{}", operator.value, port.value);
    let found = stage.kind.outputs.iter().position(|o| o.name == port.value);
    if port.value == TIMING && !stage.laps.is_empty() {
        findings.say(
            topic.span,
            Code::Measured,
            format!("{} is measured, and every live session keeps it", shown(&name)),
            "remove it from the list",
        );
    } else if found.is_none() {
        findings.say(
            port.span,
            Code::UnknownTopic,
            format!("there is no topic {}: `{}` has no such output", shown(&name), operator.value),
            suggestion(&port.value, stage.kind.outputs.iter().map(|o| o.name), "outputs", findings),
        );
    }
    Some((number, found?))
}

/// The checked pipeline. `None` only where a fault was found and something is therefore missing.
#[allow(clippy::too_many_arguments)] // One argument per part of the check, each used once.
pub fn graph(
    document: Document<'_>,
    wired: Vec<Wired>,
    checked: Vec<(Option<CheckedParams>, Vec<String>)>,
    policies: Vec<Vec<Consumption>>,
    frames: PortFrames,
    order: Vec<usize>,
    mut processes: Vec<ProcessNode>,
    record: Record,
    ros2: Option<Ros2Node>,
) -> Option<Graph> {
    let mut place = vec![0; order.len()];
    for (new, old) in order.iter().enumerate() {
        *place.get_mut(*old)? = new;
    }
    let mut process_of = vec![0; order.len()];
    for (number, process) in processes.iter_mut().enumerate() {
        for member in &mut process.operators {
            *member = *place.get(*member)?;
            process_of[*member] = number;
        }
        process.operators.sort_unstable();
    }
    let mut checked: Vec<_> = checked.into_iter().map(Some).collect();
    let mut operators = Vec::with_capacity(order.len());
    for (new, old) in order.iter().enumerate() {
        let parsed = document.operators.get(*old)?;
        let stage = wired.get(*old)?.stage?;
        let (params, files) = checked.get_mut(*old)?.take()?;
        let params = params?;
        let capacities = (stage.capacities)(&params);
        let subscriptions = (stage.subscriptions)(&params);
        let listens = (stage.listens)(&params);
        let inputs =
            wired[*old].inputs.iter().zip(&policies[*old]).map(|(input, (policy, leader))| InputNode {
                edge: input.edge.map(|e| Edge { operator: place[e.operator], ..e }),
                policy: *policy,
                sync_leader: *leader,
                frame: input.edge.and_then(|e| frames.output(e.operator, e.output)).map(str::to_owned),
                max_age: input.parsed.and_then(|at| parsed.inputs.get(at)).and_then(|written| {
                    let max = written.max_age.as_ref()?.value;
                    Some(AgeLimit { max, otherwise: written.otherwise })
                }),
            });
        let outputs = stage.kind.outputs.iter().enumerate().map(|(port, output)| OutputNode {
            topic: format!("{}.{}", parsed.name.value, output.name),
            frame: frames.output(*old, port).map(str::to_owned),
            capacity: capacities.get(port).copied().unwrap_or(1),
            links: Vec::new(),
        });
        operators.push(OperatorNode {
            name: parsed.name.value.clone(),
            stage,
            params,
            files,
            every: parsed.every.as_ref().map(|e| e.value),
            latency: parsed.latency,
            deadline: parsed.deadline,
            start_within: parsed.start_within.as_ref().map(|t| t.value),
            inputs: inputs.collect(),
            outputs: outputs.collect(),
            process: process_of[new],
            far_end: parsed.link,
            wire_form: None,
            subscriptions,
            listens,
        });
    }
    let pools = find_pools(&mut operators);
    lay_out_far_ends(&mut operators);
    let mut graph = Graph {
        name: document.name,
        seed: document.seed,
        frames: document.frames,
        operators,
        processes,
        record,
        hosts: document.hosts.into_iter().map(|h| h.node).collect(),
        ros2,
        pools,
        contracts: Vec::new(),
        part: None,
    };
    settings::connect(&mut graph);
    Some(graph)
}

/// The planning pools that operators reach.
fn find_pools(operators: &mut [OperatorNode]) -> Vec<PoolNode> {
    let mut pools = Vec::new();
    for node in operators.iter_mut().filter(|node| node.stage.kind.name == pool_client::KIND_NAME) {
        if let Some(pool) = pool_client::node(&node.name, &node.params) {
            node.far_end = Some(Wire::Pool(pools.len()));
            pools.push(pool);
        }
    }
    pools
}

/// What comes from another host may be as large as what its producer sends, and datagrams have the form of their sender.
fn lay_out_far_ends(operators: &mut [OperatorNode]) {
    for far in 0..operators.len() {
        let Some(edge) = operators[far].inputs.first().and_then(|i| i.edge) else { continue };
        match operators[far].far_end {
            Some(Wire::Host(_)) => {
                let capacity = operators[edge.operator].outputs[edge.output].capacity;
                operators[far].outputs[far_end::SAMPLE].capacity = capacity;
            }
            Some(Wire::Udp(_)) => operators[far].wire_form = operators[edge.operator].stage.wire,
            Some(Wire::Ros2 | Wire::Pool(_)) | None => {}
        }
    }
}
