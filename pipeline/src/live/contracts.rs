//! The topics of a graph, and how much memory they take.

use stillpoint_samples::{Actuation, ConsoleCommand, Diagnostics, FarEnd, Journal, Sample, SampleKind};
use stillpoint_shm::Contract;

use crate::graph::Graph;
pub use crate::graph::{journal_topic, timing_topic};
use crate::schedule::depth_of;

/// Subscribers beyond those of the graph: recorder, supervisor, and people who look in.
const TAPS: usize = 6;
/// Samples that those who look in may hold between them before the edges of the graph are short of memory: each copies
/// what it sees at once.
const LOOKERS: usize = 1;
/// Samples that a consumer holds at a time: the one that waits, the one in work or held, and one more on its way.
const BORROWED: usize = 3;
/// Entries that wait for the recorder: enough for 10 ms at 100,000 activations a second.
pub const JOURNAL_DEPTH: usize = 1024;
/// Bytes of a topic that may wait for the recorder: at 200 MB/s enough for 40 ms in which it gets no core.
const RECORDER_BYTES: usize = 8 << 20;

/// How many samples of a topic wait for the recorder.
pub fn recorder_depth(kind: &SampleKind, capacity: usize) -> usize {
    let bytes = kind.meta_size() + capacity * kind.element_size;
    (RECORDER_BYTES / bytes.max(1)).clamp(4, 1024)
}

/// The contract of an output.
pub fn output(graph: &Graph, operator: usize, port: usize) -> Contract {
    let node = &graph.operators[operator];
    let output = &node.outputs[port];
    let kind = node.stage.kind.outputs[port].sample;
    let consumers: Vec<_> = graph.consumers(operator, port).collect();
    let deepest =
        consumers.iter().map(|(c, p)| depth_of(graph.operators[*c].inputs[*p].policy)).max().unwrap_or(1);
    let is_kept = graph.is_recorded(operator, port) || WATCHED.contains(&kind);
    let recorded = if is_kept { recorder_depth(kind, output.capacity) } else { 1 };
    let buffer = deepest.max(recorded).max(TAP_DEPTH);
    Contract {
        buffer,
        borrowed: BORROWED,
        subscribers: consumers.len() + TAPS,
        publishers: 4,
        nodes: graph.processes.len() + 2 + TAPS,
        // All buffers hold the newest samples, which are the same ones; what is borrowed may be older.
        pool: deepest.max(recorded) + consumers.len() * (BORROWED - 1) + 3 + LOOKERS,
        ..Contract::new(&output.topic, kind, output.frame.as_deref(), output.capacity)
    }
}

/// States of valves, of which the end of every run names each vent and fault: their samples wait for the supervisor, also
/// where nothing is recorded.
const WATCHED: [&SampleKind; 2] = [Actuation::KIND, FarEnd::KIND];

/// The deepest buffer of somebody who looks in.
pub const TAP_DEPTH: usize = 2;

/// The contract of a journal.
pub fn journal(graph: &Graph, operator: usize) -> Contract {
    let node = &graph.operators[operator];
    let capacity = node.inputs.len() + node.outputs.len();
    Contract {
        buffer: JOURNAL_DEPTH,
        borrowed: BORROWED,
        subscribers: TAPS,
        publishers: 4,
        nodes: graph.processes.len() + 2 + TAPS,
        pool: JOURNAL_DEPTH + 8,
        ..Contract::new(&journal_topic(&node.name), Journal::KIND, None, capacity)
    }
}

/// The contract of an operator's laps; `None` where its kind has none.
pub fn timing(graph: &Graph, operator: usize) -> Option<Contract> {
    let node = &graph.operators[operator];
    let laps = node.stage.laps.len();
    let buffer = recorder_depth(Diagnostics::KIND, laps);
    (laps > 0).then(|| Contract {
        buffer,
        borrowed: BORROWED,
        subscribers: TAPS,
        publishers: 4,
        nodes: graph.processes.len() + 2 + TAPS,
        pool: buffer + 3 + LOOKERS,
        ..Contract::new(&timing_topic(&node.name), Diagnostics::KIND, None, laps)
    })
}

/// Name of the topic through which people reach a console.
pub fn inbox_topic(operator: &str) -> String {
    format!("{operator}.inbox")
}

/// The contract of a console's inbox.
pub fn inbox(graph: &Graph, operator: usize) -> Contract {
    Contract {
        buffer: 16,
        subscribers: 2,
        publishers: 8,
        nodes: graph.processes.len() + 2 + TAPS,
        pool: 20,
        ..Contract::new(&inbox_topic(&graph.operators[operator].name), ConsoleCommand::KIND, None, 1)
    }
}

/// Every contract of a graph.
pub fn all(graph: &Graph) -> Vec<Contract> {
    let mut contracts = Vec::new();
    for (operator, node) in graph.operators.iter().enumerate() {
        contracts.push(journal(graph, operator));
        contracts.extend((0..node.outputs.len()).map(|port| output(graph, operator, port)));
        contracts.extend(timing(graph, operator));
        if node.stage.kind.name == crate::console::KIND_NAME {
            contracts.push(inbox(graph, operator));
        }
    }
    contracts
}
