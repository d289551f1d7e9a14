//! How a head is held: its estimate against the target, the gate of the beam, the valves, and their far end. The figures
//! come from the samples of a running pipeline or of a session. They depend on the types of samples only, not on the names
//! and kinds of operators.

use std::collections::VecDeque;
use std::fmt::{Display, Formatter};

use serde::Serialize;
use stillpoint_actuate::aim::{Aim, Tolerances};
use stillpoint_pipeline::graph::Graph;
use stillpoint_recorder::{Session, TopicKind};
use stillpoint_samples::{
    Actuation, ActuationElement, ActuationReason, Diagnostics, FarEnd as FarEndSample, Gate, GateElement,
    GateReason, Pieces, Sample, SampleKind, Target, TargetElement, Track,
};

use crate::episodes::{ActuationEpisodes, Episodes};
use crate::far_end::{FarEnd, FarEnds};
use crate::target_refusals::{CHANNELS, Refusals};

/// The end of a run over which errors are computed, ns.
const LAST: u64 = 5_000_000_000;
/// Reasons against the beam that are named at the end of a run.
const MAIN_REASONS: usize = 3;
/// Errors are reported, not judged.
const ANY: Tolerances = Tolerances {
    position: f64::INFINITY,
    angle: f64::INFINITY,
    begin: 1.0,
    position_sd: f64::INFINITY,
    angle_sd: f64::INFINITY,
};

/// Collects the samples that state how a head is held.
pub struct Hold {
    target_track: Vec<Aimed>,
    gates: Vec<Gated>,
    valves: Vec<ValveStates>,
    far_ends: Vec<FarEnds>,
}

/// The states of a gate on one topic.
struct Gated {
    topic: String,
    newest: Option<GateElement>,
    /// Samples without beam.
    off: u64,
    /// Of these, those with each reason, in the order of the reasons.
    reasons: Vec<u64>,
}

impl Gated {
    fn new(topic: String) -> Self {
        Self { topic, newest: None, off: 0, reasons: vec![0; GateReason::ALL.len()] }
    }

    fn take(&mut self, gate: &GateElement) {
        self.newest = Some(*gate);
        if gate.beam == 0 {
            self.off += 1;
            for (count, (_, bit)) in self.reasons.iter_mut().zip(GateReason::ALL) {
                *count += u64::from(gate.reasons & bit != 0);
            }
        }
    }

    /// The most frequent reasons against the beam, with their shares of the samples without beam.
    fn why_not(&self) -> Vec<(&'static str, f64)> {
        let mut all: Vec<(&'static str, u64)> =
            GateReason::ALL.iter().map(|(word, _)| *word).zip(self.reasons.iter().copied()).collect();
        // Stable: reasons as frequent stand in their order.
        all.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        all.truncate(MAIN_REASONS);
        let share = |count: u64| count as f64 / self.off.max(1) as f64;
        all.into_iter().filter(|(_, count)| *count > 0).map(|(word, count)| (word, share(count))).collect()
    }
}

/// The states of actuation on one topic.
#[derive(Default)]
struct ValveStates {
    topic: String,
    newest: Option<ActuationElement>,
    episodes: ActuationEpisodes,
}

/// A target, and the estimate that the operator of the target takes as its input.
struct Aimed {
    target: String,
    estimate: String,
    newest: Option<TargetElement>,
    refusals: Refusals,
    /// Times, ns, and estimate minus target, m and rad, over the last 5 s.
    errors: VecDeque<(u64, [f64; 6])>,
}

impl Hold {
    /// The targets, gates, valves and far ends of a graph.
    pub fn of(graph: &Graph) -> Self {
        let sent = |kind: &'static SampleKind| {
            graph.operators.iter().flat_map(move |node| {
                let ports = node.outputs.iter().zip(node.stage.kind.outputs);
                ports
                    .filter(move |(_, port)| *port.sample == *kind)
                    .map(move |(o, _)| (node, o.topic.clone()))
            })
        };
        let target_track = sent(Target::KIND).filter_map(|(node, target)| {
            let ports = node.inputs.iter().zip(node.stage.kind.inputs);
            let from = ports.filter(|(_, port)| *port.sample == *Track::KIND).find_map(|(i, _)| i.edge)?;
            let estimate = graph.operators[from.operator].outputs[from.output].topic.clone();
            Some(Aimed {
                target,
                estimate,
                newest: None,
                refusals: Refusals::default(),
                errors: VecDeque::new(),
            })
        });
        Self {
            target_track: target_track.collect(),
            gates: sent(Gate::KIND).map(|(_, topic)| Gated::new(topic)).collect(),
            valves: sent(Actuation::KIND)
                .map(|(_, topic)| ValveStates { topic, ..ValveStates::default() })
                .collect(),
            far_ends: sent(FarEndSample::KIND)
                .map(|(node, topic)| {
                    let mut ports = node.outputs.iter().zip(node.stage.kind.outputs);
                    let reasons = ports.find(|(_, port)| *port.sample == *Diagnostics::KIND);
                    FarEnds::new(&topic, reasons.map(|(o, _)| o.topic.clone()))
                })
                .collect(),
        }
    }

    /// The same with the samples of a session. Topics that the session does not keep stay empty.
    pub fn of_session(graph: &Graph, session: &Session) -> Option<Held> {
        let mut hold = Self::of(graph);
        let topics: Vec<String> = hold.topics().map(str::to_owned).collect();
        for recorded in session.samples_where(|t| topics.contains(&t.name)) {
            let recorded = recorded.ok()?;
            let topic = &session.topics()[recorded.topic];
            if let TopicKind::Known(kind) = &topic.kind
                && let Ok(pieces) = Pieces::split(kind, &recorded.sample)
            {
                hold.take(&topic.name, pieces);
            }
        }
        Some(hold.held())
    }

    /// Only the valves and their far ends.
    pub fn of_valves(graph: &Graph) -> Self {
        Self { target_track: Vec::new(), gates: Vec::new(), ..Self::of(graph) }
    }

    /// The topics to read.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        let target_track = self.target_track.iter().flat_map(|a| [a.target.as_str(), a.estimate.as_str()]);
        let gates = self.gates.iter().map(|g| g.topic.as_str());
        let far_ends = self.far_ends.iter();
        let far_ends = far_ends.flat_map(|f| [Some(f.topic.as_str()), f.diagnostics.as_deref()]).flatten();
        let valves = self.valves.iter().map(|v| v.topic.as_str());
        target_track.chain(gates).chain(valves).chain(far_ends)
    }

    /// Takes a sample. Targets have to come before estimates of the same time.
    pub fn take(&mut self, topic: &str, pieces: Pieces<'_>) {
        for aim in &mut self.target_track {
            if aim.target == topic
                && let Some(target) = pieces.view::<Target>().ok().as_ref().and_then(|v| v.first())
            {
                aim.newest = Some(*target);
                aim.refusals.take(pieces.header().stamp, target);
            }
            if aim.estimate == topic
                && let Some(target) = &aim.newest
                && let Ok(view) = pieces.view::<Track>()
                && let Some(track) = view.first()
            {
                let now = view.header.stamp;
                aim.errors.push_back((now, Aim::at(track, target, &ANY, true).error));
                while aim.errors.front().is_some_and(|(at, _)| at + LAST < now) {
                    aim.errors.pop_front();
                }
            }
        }
        let gate = self.gates.iter_mut().find(|g| g.topic == topic);
        if let (Some(gated), Ok(view)) = (gate, pieces.view::<Gate>())
            && let Some(gate) = view.first()
        {
            gated.take(gate);
        }
        let valves = self.valves.iter_mut().find(|v| v.topic == topic);
        if let (Some(valves), Ok(view)) = (valves, pieces.view::<Actuation>())
            && let Some(state) = view.first()
        {
            valves.episodes.take(view.header.stamp, state);
            valves.newest = Some(*state);
        }
        for far in &mut self.far_ends {
            if far.topic == topic
                && let Ok(view) = pieces.view::<FarEndSample>()
                && let Some(state) = view.first()
            {
                far.take(view.header.stamp, state);
            } else if far.diagnostics.as_deref() == Some(topic)
                && let Ok(view) = pieces.view::<Diagnostics>()
            {
                far.take_reasons(view.elements);
            }
        }
    }

    /// How the head is held so far.
    pub fn held(&self) -> Held {
        let known =
            |g: &Gated| g.newest.map(|gate| Beam { why_not: g.why_not(), ..Beam::of(&g.topic, &gate) });
        Held {
            targets: self.target_track.iter().map(Against::of).filter(Against::has_news).collect(),
            gates: self.gates.iter().filter_map(known).collect(),
            valves: self.valves.iter().filter_map(Valves::of).collect(),
            far_ends: self.far_ends.iter().filter_map(FarEnds::reported).collect(),
        }
    }
}

/// How a head is held.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Held {
    /// Estimates against their targets.
    pub targets: Vec<Against>,
    pub gates: Vec<Beam>,
    pub valves: Vec<Valves>,
    /// Far ends of valves and beam.
    pub far_ends: Vec<FarEnd>,
}

/// An estimate against its target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Against {
    /// Topic of the target.
    pub target: String,
    /// Topic of the estimate.
    pub estimate: String,
    /// The channels that the target holds.
    pub channels: Vec<Off>,
    /// The targets that were refused.
    pub refusals: Refusals,
}

/// Estimate minus target in one channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Off {
    /// Name of the channel.
    pub channel: &'static str,
    /// `mm` or `deg`.
    pub unit: &'static str,
    pub now: f64,
    /// Root mean square over the last 5 s.
    pub rms: f64,
    /// Largest absolute value in the last 5 s.
    pub worst: f64,
}

/// The gate of a beam.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Beam {
    /// Topic of the gate's state.
    pub topic: String,
    /// Whether the beam may be on.
    pub on: bool,
    /// The reasons against the beam.
    pub reasons: Vec<&'static str>,
    /// Fraction of the observed time in which the beam was allowed; none before any time was observed.
    pub duty: Option<f64>,
    /// Observed time, s.
    pub watched_s: f64,
    /// Number of leases that began.
    pub leases: u64,
    /// The most frequent reasons against the beam, with their shares of the samples without beam.
    pub why_not: Vec<(&'static str, f64)>,
}

/// The state of actuation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Valves {
    /// Topic of its state.
    pub topic: String,
    /// Disarmed, armed, holding, venting or fault.
    pub state: &'static str,
    /// The reasons for the state, and other irregularities.
    pub reasons: Vec<&'static str>,
    /// Number of faults that the operator counted in its present incarnation.
    pub faults: u64,
    /// The reasons of the last fault.
    pub fault: Vec<&'static str>,
    /// Times in which the valves were told to vent.
    pub vents: Episodes,
    /// Times in which actuation stood in a fault, over all incarnations.
    pub fault_times: Episodes,
    /// Commands to arm or to resume that were refused.
    pub refused: u64,
    /// The conditions that were missing at the last refusal.
    pub lacking: Vec<&'static str>,
}

impl Against {
    fn of(aim: &Aimed) -> Self {
        let channel = |place: usize| {
            let (unit, scale) = if place < 3 { ("mm", 1e3) } else { ("deg", 1.0_f64.to_degrees()) };
            let all = aim.errors.iter().map(|(_, error)| error[place] * scale);
            let known: Vec<f64> = all.filter(|e| e.is_finite()).collect();
            let squares: f64 = known.iter().map(|e| e * e).sum();
            Some(Off {
                channel: CHANNELS[place],
                unit,
                now: *known.last()?,
                rms: (squares / known.len() as f64).sqrt(),
                worst: known.iter().fold(0.0, |most, e| e.abs().max(most)),
            })
        };
        let channels = (0..6).filter_map(channel).collect();
        let [target, estimate] = [&aim.target, &aim.estimate].map(String::clone);
        Self { target, estimate, channels, refusals: aim.refusals.clone() }
    }

    fn has_news(&self) -> bool {
        !self.channels.is_empty() || self.refusals.refused > 0
    }

    /// Why the last target was refused, if it was.
    fn refused(&self) -> Option<String> {
        let why = self.refusals.why.as_ref().filter(|_| self.refusals.stands_refused)?;
        Some(format!("target refused: {why}"))
    }
}

impl Beam {
    fn of(topic: &str, gate: &GateElement) -> Self {
        Self {
            topic: topic.to_owned(),
            on: gate.beam == 1,
            reasons: GateReason::words(gate.reasons).collect(),
            duty: (gate.watched_for > 0).then(|| gate.on_for as f64 / gate.watched_for as f64),
            watched_s: gate.watched_for as f64 * 1e-9,
            leases: gate.leases,
            why_not: Vec::new(),
        }
    }

    fn word(&self) -> String {
        because(if self.on { "on" } else { "off" }, &self.reasons)
    }
}

impl Valves {
    fn of(states: &ValveStates) -> Option<Self> {
        let actuation = states.newest?;
        Some(Self {
            topic: states.topic.clone(),
            state: actuation.state().word(),
            reasons: ActuationReason::words(actuation.reasons).collect(),
            faults: actuation.faults,
            fault: ActuationReason::words(actuation.fault).collect(),
            vents: states.episodes.vents(),
            fault_times: states.episodes.faults(),
            refused: actuation.refused,
            lacking: ActuationReason::words(actuation.lacking).collect(),
        })
    }

    fn word(&self) -> String {
        because(self.state, &self.reasons)
    }
}

/// A state with its reasons.
fn because(state: &str, reasons: &[&str]) -> String {
    if reasons.is_empty() { state.to_owned() } else { format!("{state} ({})", reasons.join(", ")) }
}

impl Held {
    /// Adds what another observation of the same run has and this one lacks.
    pub fn add_missing(&mut self, other: Held) {
        let is_new = |a: &Against| self.targets.iter().all(|known| known.target != a.target);
        let targets: Vec<Against> = other.targets.into_iter().filter(is_new).collect();
        self.targets.extend(targets);
        let is_new = |b: &Beam| self.gates.iter().all(|known| known.topic != b.topic);
        let gates: Vec<Beam> = other.gates.into_iter().filter(is_new).collect();
        self.gates.extend(gates);
        let is_new = |v: &Valves| self.valves.iter().all(|known| known.topic != v.topic);
        let valves: Vec<Valves> = other.valves.into_iter().filter(is_new).collect();
        self.valves.extend(valves);
        let is_new = |far: &FarEnd| self.far_ends.iter().all(|known| known.topic != far.topic);
        let far_ends: Vec<FarEnd> = other.far_ends.into_iter().filter(is_new).collect();
        self.far_ends.extend(far_ends);
    }

    /// The present state, as parts of a line.
    pub fn now(&self) -> Vec<String> {
        let off = |o: &Off| format!("{} {:+.2} {}", o.channel, o.now, o.unit);
        let targets = self.targets.iter().flat_map(|a| &a.channels).map(off);
        let gates = self.gates.iter().map(|g| format!("beam {}", g.word()));
        let valves = self.valves.iter().map(|v| format!("valves {}", v.word()));
        let refused = self.targets.iter().filter_map(Against::refused);
        let far_ends = self.far_ends.iter().filter_map(FarEnd::now);
        targets.chain(refused).chain(gates).chain(valves).chain(far_ends).collect()
    }
}

/// The state at the end of a run: a line for each target, gate, actuation and far end.
impl Display for Held {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        for Against { target, estimate, channels, refusals } in &self.targets {
            let off = |o: &Off| {
                let Off { channel, unit, now, rms, worst } = o;
                format!("{channel} {now:+.2} {unit} (rms {rms:.2}, worst {worst:.2})")
            };
            let channels = channels.iter().map(off).collect::<Vec<_>>().join(", ");
            if !channels.is_empty() {
                writeln!(f, "{estimate} minus {target} at the end (and over the last 5 s): {channels}")?;
            }
            if let Some(sentence) = refusals.sentence() {
                writeln!(f, "{target}: {sentence}")?;
            }
        }
        for gate in &self.gates {
            let Beam { topic, duty, watched_s, leases, .. } = gate;
            let duty = duty.map_or("-".to_owned(), |duty| format!("{:.0} %", duty * 100.0));
            let word = gate.word();
            write!(f, "{topic}: beam {word}; allowed {duty} of {watched_s:.1} s, in {leases} leases")?;
            let why: Vec<String> =
                gate.why_not.iter().map(|(word, share)| format!("{word} {:.0} %", share * 100.0)).collect();
            writeln!(f, "{}{}", if why.is_empty() { "" } else { "; without beam: " }, why.join(", "))?;
        }
        for valves in &self.valves {
            let Valves { topic, vents, fault_times, refused, lacking, .. } = valves;
            let vents = vents.line("vented").unwrap_or_else(|| "never vented".to_owned());
            let faults = fault_times.line("in fault").unwrap_or_else(|| "no fault".to_owned());
            let refused = because(&format!("commands refused: {refused}"), lacking);
            writeln!(f, "{topic}: {}; {vents}; {faults}; {refused}", valves.word())?;
        }
        self.far_ends.iter().try_for_each(|far| writeln!(f, "{far}"))
    }
}
