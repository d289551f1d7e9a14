//! The topics of a graph, and how much memory they take.

use stillpoint_samples::{
    Actuation, ConsoleCommand, Datagram, Diagnostics, FarEnd, Journal, Sample, SampleKind, Setting,
};
use stillpoint_shm::Contract;

use super::landing;
use crate::far_end;
use crate::graph::{Graph, Wire};
pub use crate::graph::{journal_topic, timing_topic};
use crate::operator::{Role, ros2};
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

/// Time for which publishers keep what replay needs, s: a flush, the death of the recorder and its restart fit into it.
const RETAINED_SECS: f64 = 2.0;
/// Activations a second of an operator without a timer before it: what comes over a wire, for one.
const UNKNOWN_RATE: f64 = 500.0;
/// The fewest and the most samples that are kept.
const RETAINED: (usize, usize) = (64, 16_384);
/// The most bytes that are kept of a topic, and of one whose rate is unknown: more than 2 s of a depth camera.
const RETAINED_BYTES: (usize, usize) = (256 << 20, 64 << 20);

/// The most samples of a topic that one activation sends with memory of its own, and the bytes of larger ones: the calls
/// and answers of a planning pool come in such numbers.
const BURST: (usize, usize) = (64, 48 << 10);

/// Samples that one activation loans before the first of them is sent. They cannot take the place of what is kept.
fn burst(kind: &SampleKind, capacity: usize) -> usize {
    let bytes = kind.meta_size() + capacity * kind.element_size;
    (BURST.1 / bytes.max(1)).clamp(1, BURST.0)
}

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
    // The bridge takes samples once, wherever they go.
    let leaves = output.links.iter().any(Wire::is_bridged);
    let bridged = if leaves { bridge_depth(kind, output.capacity) } else { 1 };
    let takers = consumers.len() + usize::from(leaves);
    let deepest =
        consumers.iter().map(|(c, p)| depth_of(graph.operators[*c].inputs[*p].policy)).max().unwrap_or(1);
    let is_retained = graph.is_recorded(operator, port) || WATCHED.contains(&kind);
    let is_settings = graph.is_settings(operator, port);
    let recorded = match is_retained {
        // Changes come from people, one at a time.
        true if is_settings || kind == Setting::KIND => SETTINGS_HELD,
        true if kind == ConsoleCommand::KIND => COMMANDS_HELD,
        true => recorder_depth(kind, output.capacity),
        false => 1,
    };
    let deepest = deepest.max(bridged);
    let buffer = deepest.max(recorded).max(TAP_DEPTH);
    // Without a history there is always a buffer that is no longer needed, and only what comes from outside comes in bursts.
    let comes_in_bursts = node.stage.kind.role == Role::Source && graph.is_recorded(operator, port);
    let burst = if comes_in_bursts { burst(kind, output.capacity) } else { 1 };
    Contract {
        buffer,
        borrowed: BORROWED,
        // The supervisor reads which changes of parameters a process took.
        subscribers: takers + TAPS + usize::from(is_settings),
        publishers: 4,
        nodes: graph.processes.len() + 2 + TAPS,
        // All buffers hold the newest samples, which are the same ones; what is borrowed may be older.
        // What an activation is about to send stands beside them.
        pool: deepest.max(recorded) + takers * (BORROWED - 1) + 2 + LOOKERS + burst,
        history: if is_settings { SETTINGS_HELD } else { 0 },
        ..Contract::new(&output.topic, kind, output.frame.as_deref(), output.capacity)
    }
}

/// Answers to changes of parameters that are kept for those who join a run later.
pub const SETTINGS_HELD: usize = 16;

/// Commands of a topic that wait for the recorder: of a person, or of a console's script, they are a few a second.
const COMMANDS_HELD: usize = 256;

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

/// Name of the topic through which people change parameters, by way of a console.
pub fn setting_inbox_topic(operator: &str) -> String {
    format!("{operator}.setting_inbox")
}

/// The contract of a console's inbox for commands.
pub fn inbox(graph: &Graph, operator: usize) -> Contract {
    inbox_of(graph, &inbox_topic(&graph.operators[operator].name), ConsoleCommand::KIND)
}

/// The contract of a console's inbox for changes of parameters.
pub fn setting_inbox(graph: &Graph, operator: usize) -> Contract {
    inbox_of(graph, &setting_inbox_topic(&graph.operators[operator].name), Setting::KIND)
}

/// The contract of the inbox of a supervisor for requests to restart an operator. Its name is that of no output.
pub fn restart_inbox(graph: &Graph) -> Contract {
    inbox_of(graph, ".restart", Setting::KIND)
}

fn inbox_of(graph: &Graph, topic: &str, kind: &SampleKind) -> Contract {
    Contract {
        buffer: 16,
        subscribers: 2,
        publishers: 8,
        nodes: graph.processes.len() + 2 + TAPS,
        pool: 20,
        ..Contract::new(topic, kind, None, 1)
    }
}

/// Samples of an edge between hosts that wait in shared memory, for a bridge or for the operator behind it: 64 small ones,
/// and fewer that take 4 MiB.
pub fn bridge_depth(kind: &SampleKind, capacity: usize) -> usize {
    waiting(kind.meta_size() + capacity * kind.element_size)
}

/// Samples that wait, of so many bytes each.
fn waiting(bytes: usize) -> usize {
    ((4 << 20) / bytes.max(1)).clamp(3, 64)
}

/// The contract of what the bridge hands to an operator whose samples come from another host or from ROS 2.
pub fn landing(graph: &Graph, operator: usize) -> Contract {
    let node = &graph.operators[operator];
    let longest = match node.subscriptions.iter().map(|s| s.longest).max() {
        Some(longest) => longest + ros2::LONGEST_COMPANIONS,
        None => {
            let kind = node.stage.kind.outputs[far_end::SAMPLE].sample;
            kind.meta_size() + node.outputs[far_end::SAMPLE].capacity * kind.element_size
        }
    };
    let depth = waiting(longest);
    let bytes = longest + landing::CLOCK_SIZE;
    Contract {
        buffer: depth,
        borrowed: BORROWED,
        subscribers: 2,
        publishers: 4,
        nodes: graph.processes.len() + 2 + TAPS,
        pool: depth + BORROWED + 3,
        ..Contract::new(&format!("{}.landing", node.name), Datagram::KIND, None, bytes)
    }
}

/// Activations a second of an operator, as far as the timers before it tell: its own, else those of all that feed it.
fn rate(graph: &Graph, operator: usize) -> Option<f64> {
    let (mut seen, mut left) = (vec![false; graph.operators.len()], vec![operator]);
    let mut rate = 0.0;
    while let Some(at) = left.pop() {
        if std::mem::replace(&mut seen[at], true) {
            continue;
        }
        let node = &graph.operators[at];
        rate += node.every.map_or(0.0, |every| 1e9 / every.max(1) as f64);
        if node.every.is_none() || at != operator {
            left.extend(node.fed().map(|(_, edge)| edge.operator));
        }
    }
    (rate > 0.0).then_some(rate)
}

/// How many samples of a topic of an operator are kept for a recorder that is started again.
fn retained(graph: &Graph, operator: usize, contract: &Contract) -> usize {
    let known = rate(graph, operator);
    let count = (RETAINED_SECS * known.unwrap_or(UNKNOWN_RATE)).ceil() as usize;
    let bytes = if known.is_some() { RETAINED_BYTES.0 } else { RETAINED_BYTES.1 };
    count.max(RETAINED.0).min(RETAINED.1).min((bytes / contract.sample_bytes().max(1)).max(1))
}

/// Every contract of a graph, and the operator whose journal or recorded topic it is.
fn listed(graph: &Graph) -> Vec<(Contract, Option<usize>)> {
    let mut contracts = Vec::new();
    for (operator, node) in graph.operators.iter().enumerate() {
        contracts.push((journal(graph, operator), Some(operator)));
        contracts.extend((0..node.outputs.len()).map(|port| {
            (output(graph, operator, port), graph.is_recorded(operator, port).then_some(operator))
        }));
        contracts.extend(timing(graph, operator).map(|contract| (contract, None)));
        if node.stage.kind.name == crate::console::KIND_NAME {
            contracts.push((inbox(graph, operator), None));
            contracts.push((setting_inbox(graph, operator), None));
        }
        if graph.arrives().any(|arrives| arrives == operator) || node.far_end == Some(Wire::Ros2) {
            contracts.push((landing(graph, operator), None));
        }
    }
    contracts.push((restart_inbox(graph), None));
    contracts
}

/// Every contract of a graph, whose publishers keep nothing.
pub fn all(graph: &Graph) -> Vec<Contract> {
    listed(graph).into_iter().map(|(contract, _)| contract).collect()
}

/// Every contract of a graph that is recorded: the publishers keep their newest samples, for which they take `room` bytes
/// more at most. Where the room does not suffice, all keep the samples of a shorter time; what fits into the buffer of
/// the recorder takes no room.
pub fn all_recorded(graph: &Graph, room: u64) -> Vec<Contract> {
    let mut contracts = listed(graph);
    for (contract, operator) in &mut contracts {
        let least = contract.history;
        contract.history = operator.map_or(0, |operator| retained(graph, operator, contract)).max(least);
    }
    let requested: u64 = contracts.iter().map(|(c, _)| (beyond(c) * c.sample_bytes()) as u64).sum();
    if requested > room {
        let share = room as f64 / requested as f64;
        for (contract, _) in &mut contracts {
            let beyond = beyond(contract);
            contract.history -= beyond - (beyond as f64 * share) as usize;
        }
    }
    contracts.into_iter().map(|(contract, _)| contract).collect()
}

/// Samples that are kept beyond those for which the publisher has memory in any case.
fn beyond(contract: &Contract) -> usize {
    contract.history.saturating_sub(contract.buffer)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::operator::files::MemoryFiles;
    use crate::operator::*;

    struct Beat;

    impl Operator for Beat {
        type Params = ();
        const KIND: Kind = Kind {
            name: "test.beat",
            about: "Does nothing.",
            role: Role::Source,
            inputs: &[],
            outputs: &[],
            timer: Timer::Required,
        };

        fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
            Ok(Self)
        }

        fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
            Ok(())
        }
    }

    struct Sender;

    impl Operator for Sender {
        type Params = ();
        const KIND: Kind = Kind {
            name: "test.sender",
            about: "Sends datagrams.",
            role: Role::Source,
            inputs: &[],
            outputs: &[Output {
                name: "out",
                sample: Datagram::KIND,
                frame: FrameRule::None,
                about: "Datagrams.",
            }],
            timer: Timer::Required,
        };

        fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
            Ok(Self)
        }

        fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
            Ok(())
        }
    }

    fn bursts() -> Graph {
        let text = "stillpoint: 1\nname: bursts\noperators:\n  a: { use: test.sender, every: 1 ms }\nrecord: { topics: all }\n";
        let registry = Registry::new(&[&[Stage::of::<Sender>()]]);
        crate::config::check(text, "bursts.yaml", &[], &registry, &MemoryFiles::default()).unwrap()
    }

    fn beats() -> Graph {
        let text = "stillpoint: 1\nname: beats\noperators:\n  a: { use: test.beat, every: 1 ms }\n  b: { use: test.beat, \
                    every: 1 s }\n  c: { use: test.beat, every: 10 us }\n";
        let registry = Registry::new(&[&[Stage::of::<Beat>()]]);
        crate::config::check(text, "beats.yaml", &[], &registry, &MemoryFiles::default()).unwrap()
    }

    fn histories(contracts: &[Contract]) -> Vec<usize> {
        contracts.iter().map(|c| c.history).collect()
    }

    fn bytes(contracts: &[Contract]) -> usize {
        contracts.iter().map(Contract::pool_bytes).sum()
    }

    #[test]
    fn an_activation_has_memory_for_its_burst_when_the_history_is_full() {
        let graph = bursts();
        for contract in all_recorded(&graph, u64::MAX).into_iter().filter(|c| c.topic == "a.out") {
            assert!(contract.history > contract.buffer, "{contract:?}");
            let free = contract.pool_bytes() / contract.sample_bytes() - contract.history;
            assert!(free >= BURST.0 + BORROWED, "{free} buffers in addition to the history");
        }
    }

    #[test]
    fn a_recorded_run_keeps_two_seconds_within_bounds_and_another_keeps_nothing() {
        let graph = beats();
        let (plain, retained) = (all(&graph), all_recorded(&graph, u64::MAX));
        assert_eq!(histories(&plain), [0; 4]);
        assert_eq!(histories(&retained), [2000, RETAINED.0, RETAINED.1, 0]);
        // A history that fits into the buffer of the recorder takes nothing more.
        let more = |i: usize| retained[i].pool_bytes() - plain[i].pool_bytes();
        assert!(more(0) > 0 && more(1) == 0 && more(2) > 10 * more(0));
    }

    #[test]
    fn a_small_shared_memory_keeps_less_and_never_less_than_fits_into_the_buffers() {
        let graph = beats();
        let plain = all(&graph);
        for room in [0, 100_000, 1 << 20, 4 << 20] {
            let retained = all_recorded(&graph, room as u64);
            let more = bytes(&retained) - bytes(&plain);
            assert!(more <= room && more as f64 > 0.9 * room as f64 - 10_000.0, "{more} of {room}");
            assert!(retained[0].history >= JOURNAL_DEPTH && retained[1].history == RETAINED.0);
        }
    }
}
