//! What a client asks in a simulation: the calls of a record, with bodies of the recorded sizes in place of their contents.

use std::collections::{BTreeMap, BTreeSet};

use crate::call::Kind;
use crate::record::{Record, RecordedCall, Round};
use crate::{Build, Call, Hash};

/// Bytes of a call without the weights that it begins with.
const BARE_CALL: u64 = 64;

/// Why a record cannot be simulated.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum SimulationError {
    /// Calls of another kind.
    #[error(
        "the record has calls of the kind `{0}`; doses, solves and prices can be simulated: record a plan"
    )]
    Kind(String),
    /// Nothing was asked.
    #[error("the record has no calls: record a plan whose doses are not in its folder yet")]
    Empty,
    /// No worker reported its times.
    #[error(
        "no worker of the record reported the time of a computation: record a plan with a worker of this build"
    )]
    NoTimes,
}

/// A call of a script.
pub struct Asked {
    /// The call.
    pub call: Call,
    /// Its computation, ns.
    pub computed: u64,
    /// Time in which the caller takes the answer, ns.
    pub taken: u64,
    /// The name of its answer.
    pub answer: Hash,
    /// Bytes of its answer.
    pub length: u64,
    /// The call whose answer is there before this one is asked.
    pub after: Option<usize>,
    /// The calls that are asked as soon as the answer of this one is there.
    pub followers: Vec<usize>,
    head: [u8; 16],
}

impl Asked {
    /// The answer: a head that no other has, then zeros.
    pub fn body(&self) -> Vec<u8> {
        body(self.head, self.length)
    }

    /// A part of the answer.
    pub fn part(&self, part: u32, size: usize) -> Option<Vec<u8>> {
        part_of(self.head, self.length, part, size)
    }
}

/// Rates of a worker, from what workers reported.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    /// Time for each byte that a worker fetches, ns.
    pub received: f64,
    /// Time for each byte of arguments that a worker opens, ns: of doses, and of solves and prices.
    pub opened: [f64; 2],
}

impl Rates {
    /// The means over some scripts.
    pub fn of(scripts: &[Script]) -> Self {
        let mean = |of: fn(&Self) -> f64| {
            scripts.iter().map(|script| of(&script.rates)).sum::<f64>() / scripts.len().max(1) as f64
        };
        Self { received: mean(|r| r.received), opened: [mean(|r| r.opened[0]), mean(|r| r.opened[1])] }
    }

    /// Time for each byte that is opened for a call of a kind, ns.
    pub fn of_kind(&self, kind: Kind) -> f64 {
        self.opened[usize::from(kind != Kind::Dose)]
    }
}

/// What a client asks.
pub struct Script {
    /// The build of client and workers.
    pub build: Build,
    /// The calls.
    pub calls: Vec<Asked>,
    /// By key, their places.
    pub places: BTreeMap<Hash, usize>,
    /// By name of their answers, their places.
    pub answers: BTreeMap<Hash, usize>,
    /// Lengths of the contents that calls need.
    pub lengths: BTreeMap<Hash, u64>,
    /// Rounds.
    pub rounds: Vec<Round>,
    /// Time of the client for each byte of a message, ns.
    pub handled: f64,
    rates: Rates,
}

impl Script {
    /// Of this record, for the client at this place: its contents are its own.
    pub fn new(record: &Record, client: usize) -> Result<Self, SimulationError> {
        if record.rounds.is_empty() || record.calls.is_empty() {
            return Err(SimulationError::Empty);
        }
        let mut contents: Vec<Hash> = (0..record.contents.len())
            .map(|place| Hash::of_parts(&[b"content", &head(client, place)]))
            .collect();
        for (place, call) in record.calls.iter().enumerate() {
            if let Some(answer) = call.answer {
                contents[answer] = Hash::of(&body(head(client, place), record.contents[answer]));
            }
        }
        let usual = usual(record)?;
        let lengths = contents.iter().copied().zip(record.contents.iter().copied()).collect();
        let asked = |(place, of): (usize, &RecordedCall)| -> Result<Asked, SimulationError> {
            let kind = kind_of(&of.kind)?;
            let (usual_ns, usual_length) = usual.get(&kind).copied().unwrap_or_default();
            let length = of.answer.map_or(usual_length, |answer| record.contents[answer]);
            let head = head(client, place);
            Ok(Asked {
                call: call(kind, of, &contents, place)?,
                computed: of.computed_s().map_or(usual_ns, ns),
                taken: ns(of.taken_s),
                answer: of.answer.map_or_else(|| Hash::of(&body(head, length)), |answer| contents[answer]),
                length,
                after: of.after,
                followers: Vec::new(),
                head,
            })
        };
        let mut calls: Vec<Asked> = record.calls.iter().enumerate().map(asked).collect::<Result<_, _>>()?;
        for (place, of) in record.calls.iter().enumerate() {
            if let Some(after) = of.after {
                calls[after].followers.push(place);
            }
        }
        let build = Build::of(&format!("{} {client}", record.build));
        let places = calls.iter().enumerate().map(|(place, asked)| (asked.call.key(&build), place)).collect();
        let answers = calls.iter().enumerate().map(|(place, asked)| (asked.answer, place)).collect();
        let handled = record.handled.seconds * 1e9 / record.handled.bytes.max(1) as f64;
        Ok(Self {
            build,
            calls,
            places,
            answers,
            lengths,
            rounds: record.rounds.clone(),
            handled,
            rates: rates(record),
        })
    }

    /// Computation of all calls, s.
    pub fn work_s(&self) -> f64 {
        self.calls.iter().map(|asked| asked.computed as f64 * 1e-9).sum()
    }

    /// The client's own time between rounds, s.
    pub fn between_s(&self) -> f64 {
        self.rounds.windows(2).map(|pair| (pair[1].begun_s - pair[0].ended_s).max(0.0)).sum()
    }

    /// The client's own time after a round, ns.
    pub fn after(&self, round: usize) -> Option<u64> {
        let (ended, next) = (self.rounds.get(round)?, self.rounds.get(round + 1)?);
        Some(ns((next.begun_s - ended.ended_s).max(0.0)))
    }

    /// Bytes of the longest content.
    pub fn longest_content(&self) -> u64 {
        self.lengths.values().copied().max().unwrap_or(0)
    }
}

fn ns(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

/// What tells the answers of all calls apart.
fn head(client: usize, place: usize) -> [u8; 16] {
    let mut head = [0; 16];
    head[..8].copy_from_slice(&(1 + client as u64).to_le_bytes());
    head[8..].copy_from_slice(&(1 + place as u64).to_le_bytes());
    head
}

fn body(head: [u8; 16], length: u64) -> Vec<u8> {
    let mut body = vec![0; length as usize];
    let count = body.len().min(head.len());
    body[..count].copy_from_slice(&head[..count]);
    body
}

fn part_of(head: [u8; 16], length: u64, part: u32, size: usize) -> Option<Vec<u8>> {
    let start = u64::from(part) * size as u64;
    let rest = length.checked_sub(start)?.min(size as u64);
    Some(if part == 0 { body(head, rest) } else { vec![0; rest as usize] })
}

fn kind_of(word: &str) -> Result<Kind, SimulationError> {
    let kinds = [Kind::Dose, Kind::Solve, Kind::Price];
    kinds.into_iter().find(|kind| kind.word() == word).ok_or_else(|| SimulationError::Kind(word.to_owned()))
}

/// A call of this kind with these inputs and about as many bytes. No other call is the same.
fn call(kind: Kind, of: &RecordedCall, contents: &[Hash], place: usize) -> Result<Call, SimulationError> {
    let inputs: Vec<Hash> = of.inputs.iter().map(|input| contents[*input]).collect();
    let Some((first, rest)) = inputs.split_first() else { return Err(SimulationError::Empty) };
    let beams: Vec<Vec<Hash>> = match rest {
        [] => vec![vec![*first]],
        rest => rest.iter().map(|dose| vec![*dose]).collect(),
    };
    let start = of.bytes.saturating_sub(BARE_CALL + 32 * inputs.len() as u64) / 8;
    Ok(match kind {
        Kind::Dose => Call::dose(*first, place as f64 * 1e-6),
        Kind::Price => Call::Price { goals: *first, base: None, candidates: beams },
        _ => Call::solve(*first, beams, (start > 0).then(|| vec![0.0; start as usize]), 1.0 + place as f64),
    })
}

/// Median time, ns, and answer, bytes, of each kind of call.
fn usual(record: &Record) -> Result<BTreeMap<Kind, (u64, u64)>, SimulationError> {
    let mut of_kind: BTreeMap<Kind, (Vec<u64>, Vec<u64>)> = BTreeMap::new();
    for call in &record.calls {
        let (times, lengths) = of_kind.entry(kind_of(&call.kind)?).or_default();
        times.extend(call.computed_s().map(ns));
        lengths.extend(call.answer.map(|answer| record.contents[answer]));
    }
    if of_kind.values().all(|(times, _)| times.is_empty()) {
        return Err(SimulationError::NoTimes);
    }
    let median = |mut values: Vec<u64>| {
        values.sort_unstable();
        values.get(values.len() / 2).copied().unwrap_or(0)
    };
    Ok(of_kind.into_iter().map(|(kind, (times, lengths))| (kind, (median(times), median(lengths)))).collect())
}

/// What workers needed for each byte that they fetched and opened first. Calls without a fetch say nothing of it: before them a
/// worker takes messages of those that fetch from it.
fn rates(record: &Record) -> Rates {
    let mut known: BTreeSet<(&str, usize)> = BTreeSet::new();
    let mut own: BTreeSet<(&str, usize)> = BTreeSet::new();
    let (mut fetched, mut opened) = ((0.0, 0_u64), [(0.0, 0_u64); 2]);
    let attempts = |call| -> Vec<(&RecordedCall, &crate::record::Attempt)> {
        let call: &RecordedCall = call;
        call.attempts.iter().map(move |attempt| (call, attempt)).collect()
    };
    let mut all: Vec<(&RecordedCall, &crate::record::Attempt)> =
        record.calls.iter().flat_map(attempts).collect();
    all.sort_by(|(_, a), (_, b)| a.asked_s.total_cmp(&b.asked_s));
    for (call, attempt) in all {
        let Some(worker) = attempt.worker.as_deref().filter(|_| attempt.computed_s.is_some()) else {
            continue;
        };
        let of_kind = &mut opened[usize::from(call.kind != Kind::Dose.word())];
        let fetched_before = fetched.1;
        of_kind.0 += attempt.opened_s * 1e9;
        for input in call.inputs.iter().filter(|input| known.insert((worker, **input))) {
            let bytes = record.contents[*input];
            of_kind.1 += bytes;
            if !own.contains(&(worker, *input)) {
                fetched.1 += bytes;
            }
        }
        if fetched.1 > fetched_before {
            fetched.0 += attempt.received_s * 1e9;
        }
        own.extend(call.answer.map(|answer| (worker, answer)));
    }
    let rate = |(time, bytes): (f64, u64)| if bytes > 0 { time / bytes as f64 } else { 0.0 };
    Rates { received: rate(fetched), opened: opened.map(rate) }
}
