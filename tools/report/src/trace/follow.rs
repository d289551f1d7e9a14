//! One sample on its way along a path.

use serde::Serialize;
use stillpoint_samples::{Cause, RefKind};

use super::journals::Journals;
use super::paths::Path;

/// Samples of one activation that are followed; more of them tell nothing else.
const MOST_OF_ONE: u64 = 64;

/// A part of the time that a sample takes at a hop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseRole {
    /// From the acquisition to the activation of the source.
    Acquisition,
    /// The delay of the edge.
    Delay,
    /// From the arrival to the tick of the operator's timer.
    Tick,
    /// The process of the operator was at work on something else.
    Busy,
    /// Until the thread of the operator ran.
    Wake,
    /// Taken, until the activation that sends what follows from it.
    Hold,
    /// From the activation to the sending of its outputs.
    Step,
}

impl PoseRole {
    /// All parts, in the order in which they happen.
    pub const ALL: [Self; 7] =
        [Self::Acquisition, Self::Delay, Self::Tick, Self::Busy, Self::Wake, Self::Hold, Self::Step];

    /// The part as a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Acquisition => "acquisition",
            Self::Delay => "delay",
            Self::Tick => "tick",
            Self::Busy => "busy",
            Self::Wake => "wake",
            Self::Hold => "hold",
            Self::Step => "step",
        }
    }
}

/// The times of a sample at an operator, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stop {
    /// By [`PoseRole`], in the order of [`Part::ALL`].
    pub parts: [u64; 7],
    /// When it arrived.
    pub arrived: u64,
    /// When it was taken.
    pub taken: u64,
    /// When what follows from it was sent.
    pub sent: u64,
}

/// A sample that came to the end of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Passage {
    /// Its sequence at the source.
    pub sequence: u64,
    /// Incarnation of the source.
    pub incarnation: u32,
    /// When it was acquired, ns.
    pub acquired: u64,
    /// By operator of the path.
    pub stops: Vec<Stop>,
}

impl Passage {
    /// From acquisition to the last sending, ns.
    pub fn total(&self) -> u64 {
        self.stops.last().map_or(0, |stop| stop.sent.saturating_sub(self.acquired))
    }
}

/// How the way of a sample ended before the end of the path: at this hop of the path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum End {
    /// The operator never took it.
    NotTaken(usize),
    /// The operator took it, and sent nothing before it took a newer one.
    NothingSent(usize),
    /// The journal ends before.
    Unfinished(usize),
}

/// Follows every sample that begins a path.
pub fn all(journals: &Journals<'_>, path: &Path) -> Vec<Result<Passage, End>> {
    let Some(first) = path.hops.first() else { return Vec::new() };
    let source = &journals.operators[first.operator];
    let mut found = Vec::new();
    for (number, entry) in source.entries.iter().enumerate() {
        let sent = entry.refs_of(RefKind::Output).filter(|r| Some(r.port as usize) == first.output);
        for r in sent {
            for at in 0..u64::from(r.count).min(MOST_OF_ONE) {
                found.push(one(journals, path, number, r.incarnation, r.first.saturating_add(at)));
            }
        }
    }
    found
}

/// Follows a sample of the source's entry `begun`.
fn one(
    journals: &Journals<'_>,
    path: &Path,
    begun: usize,
    incarnation: u32,
    sequence: u64,
) -> Result<Passage, End> {
    let source = &journals.operators[path.hops[0].operator];
    let head = source.entries[begun].header;
    let acquired = head.origin.min(head.stamp);
    let mut parts = [0; 7];
    parts[PoseRole::Acquisition as usize] = head.stamp - acquired;
    let sent = source.sent(begun).ok_or(End::Unfinished(0))?;
    let mut stops = vec![Stop { parts, arrived: head.stamp, taken: head.stamp, sent }];
    let (mut sample, mut stamp) = ((incarnation, sequence), head.stamp);
    for (number, hop) in path.hops.iter().enumerate().skip(1) {
        let node = &journals.operators[hop.operator];
        let input = hop.input.unwrap_or_default();
        let taker = node.taker(input, sample.0, sample.1).ok_or_else(|| {
            // What came after the last activation was not taken for no fault of anyone.
            let is_over = node.entries.last().is_none_or(|e| e.header.stamp < stops[number - 1].sent);
            if is_over { End::Unfinished(number) } else { End::NotTaken(number) }
        })?;
        let sender = match hop.output {
            None => taker,
            Some(output) => sender(journals, hop.operator, input, output, taker)
                .ok_or(End::NothingSent(number))?
                .ok_or(End::Unfinished(number))?,
        };
        let took = &node.entries[taker];
        let sends = &node.entries[sender];
        let sent = node.sent(sender).ok_or(End::Unfinished(number))?;
        let taken = took.header.stamp;
        // The clock is read after the sending, so a quick consumer may begin before.
        let before = &mut stops[number - 1];
        before.sent = before.sent.min(taken);
        before.parts[PoseRole::Step as usize] = before.sent.saturating_sub(stamp);
        let left = before.sent;
        let delay = node.delays.get(input).copied().unwrap_or(0);
        let arrived = left.max(stamp.saturating_add(delay)).min(taken).max(left);
        let mut parts = [0; 7];
        let mut put = |part: PoseRole, time: u64| parts[part as usize] = time;
        let wait = taken.saturating_sub(arrived);
        let tick = match took.cause() {
            Some(Cause::Timer) => took.body.nominal.saturating_sub(arrived).min(wait),
            _ => 0,
        };
        let busy = journals.busy(hop.operator, arrived + tick, taken);
        put(PoseRole::Delay, arrived - left);
        put(PoseRole::Tick, tick);
        put(PoseRole::Busy, busy);
        put(PoseRole::Wake, wait - tick - busy);
        put(PoseRole::Hold, sends.header.stamp.saturating_sub(taken));
        put(PoseRole::Step, sent.saturating_sub(sends.header.stamp));
        stops.push(Stop { parts, arrived, taken, sent });
        stamp = sends.header.stamp;
        if let Some(output) = hop.output {
            let made = sends.refs_of(RefKind::Output).find(|r| r.port as usize == output && r.count > 0);
            sample = made.map_or(sample, |r| (r.incarnation, r.first));
        }
    }
    Ok(Passage { sequence, incarnation, acquired, stops })
}

/// The first activation from `taker` on that sends on an output, unless a newer sample is taken before it: `None`. `Some(None)`:
/// the journal ends before either.
fn sender(
    journals: &Journals<'_>,
    operator: usize,
    input: usize,
    output: usize,
    taker: usize,
) -> Option<Option<usize>> {
    let entries = journals.operators[operator].entries;
    let life = entries[taker].header.incarnation;
    for (number, entry) in entries.iter().enumerate().skip(taker) {
        if entry.header.incarnation != life {
            break;
        }
        let takes = |r: &&stillpoint_samples::JournalRef| r.port as usize == input && r.count > 0;
        if number > taker && entry.refs_of(RefKind::Fresh).any(|r| takes(&r)) {
            return None;
        }
        if entry.refs_of(RefKind::Output).any(|r| r.port as usize == output && r.count > 0) {
            return Some(Some(number));
        }
    }
    Some(None)
}
