//! The journals of all operators, with the times at which outputs were sent.

use std::collections::{BTreeMap, BTreeSet};

use stillpoint_operator::Role;
use stillpoint_pipeline::graph::Graph;
use stillpoint_pipeline::session::RUN;
use stillpoint_recorder::{Role as TopicRole, Session};
use stillpoint_samples::{Cause, Diagnostics, Entry, Pieces, RefKind, Sample};

use crate::statistics::Spread;
use crate::wiring::{Stage, Wiring, is_activation};

/// The laps of activations by operator and stamp: name and time, ns, in the order of the step.
pub type Laps = BTreeMap<String, BTreeMap<u64, Vec<(String, u64)>>>;

/// Samples by incarnation and first sequence, with how many follow each other, and the entry that has them.
type Index = BTreeMap<(u32, u64), (u32, usize)>;

/// The journals of all operators, upstream first.
pub struct Journals<'e> {
    /// The operators.
    pub operators: Vec<Operator<'e>>,
    /// The laps that were measured.
    pub laps: Laps,
    /// When operators of a process were at work, ns, by process, in order.
    busy: BTreeMap<String, Vec<(u64, u64)>>,
}

/// An operator with its journal.
pub struct Operator<'e> {
    /// Its name and its topics.
    pub stage: Stage,
    /// What it did, by incarnation, in order.
    pub entries: &'e [Entry],
    /// Its process; its name where the process is not known.
    pub process: String,
    /// Its samples come from outside: they begin paths.
    pub is_source: bool,
    /// Its samples carry an acquisition of their own, such as the images of a simulated camera.
    pub acquires: bool,
    /// By input: the delay of the edge, ns.
    pub delays: Vec<u64>,
    /// By output: its samples leave the run, over a link.
    pub links: Vec<bool>,
    sent: Vec<Option<u64>>,
    taken: Vec<Index>,
    made: Vec<Index>,
}

/// The graph as a session ran it: the edges of links are cut in a live run.
pub fn as_run(graph: &Graph, session: &Session) -> Graph {
    let is_directed =
        session.metadata().get(RUN).and_then(|r| r.get("directed")).is_some_and(|d| d == "true");
    if is_directed { graph.clone() } else { graph.clone().live() }
}

impl<'e> Journals<'e> {
    /// Of a session. The graph, as the session ran it, names processes, delays and links, where it is known.
    pub fn of_session(session: &'e Session, graph: Option<&Graph>) -> Self {
        let wiring = Wiring::of(session);
        let sources: BTreeSet<&str> = session
            .topics()
            .iter()
            .filter(|t| t.role == TopicRole::Source)
            .map(|t| t.operator.as_str())
            .collect();
        let entries = |stage: &Stage| session.journals().get(&stage.name).map_or(&[][..], Vec::as_slice);
        let all = wiring.stages().iter().map(|s| (s.clone(), entries(s), sources.contains(s.name.as_str())));
        Self::new(all.collect(), graph)
    }

    /// Of a running pipeline: the entries of each operator, in the order of the graph.
    pub fn of_run(graph: &Graph, entries: &'e [Vec<Entry>]) -> Self {
        let wiring = Wiring::of_graph(graph);
        let stages = wiring.stages().iter().zip(entries).zip(&graph.operators);
        let all = stages.map(|((stage, entries), node)| {
            (stage.clone(), entries.as_slice(), node.stage.kind.role == Role::Source)
        });
        Self::new(all.collect(), Some(graph))
    }

    /// The same with laps.
    #[must_use]
    pub fn with_laps(self, laps: Laps) -> Self {
        Self { laps, ..self }
    }

    pub(super) fn new(stages: Vec<(Stage, &'e [Entry], bool)>, graph: Option<&Graph>) -> Self {
        let operators: Vec<Operator<'e>> = stages
            .into_iter()
            .map(|(stage, entries, is_source)| {
                let node = graph.and_then(|g| Some((g, &g.operators[g.operator(&stage.name)?])));
                let latency = node.map_or(0, |(_, n)| n.latency);
                let delays =
                    node.map(|(_, n)| n.inputs.iter().map(|i| i.edge.map_or(0, |e| e.delay)).collect());
                let links = node.map(|(g, n)| {
                    let leaves = |port: usize| {
                        let number = g.operator(&n.name).unwrap_or(usize::MAX);
                        g.consumers(number, port).any(|(c, _)| g.operators[c].far_end.is_some())
                    };
                    (0..n.outputs.len()).map(|p| !n.outputs[p].links.is_empty() || leaves(p)).collect()
                });
                let sent = sent_times(entries, latency);
                let taken = index(entries, stage.inputs.len(), RefKind::Fresh);
                let made = index(entries, stage.outputs.len(), RefKind::Output);
                Operator {
                    process: node.map_or_else(
                        || stage.name.clone(),
                        |(g, n)| g.processes.get(n.process).map_or(n.name.clone(), |p| p.name.clone()),
                    ),
                    delays: delays.unwrap_or_else(|| vec![0; stage.inputs.len()]),
                    links: links.unwrap_or_else(|| vec![false; stage.outputs.len()]),
                    is_source: is_source || stage.inputs.iter().all(String::is_empty),
                    acquires: false,
                    stage,
                    entries,
                    sent,
                    taken,
                    made,
                }
            })
            .collect();
        let mut journals = Self { operators, laps: Laps::new(), busy: BTreeMap::new() };
        for operator in 0..journals.operators.len() {
            journals.operators[operator].acquires = journals.does_acquire(operator);
        }
        for operator in &journals.operators {
            let steps = operator.entries.iter().zip(&operator.sent);
            let steps = steps.filter_map(|(e, sent)| Some((e.header.stamp, (*sent)?)));
            journals.busy.entry(operator.process.clone()).or_default().extend(steps);
        }
        journals.busy.values_mut().for_each(|steps| steps.sort_unstable());
        journals
    }

    /// Whether most samples of an operator are newer than all that it had consumed: it acquires by itself.
    fn does_acquire(&self, operator: usize) -> bool {
        let node = &self.operators[operator];
        let (mut own, mut all, mut newest, mut life) = (0, 0, 0, None);
        for entry in node.entries {
            if life.replace(entry.header.incarnation) != Some(entry.header.incarnation) {
                newest = 0;
            }
            let mut consumed = false;
            for r in entry.refs_of(RefKind::Fresh).chain(entry.refs_of(RefKind::Held)).filter(|r| r.count > 0)
            {
                let origin = self.producer(operator, r.port as usize).and_then(|(producer, output)| {
                    let of = &self.operators[producer];
                    Some(of.entries[of.maker(output, r.incarnation, r.first)?].header.origin)
                });
                consumed |= origin.is_some();
                newest = newest.max(origin.unwrap_or(0));
            }
            if consumed && entry.refs_of(RefKind::Output).any(|r| r.count > 0) {
                all += 1;
                own += usize::from(entry.header.origin > newest);
            }
        }
        2 * own > all
    }

    /// Operator and output that feed an input.
    pub fn producer(&self, operator: usize, input: usize) -> Option<(usize, usize)> {
        let topic = self.operators[operator].stage.inputs.get(input).filter(|t| !t.is_empty())?;
        let output = |o: &Operator<'_>| o.stage.outputs.iter().position(|t| t == topic);
        self.operators.iter().enumerate().find_map(|(i, o)| Some((i, output(o)?)))
    }

    /// Operators and inputs that an output feeds.
    pub fn consumers(&self, operator: usize, output: usize) -> Vec<(usize, usize)> {
        let Some(topic) = self.operators[operator].stage.outputs.get(output) else { return Vec::new() };
        let inputs = |(i, o): (usize, &Operator<'_>)| {
            let ports = o.stage.inputs.iter().enumerate().filter(|(_, t)| *t == topic);
            ports.map(|(p, _)| (i, p)).collect::<Vec<_>>()
        };
        self.operators.iter().enumerate().flat_map(inputs).collect()
    }

    /// For how much of a time the process of an operator was at work, ns.
    pub fn busy(&self, operator: usize, from: u64, to: u64) -> u64 {
        let Some(steps) = self.busy.get(&self.operators[operator].process) else { return 0 };
        // One thread does one step at a time, so only the last step that began before can reach into the time.
        let first = steps.partition_point(|(begun, _)| *begun < from).saturating_sub(1);
        let within = steps[first..].iter().take_while(|(begun, _)| *begun < to);
        let sum: u64 = within.map(|(begun, sent)| sent.min(&to).saturating_sub(*begun.max(&from))).sum();
        sum.min(to.saturating_sub(from))
    }

    /// From the first to the last activation, s.
    pub fn seconds(&self) -> f64 {
        let active = self.operators.iter().flat_map(|o| o.entries).filter(|e| is_activation(e));
        let last = active.map(|e| e.header.stamp).max().unwrap_or(0);
        last.saturating_sub(self.first()) as f64 * 1e-9
    }

    /// The time of the first activation, ns.
    pub fn first(&self) -> u64 {
        let active = self.operators.iter().flat_map(|o| o.entries).filter(|e| is_activation(e));
        active.map(|e| e.header.stamp).min().unwrap_or(0)
    }
}

impl Operator<'_> {
    /// When the outputs of an entry were sent, ns; none where nothing says so.
    pub fn sent(&self, entry: usize) -> Option<u64> {
        self.sent.get(entry).copied().flatten()
    }

    /// The times from the activations to the sending of their outputs.
    pub fn step_ms(&self) -> Spread {
        let steps = self.entries.iter().enumerate();
        Spread::of(steps.filter_map(|(at, e)| Some((self.sent(at)? - e.header.stamp) as f64 * 1e-6)))
    }

    /// The entry that took a sample of an input for the first time.
    pub fn taker(&self, input: usize, incarnation: u32, sequence: u64) -> Option<usize> {
        find(self.taken.get(input)?, incarnation, sequence)
    }

    /// The entry that made a sample of an output.
    pub fn maker(&self, output: usize, incarnation: u32, sequence: u64) -> Option<usize> {
        find(self.made.get(output)?, incarnation, sequence)
    }
}

fn find(index: &Index, incarnation: u32, sequence: u64) -> Option<usize> {
    let ((life, first), (count, entry)) = index.range(..=(incarnation, sequence)).next_back()?;
    (*life == incarnation && sequence - first < u64::from(*count)).then_some(*entry)
}

fn index(entries: &[Entry], ports: usize, kind: RefKind) -> Vec<Index> {
    let mut found = vec![Index::new(); ports];
    for (number, entry) in entries.iter().enumerate().filter(|(_, e)| is_activation(e)) {
        for r in entry.refs_of(kind).filter(|r| r.count > 0) {
            if let Some(index) = found.get_mut(r.port as usize) {
                index.entry((r.incarnation, r.first)).or_insert((r.count, number));
            }
        }
    }
    found
}

/// When the outputs of each entry were sent: the entry behind it says so. A simulated run charges a latency in place.
fn sent_times(entries: &[Entry], latency: u64) -> Vec<Option<u64>> {
    let is_measured = entries.iter().any(|e| e.body.sent_before > 0);
    let sent = |number: usize, entry: &Entry| {
        if !is_activation(entry) {
            return None;
        }
        if !is_measured {
            return Some(entry.header.stamp.saturating_add(latency));
        }
        let next = entries.get(number + 1)?;
        let is_same_life =
            next.header.incarnation == entry.header.incarnation && next.cause() != Some(Cause::Start);
        (is_same_life && next.body.sent_before > entry.header.stamp).then_some(next.body.sent_before)
    };
    entries.iter().enumerate().map(|(n, e)| sent(n, e)).collect()
}

/// The laps that a live session keeps.
pub fn laps(session: &Session) -> Laps {
    let mut laps = Laps::new();
    for recorded in session.samples_where(|t| t.role == TopicRole::Measured).flatten() {
        let topic = &session.topics()[recorded.topic];
        let Ok(pieces) = Pieces::split(Diagnostics::KIND, &recorded.sample) else { continue };
        add_laps(&mut laps, &topic.operator, pieces);
    }
    laps
}

/// Adds the laps of an activation of an operator: a sample of its topic `timing`. A sample of another type adds nothing.
pub fn add_laps(laps: &mut Laps, operator: &str, sample: Pieces<'_>) {
    let Ok(view) = sample.view::<Diagnostics>() else { return };
    let times = view.elements.iter().filter(|m| m.value.is_finite() && m.value >= 0.0);
    let times =
        times.map(|m| (m.name().trim_end_matches("_s").replace('_', " "), (m.value * 1e9).min(1e15) as u64));
    laps.entry(operator.to_owned()).or_default().insert(view.header.stamp, times.collect());
}
