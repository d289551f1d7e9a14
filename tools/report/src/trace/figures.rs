//! Quantiles of the times of a path, and the hop to blame for the longest.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::follow::{self, End, Passage, PoseRole, Stop};
use super::journals::Journals;
use super::paths::{self, Path};
use crate::statistics::{Spread, quantile};

/// The longest passages that are looked into.
const WORST: usize = 10;

/// The figures of a path.
#[derive(Clone, Debug, Serialize)]
pub struct PathFigures {
    /// The topics from start to end.
    pub path: String,
    /// The topic at the start.
    pub from: String,
    /// The topic that leaves at the end, or the last operator.
    pub to: String,
    /// The operators.
    pub operators: Vec<String>,
    /// Samples of the first topic.
    pub samples: usize,
    /// Those that came to the end.
    pub arrived: usize,
    /// Where the others ended.
    pub lost: Vec<Lost>,
    /// From the acquisition to the last sending.
    pub total_ms: Spread,
    /// By operator.
    pub hops: Vec<HopFigures>,
    /// The samples that took longest, the longest first.
    pub worst: Vec<Worst>,
    /// What was to blame for them, the most frequent first.
    pub blame: Vec<Blame>,
}

/// Samples whose way ended at an operator.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Lost {
    /// The operator.
    pub operator: String,
    /// `not taken`, `nothing sent` or `unfinished` (the journal ends before).
    pub why: &'static str,
    /// How many.
    pub samples: usize,
}

/// The times at an operator of a path.
#[derive(Clone, Debug, Serialize)]
pub struct HopFigures {
    /// The operator.
    pub operator: String,
    /// From the arrival to the taking.
    pub wait_ms: Spread,
    /// From the activation to the sending of its outputs.
    pub step_ms: Spread,
    /// All parts that are not 0.
    pub parts_ms: BTreeMap<&'static str, Spread>,
    /// The laps of the step, in its order; empty where none were measured.
    pub laps: Vec<LapFigures>,
    /// From the acquisition to the sending.
    pub since_ms: Spread,
}

/// A lap of the steps of an operator.
#[derive(Clone, Debug, Serialize)]
pub struct LapFigures {
    /// Its name.
    pub lap: String,
    /// Its time.
    pub time_ms: Spread,
}

/// A sample that took long.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Worst {
    /// Its sequence at the source.
    pub sequence: u64,
    /// Incarnation of the source.
    pub incarnation: u32,
    /// When it was acquired, ns of session time.
    pub acquired_ns: u64,
    /// From the acquisition to the last sending.
    pub total_ms: f64,
    /// The operator that took the most beyond its median.
    pub operator: String,
    /// With which part of its time.
    pub part: PoseRole,
    /// How much beyond the median.
    pub beyond_ms: f64,
    /// Of a step: its lap that took the most beyond its median, where laps were measured.
    pub lap: Option<String>,
}

/// How often an operator was to blame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Blame {
    /// The operator.
    pub operator: String,
    /// The part of its time.
    pub part: PoseRole,
    /// Of how many of the longest.
    pub samples: usize,
}

impl Blame {
    /// The blame as text: `face: step (3)`.
    pub fn text(&self) -> String {
        format!("{}: {} ({})", self.operator, self.part.word(), self.samples)
    }
}

fn ms(ns: u64) -> f64 {
    ns as f64 * 1e-6
}

impl PathFigures {
    /// The figures of a path.
    pub fn of(journals: &Journals<'_>, path: &Path) -> Self {
        let operators: Vec<String> =
            path.hops.iter().map(|h| journals.operators[h.operator].stage.name.clone()).collect();
        let followed = follow::all(journals, path);
        let samples = followed.len();
        let mut ends: BTreeMap<End, usize> = BTreeMap::new();
        let mut passages = Vec::new();
        for one in followed {
            match one {
                Ok(passage) => passages.push(passage),
                Err(end) => *ends.entry(end).or_default() += 1,
            }
        }
        let lost = ends.into_iter().map(|(end, samples)| {
            let (hop, why) = match end {
                End::NotTaken(hop) => (hop, "not taken"),
                End::NothingSent(hop) => (hop, "nothing sent"),
                End::Unfinished(hop) => (hop, "unfinished"),
            };
            Lost { operator: operators[hop].clone(), why, samples }
        });
        let laps: Vec<HopLaps<'_>> = operators.iter().map(|o| HopLaps::of(journals, o)).collect();
        let worst = worst(&passages, &operators, &laps);
        Self {
            path: path.text(journals),
            from: path.from(journals),
            to: path.to(journals),
            samples,
            arrived: passages.len(),
            lost: lost.collect(),
            total_ms: Spread::of(passages.iter().map(|p| ms(p.total()))),
            hops: hops(&passages, &operators, &laps),
            blame: blame(&worst),
            worst,
            operators,
        }
    }
}

/// The laps of the operator of a hop.
struct HopLaps<'j>(Option<&'j BTreeMap<u64, Vec<(String, u64)>>>);

impl<'j> HopLaps<'j> {
    fn of(journals: &'j Journals<'_>, operator: &str) -> Self {
        Self(journals.laps.get(operator))
    }

    /// Of the activation that sent what follows from a sample; none where it was not measured.
    fn at(&self, stop: &Stop) -> &'j [(String, u64)] {
        let sender = stop.taken.saturating_add(stop.parts[PoseRole::Hold as usize]);
        self.0.and_then(|laps| laps.get(&sender)).map_or(&[], Vec::as_slice)
    }

    /// The figures of the laps over the passages through hop `at`.
    fn figures(&self, passages: &[Passage], at: usize) -> Vec<LapFigures> {
        let measured = || passages.iter().map(|p| self.at(&p.stops[at]));
        let Some(names) = measured().find(|laps| !laps.is_empty()) else { return Vec::new() };
        let figures = |(number, (lap, _)): (usize, &(String, u64))| LapFigures {
            lap: lap.clone(),
            time_ms: Spread::of(measured().filter_map(|laps| Some(ms(laps.get(number)?.1)))),
        };
        names.iter().enumerate().map(figures).collect()
    }

    /// The lap of a stop that is the most beyond its median, by the figures of all.
    fn blame(&self, stop: &Stop, figures: &[LapFigures]) -> Option<String> {
        let beyond = |(lap, of): &(&(String, u64), &LapFigures)| ms(lap.1) - of.time_ms.p50.unwrap_or(0.0);
        let both = self.at(stop).iter().zip(figures);
        both.max_by(|a, b| beyond(a).total_cmp(&beyond(b))).map(|((lap, _), _)| lap.clone())
    }
}

fn hops(passages: &[Passage], operators: &[String], laps: &[HopLaps<'_>]) -> Vec<HopFigures> {
    let hop = |(at, operator): (usize, &String)| {
        let of = |time: &dyn Fn(&Passage) -> u64| Spread::of(passages.iter().map(|p| ms(time(p))));
        let parts = PoseRole::ALL
            .iter()
            .filter(|part| passages.iter().any(|p| p.stops[at].parts[**part as usize] > 0));
        HopFigures {
            operator: operator.clone(),
            wait_ms: of(&|p| p.stops[at].taken.saturating_sub(p.stops[at].arrived)),
            step_ms: of(&|p| p.stops[at].parts[PoseRole::Step as usize]),
            parts_ms: parts.map(|part| (part.word(), of(&|p| p.stops[at].parts[*part as usize]))).collect(),
            laps: laps[at].figures(passages, at),
            since_ms: of(&|p| p.stops[at].sent.saturating_sub(p.acquired)),
        }
    };
    operators.iter().enumerate().map(hop).collect()
}

/// Medians of the parts at each operator of a path.
struct Medians(Vec<[f64; 7]>);

impl Medians {
    fn of(passages: &[Passage], operators: usize) -> Self {
        let median = |at: usize, part: usize| {
            let mut all: Vec<f64> = passages.iter().map(|p| ms(p.stops[at].parts[part])).collect();
            all.sort_by(f64::total_cmp);
            quantile(&all, 0.5).unwrap_or(0.0)
        };
        Self((0..operators).map(|at| std::array::from_fn(|part| median(at, part))).collect())
    }

    /// The operator of a passage and its part that is the most beyond the median, and how much, ms.
    fn blame(&self, passage: &Passage) -> (usize, PoseRole, f64) {
        let beyond = |at: usize, part: usize| ms(passage.stops[at].parts[part]) - self.0[at][part];
        let all = (0..self.0.len()).flat_map(|at| (0..PoseRole::ALL.len()).map(move |part| (at, part)));
        let most = all.max_by(|a, b| beyond(a.0, a.1).total_cmp(&beyond(b.0, b.1)));
        let (at, part) = most.unwrap_or((0, 0));
        (at, PoseRole::ALL[part], beyond(at, part))
    }

    /// The operator and the part whose median is the longest: what is to blame if all samples take long.
    fn longest(&self) -> (usize, PoseRole) {
        let all = (0..self.0.len()).flat_map(|at| (0..PoseRole::ALL.len()).map(move |part| (at, part)));
        let most = all.max_by(|a, b| self.0[a.0][a.1].total_cmp(&self.0[b.0][b.1]));
        let (at, part) = most.unwrap_or((0, 0));
        (at, PoseRole::ALL[part])
    }

    /// The time of a passage whose parts are all medians, ms.
    fn sum(&self) -> f64 {
        self.0.iter().flatten().sum()
    }
}

/// The longest passages with the part of a hop that is the most beyond its median.
fn worst(passages: &[Passage], operators: &[String], laps: &[HopLaps<'_>]) -> Vec<Worst> {
    let medians = Medians::of(passages, operators.len());
    let figures: Vec<_> = laps.iter().enumerate().map(|(at, of)| of.figures(passages, at)).collect();
    let mut longest: Vec<&Passage> = passages.iter().collect();
    longest.sort_by_key(|p| std::cmp::Reverse(p.total()));
    let one = |p: &&Passage| {
        let (at, part, beyond_ms) = medians.blame(p);
        Worst {
            sequence: p.sequence,
            incarnation: p.incarnation,
            acquired_ns: p.acquired,
            total_ms: ms(p.total()),
            operator: operators[at].clone(),
            part,
            beyond_ms,
            lap: laps[at].blame(&p.stops[at], &figures[at]).filter(|_| part == PoseRole::Step),
        }
    };
    longest.iter().take(WORST).map(one).collect()
}

/// A sample between two topics, by the path on which it arrived first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Judged {
    /// It arrived.
    Arrived {
        /// From the acquisition to the last sending, ns.
        total: u64,
        /// The operator that took the most beyond its median; if the sample took no longer than the median, the operator that
        /// takes the most.
        operator: String,
        /// With which part of its time.
        part: PoseRole,
    },
    /// No path took it to the end: this operator never took it.
    Lost {
        /// The operator.
        operator: String,
    },
}

/// Every sample between two topics, except those of which an operator made nothing, and those at the end of the journal;
/// `None` if a topic is not there.
pub fn passages_between(journals: &Journals<'_>, from: &str, to: &str) -> Option<Vec<Judged>> {
    let mut best: BTreeMap<usize, Judged> = BTreeMap::new();
    let (mut lost, mut open): (BTreeMap<usize, String>, BTreeSet<usize>) = Default::default();
    for path in paths::between(journals, from, to)? {
        let name = |at: usize| journals.operators[path.hops[at].operator].stage.name.clone();
        let followed = follow::all(journals, &path);
        let arrived: Vec<Passage> = followed.iter().filter_map(|f| f.clone().ok()).collect();
        let medians = Medians::of(&arrived, path.hops.len());
        let usual = medians.sum();
        // The samples of the first topic are the same for every path.
        for (number, one) in followed.into_iter().enumerate() {
            match one {
                Ok(passage) => {
                    let total = passage.total();
                    let (at, part) = match medians.blame(&passage) {
                        (at, part, beyond) if beyond > 0.0 && ms(total) > usual => (at, part),
                        _ => medians.longest(),
                    };
                    let is_better =
                        !matches!(best.get(&number), Some(Judged::Arrived { total: t, .. }) if *t <= total);
                    if is_better {
                        best.insert(number, Judged::Arrived { total, operator: name(at), part });
                    }
                }
                Err(End::NotTaken(at)) => drop(lost.insert(number, name(at))),
                Err(End::NothingSent(_) | End::Unfinished(_)) => drop(open.insert(number)),
            }
        }
    }
    for (number, operator) in lost {
        if !open.contains(&number) {
            best.entry(number).or_insert(Judged::Lost { operator });
        }
    }
    Some(best.into_values().collect())
}

fn blame(worst: &[Worst]) -> Vec<Blame> {
    let mut found: Vec<Blame> = Vec::new();
    // A sample that took no longer than usual blames nobody.
    for one in worst.iter().filter(|one| one.beyond_ms > 0.0) {
        match found.iter_mut().find(|b| b.operator == one.operator && b.part == one.part) {
            Some(blame) => blame.samples += 1,
            None => found.push(Blame { operator: one.operator.clone(), part: one.part, samples: 1 }),
        }
    }
    found.sort_by_key(|b| std::cmp::Reverse(b.samples));
    found
}
