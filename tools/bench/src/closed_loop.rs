//! `stillpoint bench loop`: the latency of a live run from an image to the datagram that depends on it.

use std::path::Path;
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_pipeline::live::{contracts, entry_of};
use stillpoint_samples::{Entry, JournalRef, RefKind};
use stillpoint_shm::Topic;

use super::figures::Quantiles;
use super::folder::Folder;
use super::program::{self, Program};
use stillpoint::Attached;
use stillpoint::{Ended, Exit, Failure, print_json};

/// The operators downstream of the image (estimate, control, send), each with the input that the previous one feeds.
const CHAIN: [(&str, &str); 3] = [("filter", "measurement"), ("law", "state"), ("valves", "command")];
/// Interval at which journals are read. Their buffers hold the entries of many intervals.
const READ: Duration = Duration::from_millis(20);

/// Run the default pipeline live, and report from its journals the latency from the acquisition of each image to the
/// first datagram for the valves that depends on it: to the filter, to the controller, and until the datagram was sent.
/// Runs with and without recording alternate.
#[derive(Args)]
pub struct ClosedLoop {
    /// Length of a run, s.
    #[arg(long, default_value_t = 30, value_parser = super::at_least::<u64>(1))]
    seconds: u64,
    /// Number of runs with recording, and of runs without.
    #[arg(long, default_value_t = 3, value_parser = super::at_least::<usize>(1))]
    rounds: usize,
    /// A short measurement: one run of 5 s of each kind.
    #[arg(long)]
    quick: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Row {
    recorded: bool,
    /// From the acquisition of an image to the filter's activation, us.
    seen: Quantiles,
    /// From the filter's activation to the controller's, us.
    decided: Quantiles,
    /// From the controller's activation until the datagram was sent, us.
    sent: Quantiles,
    /// From the acquisition of the image until the datagram was sent, us.
    whole: Quantiles,
}

impl ClosedLoop {
    /// Runs the windows and prints their latencies. Fails if no image of a kind of window reached a datagram.
    pub fn execute(&self, registry: &Registry) -> Ended {
        let folder = Folder::create(None)?;
        let (seconds, rounds) = if self.quick { (5, 1) } else { (self.seconds, self.rounds) };
        let mut all = [Vec::new(), Vec::new()];
        for round in 0..rounds {
            for (number, recorded) in [false, true].into_iter().enumerate() {
                let place = folder.free(&format!("loop-{round}-{number}"))?;
                all[number].extend(window(&place, recorded, Duration::from_secs(seconds), registry)?);
            }
        }
        let rows: Vec<Row> = [false, true].into_iter().zip(&all).map(|(r, ways)| row(r, ways)).collect();
        if self.json {
            print_json(&rows)?
        } else {
            print(&rows)
        }
        Ok(if rows.iter().all(|r| r.whole.count > 0) { Exit::Done } else { Exit::Failed })
    }
}

/// Times of one image on its way to a datagram, ns of session time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Response {
    acquired: u64,
    filtered: u64,
    decided: u64,
    sent: u64,
}

fn window(
    place: &Path,
    recorded: bool,
    length: Duration,
    registry: &Registry,
) -> Result<Vec<Response>, Failure> {
    program::write(place, |text| text)?;
    let keep: &[&str] = if recorded { &["--record", "s"] } else { &["--no-record"] };
    let mut run = Program::start(place, keep)?;
    run.wait(registry, |_| true)?;
    let attached = run.attach(registry)?;
    let entries = read(&attached, length)?;
    run.end()?;
    let ports: Vec<usize> = CHAIN.iter().filter_map(|(o, i)| port(&attached, o, i)).collect();
    let [_, law, valves] = ports.as_slice() else {
        return Err(Failure::failed("the pipeline has another chain from the filter to the valves"));
    };
    Ok(ways(&entries, [*law as u32, *valves as u32]))
}

/// Number of an input of an operator; `None` if the graph has no such input.
fn port(attached: &Attached, operator: &str, input: &str) -> Option<usize> {
    let node = &attached.graph.operators[attached.graph.operator(operator)?];
    node.stage.kind.inputs.iter().position(|i| i.name == input)
}

/// Reads the journals of the chain for this length of time.
fn read(attached: &Attached, length: Duration) -> Result<[Vec<Entry>; 3], Failure> {
    let mut open = Vec::new();
    for (operator, _) in CHAIN {
        let number = attached.graph.operator(operator);
        let number = number.ok_or_else(|| Failure::failed(format!("the pipeline has no {operator}")))?;
        let topic = Topic::open(&attached.domain, &contracts::journal(&attached.graph, number));
        let topic = topic.map_err(Failure::failed)?;
        let subscriber = topic.subscriber(contracts::JOURNAL_DEPTH).map_err(Failure::failed)?;
        subscriber.connect().map_err(Failure::failed)?;
        open.push((subscriber, topic));
    }
    let mut entries = [const { Vec::new() }; 3];
    let begun = Instant::now();
    while begun.elapsed() < length {
        std::thread::sleep(READ);
        for ((subscriber, _), entries) in open.iter().zip(&mut entries) {
            while let Some(sample) = subscriber.receive().map_err(Failure::failed)? {
                entries.extend(entry_of(sample.pieces()));
            }
        }
    }
    Ok(entries)
}

/// Times of the images from the journals of the filter, the controller and the valves. `to_law` and `to_valves` are the
/// numbers of the inputs that the previous operator feeds. An image without a datagram is left out.
fn ways([filter, law, valves]: &[Vec<Entry>; 3], [to_law, to_valves]: [u32; 2]) -> Vec<Response> {
    let mut ways = Vec::new();
    for measured in filter {
        let Some(state) = output(measured) else { continue };
        let Some((_, decided)) = first_that_takes(law, to_law, state) else { continue };
        let Some(duties) = output(decided) else { continue };
        let Some((place, _)) = first_that_takes(valves, to_valves, duties) else { continue };
        let Some(next) = valves.get(place + 1).filter(|e| e.body.sent_before > 0) else { continue };
        ways.push(Response {
            acquired: measured.header.origin,
            filtered: measured.header.stamp,
            decided: decided.header.stamp,
            sent: next.body.sent_before,
        });
    }
    ways
}

/// The first sample on the first output of an activation.
fn output(entry: &Entry) -> Option<&JournalRef> {
    entry.refs.iter().find(|r| r.kind == RefKind::Output as u32 && r.port == 0 && r.count > 0)
}

/// Place and entry of the first activation that takes this sample or a later one on an input.
fn first_that_takes<'e>(entries: &'e [Entry], port: u32, sample: &JournalRef) -> Option<(usize, &'e Entry)> {
    entries.iter().enumerate().find(|(_, entry)| {
        entry.refs.iter().any(|r| {
            r.kind == RefKind::Fresh as u32
                && r.port == port
                && r.incarnation == sample.incarnation
                && r.first + u64::from(r.count) > sample.first
        })
    })
}

fn row(recorded: bool, ways: &[Response]) -> Row {
    let of = |time: fn(&Response) -> u64| Quantiles::of(&ways.iter().map(time).collect::<Vec<_>>());
    Row {
        recorded,
        seen: of(|w| w.filtered.saturating_sub(w.acquired)),
        decided: of(|w| w.decided.saturating_sub(w.filtered)),
        sent: of(|w| w.sent.saturating_sub(w.decided)),
        whole: of(|w| w.sent.saturating_sub(w.acquired)),
    }
}

fn print(rows: &[Row]) {
    outln!(
        "{:<10} {:>7} {:>16} {:>16} {:>16} {:>18}   median and 99th percentile, ms",
        "recording",
        "images",
        "image to filter",
        "to controller",
        "to datagram",
        "image to datagram"
    );
    for r in rows {
        let pair = |q: Quantiles| format!("{:.1}, {:.1}", q.p50 / 1e3, q.p99 / 1e3);
        outln!(
            "{:<10} {:>7} {:>16} {:>16} {:>16} {:>18}",
            if r.recorded { "yes" } else { "no" },
            r.whole.count,
            pair(r.seen),
            pair(r.decided),
            pair(r.sent),
            pair(r.whole)
        );
    }
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{Header, JournalBody};

    use super::*;

    fn reference(kind: RefKind, port: u32, first: u64) -> JournalRef {
        JournalRef { kind: kind as u32, port, first, count: 1, ..JournalRef::default() }
    }

    fn entry(origin: u64, stamp: u64, sent_before: u64, refs: Vec<JournalRef>) -> Entry {
        let body = JournalBody { sent_before, length: refs.len() as u32, ..JournalBody::default() };
        Entry { header: Header { stamp, origin, ..Header::default() }, body, refs }
    }

    #[test]
    fn a_way_is_that_of_the_first_command_and_datagram_that_know_of_the_image() {
        let (fresh, held, sent) = (RefKind::Fresh, RefKind::Held, RefKind::Output);
        let filter = vec![
            entry(100, 130, 0, vec![reference(fresh, 0, 4), reference(sent, 0, 8)]),
            // No activation of the controller takes this sample.
            entry(200, 230, 0, vec![reference(fresh, 0, 5), reference(sent, 0, 9)]),
        ];
        let law = vec![
            entry(0, 120, 0, vec![reference(held, 2, 7), reference(sent, 0, 50)]),
            entry(0, 140, 0, vec![reference(fresh, 2, 8), reference(sent, 0, 51)]),
            entry(0, 160, 0, vec![reference(held, 2, 8), reference(sent, 0, 52)]),
        ];
        let valves = vec![
            entry(0, 135, 90, vec![reference(fresh, 1, 50), reference(sent, 0, 70)]),
            entry(0, 145, 136, vec![reference(fresh, 1, 51), reference(sent, 0, 71)]),
            entry(0, 155, 147, vec![reference(fresh, 1, 52), reference(sent, 0, 72)]),
        ];
        let response = Response { acquired: 100, filtered: 130, decided: 140, sent: 147 };
        assert_eq!(ways(&[filter, law, valves], [2, 1]), [response]);
    }
}
