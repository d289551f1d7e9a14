//! Rates of topics and their jitter, from journals: of a running pipeline, or of a session.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use serde_json::{Value, json};
use stillpoint_recorder::{Role, Session};
use stillpoint_samples::{Entry, RefKind};

use crate::attach::Attached;
use crate::exit::Failure;
use crate::journals::JournalTaps;

/// What was measured, as commands name it in JSON.
pub fn of_run(attached: &Attached) -> Value {
    json!({ "run": attached.pid, "pipeline": attached.graph.name })
}

/// The same for a session.
pub fn of_session(path: &Path) -> Value {
    json!({ "session": path.display().to_string() })
}

/// An operator, and the topics of its outputs by number.
pub type Sender = (String, Vec<String>);

/// The operators of a session that have a journal, with the topics of their inputs.
pub fn senders(session: &Session) -> Vec<(Sender, Vec<String>)> {
    let journals = session.topics().iter().filter_map(|t| match &t.role {
        Role::Journal { inputs, outputs } => Some(((t.operator.clone(), outputs.clone()), inputs.clone())),
        _ => None,
    });
    journals.collect()
}

/// When the samples of topics were sent.
#[derive(Debug, Default)]
pub struct Rates {
    senders: Vec<Sender>,
    topics: BTreeMap<String, Times>,
    /// Incarnation, stamp and outputs of the last entry of each operator, until it is known when they were sent.
    waiting: BTreeMap<usize, (u32, Vec<(String, u64)>)>,
}

/// Times of one topic.
#[derive(Debug, Default)]
struct Times {
    samples: u64,
    /// Samples of the first activation, which lie before the first interval.
    first: u64,
    /// Times of the activations, ns.
    stamps: Vec<u64>,
    /// When their outputs were sent, where the journal says so, ns.
    sent: Vec<u64>,
}

/// The rate of a topic.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rate {
    /// The topic.
    pub topic: String,
    /// Samples that were sent.
    pub samples: u64,
    /// Samples a second; none for fewer than two activations.
    pub rate_hz: Option<f64>,
    /// Time from one sending to the next; none for fewer than two.
    pub interval_ms: Option<Interval>,
}

/// Times from one sending to the next, ms.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// Mean.
    pub mean: f64,
    /// Standard deviation: the jitter.
    pub jitter: f64,
    /// The shortest.
    pub min: f64,
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// The longest.
    pub max: f64,
}

impl Rates {
    /// Before anything was sent.
    pub fn new(senders: Vec<Sender>) -> Self {
        let topics = senders.iter().flat_map(|(_, topics)| topics).map(|t| (t.clone(), Times::default()));
        Self { topics: topics.collect(), senders, waiting: BTreeMap::new() }
    }

    /// Of a session: all of it.
    pub fn of_session(session: &Session) -> Self {
        let mut rates = Self::new(senders(session).into_iter().map(|(sender, _)| sender).collect());
        for at in 0..rates.senders.len() {
            let entries = session.journals().get(&rates.senders[at].0);
            entries.into_iter().flatten().for_each(|entry| rates.enter(at, entry));
        }
        rates
    }

    /// Of a running pipeline, watched for a time or until a signal: of the operators for which `which` holds.
    pub fn of_run(
        attached: &Attached,
        time: Duration,
        which: impl Fn(&str) -> bool,
    ) -> Result<Self, Failure> {
        let taps = JournalTaps::open(attached, which)?;
        let senders = attached.graph.operators.iter();
        let mut rates = Self::new(
            senders.map(|o| (o.name.clone(), o.outputs.iter().map(|p| p.topic.clone()).collect())).collect(),
        );
        taps.watch(attached, time, &mut |operator, entry| rates.enter(operator, &entry))?;
        Ok(rates)
    }

    /// Takes an entry of the journal of an operator.
    fn enter(&mut self, at: usize, entry: &Entry) {
        let incarnation = entry.header.incarnation;
        if let Some((before, outputs)) = self.waiting.remove(&at)
            && before == incarnation
            && entry.body.sent_before > 0
        {
            for (topic, _) in outputs {
                self.topics.entry(topic).or_default().sent.push(entry.body.sent_before);
            }
        }
        let topics = &self.senders[at].1;
        let outputs: Vec<(String, u64)> = entry
            .refs_of(RefKind::Output)
            .filter(|r| r.count > 0)
            .filter_map(|r| Some((topics.get(r.port as usize)?.clone(), u64::from(r.count))))
            .collect();
        for (topic, count) in &outputs {
            let times = self.topics.entry(topic.clone()).or_default();
            if times.samples == 0 {
                times.first = *count;
            }
            times.samples += count;
            times.stamps.push(entry.header.stamp);
        }
        self.waiting.insert(at, (incarnation, outputs));
    }

    /// The rates of all topics, by name.
    pub fn rates(&self) -> Vec<Rate> {
        self.topics.iter().map(|(topic, times)| times.rate(topic)).collect()
    }
}

impl Times {
    fn rate(&self, topic: &str) -> Rate {
        // The last sending is not known yet.
        let is_known = self.sent.len() + 1 >= self.stamps.len() && self.sent.len() >= 2;
        let times = if is_known { &self.sent } else { &self.stamps };
        let seconds = match (self.stamps.first(), self.stamps.last()) {
            (Some(first), Some(last)) if last > first => Some((last - first) as f64 * 1e-9),
            _ => None,
        };
        Rate {
            topic: topic.to_owned(),
            samples: self.samples,
            rate_hz: seconds.map(|s| (self.samples - self.first) as f64 / s),
            interval_ms: Interval::of(times),
        }
    }
}

impl Interval {
    /// From times in rising order, ns; none for fewer than two.
    pub fn of(times: &[u64]) -> Option<Self> {
        let mut all: Vec<f64> = times.windows(2).map(|w| w[1].saturating_sub(w[0]) as f64 * 1e-6).collect();
        all.sort_by(f64::total_cmp);
        let (min, max) = (*all.first()?, *all.last()?);
        let count = all.len() as f64;
        let mean = all.iter().sum::<f64>() / count;
        let variance = all.iter().map(|i| (i - mean) * (i - mean)).sum::<f64>() / count;
        let quantile = |share: f64| all[((count * share).ceil() as usize).clamp(1, all.len()) - 1];
        Some(Self { mean, jitter: variance.sqrt(), min, p50: quantile(0.5), p99: quantile(0.99), max })
    }
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{Cause, Header, JournalBody, JournalRef};

    use super::*;

    fn entry(stamp: u64, sent_before: u64, count: u32) -> Entry {
        let header = Header { stamp, ..Header::default() };
        let body = JournalBody { cause: Cause::Timer as u32, sent_before, ..JournalBody::default() };
        let output = JournalRef { kind: RefKind::Output as u32, count, ..JournalRef::default() };
        Entry { header, body, refs: vec![output] }
    }

    #[test]
    fn a_rate_counts_samples_and_the_jitter_is_of_sendings() {
        let mut rates = Rates::new(vec![("a".to_owned(), vec!["a.x".to_owned(), "a.y".to_owned()])]);
        // Activations each 10 ms; their outputs leave 1, 3, 1, 3 ms later.
        let ms = 1_000_000;
        let mut before = 0;
        for i in 0..5u64 {
            rates.enter(0, &entry(i * 10 * ms, before, 2));
            before = (i * 10 + if i % 2 == 0 { 1 } else { 3 }) * ms;
        }
        let found = rates.rates();
        assert_eq!((found[0].topic.as_str(), found[0].samples), ("a.x", 10));
        assert!((found[0].rate_hz.unwrap_or(0.0) - 200.0).abs() < 1e-9);
        let interval = found[0].interval_ms.unwrap_or_else(|| panic!("there is one"));
        assert_eq!((interval.min, interval.max), (8.0, 12.0));
        assert!((interval.mean - 32.0 / 3.0).abs() < 1e-9 && (interval.jitter - 1.885_618).abs() < 1e-5);
        assert_eq!((found[1].samples, found[1].rate_hz, found[1].interval_ms), (0, None, None));
    }

    #[test]
    fn without_times_of_sending_the_activations_count() {
        let mut rates = Rates::new(vec![("a".to_owned(), vec!["a.x".to_owned()])]);
        (1..4).for_each(|i| rates.enter(0, &entry(i * 1_000_000, 0, 1)));
        let found = rates.rates();
        assert_eq!(found[0].interval_ms.map(|i| (i.min, i.max, i.jitter)), Some((1.0, 1.0, 0.0)));
    }
}
