//! How long steps take in session time.

use std::collections::BTreeMap;

use stillpoint_samples::{Cause, Entry};

use crate::graph::OperatorNode;

/// How long steps take in session time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Latencies {
    /// As the pipeline declares.
    #[default]
    Declared,
    /// As a session measured, by operator; an operator that it did not measure takes its declared time.
    Measured(BTreeMap<String, Measured>),
}

/// The times of one operator's steps: when each began, ns of session time, and how long it took, ns.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Measured(Vec<(u64, u64)>);

impl Measured {
    /// The times that an operator's journal holds: from an activation to the sending of its outputs. An entry says when
    /// the outputs of the entry before were sent, so the last one of an incarnation is not known.
    pub fn of(journal: &[Entry]) -> Self {
        let pairs = journal.windows(2).filter_map(|pair| {
            let [entry, next] = pair else { return None };
            let (began, sent) = (entry.header.stamp, next.body.sent_before);
            let is_known = entry.header.incarnation == next.header.incarnation
                && entry.header.sequence.checked_add(1) == Some(next.header.sequence)
                && entry.cause().is_some_and(|cause| !matches!(cause, Cause::Start | Cause::End))
                && (began..=next.header.stamp).contains(&sent);
            is_known.then(|| (began, sent - began))
        });
        let mut times: Vec<_> = pairs.collect();
        times.sort_unstable();
        Self(times)
    }

    /// Whether nothing is known.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// What a step that begins at `time` takes: as long as the last step before it, or the first one after.
    fn at(&self, time: u64) -> Option<u64> {
        let before = self.0.partition_point(|(began, _)| *began <= time);
        self.0.get(before.saturating_sub(1)).map(|(_, took)| *took)
    }
}

impl Latencies {
    /// How long a step of an operator takes that begins at `time`, ns.
    pub fn of(&self, node: &OperatorNode, time: u64) -> u64 {
        match self {
            Self::Declared => node.latency,
            Self::Measured(all) => {
                all.get(&node.name).and_then(|measured| measured.at(time)).unwrap_or(node.latency)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use stillpoint_samples::{Header, JournalBody, Outcome};

    use super::*;

    fn entry(sequence: u64, stamp: u64, sent_before: u64, cause: Cause) -> Entry {
        Entry {
            header: Header { stamp, origin: stamp, sequence, incarnation: 0, count: 0 },
            body: JournalBody {
                sent_before,
                cause: cause as u32,
                outcome: Outcome::Done as u32,
                ..JournalBody::default()
            },
            refs: Vec::new(),
        }
    }

    #[test]
    fn a_step_takes_as_long_as_the_last_one_that_was_measured_before_it() {
        let journal = [
            entry(0, 0, 0, Cause::Start),
            entry(1, 100, 0, Cause::Timer),
            entry(2, 200, 130, Cause::Timer),
            entry(3, 300, 260, Cause::Timer),
            entry(4, 400, 0, Cause::End),
        ];
        let measured = Measured::of(&journal);
        assert_eq!([0, 100, 199, 200, 5000].map(|t| measured.at(t)), [30, 30, 30, 60, 60].map(Some));
    }

    #[test]
    fn a_time_that_cannot_be_is_not_taken() {
        // Sent before the activation, after the next one, and behind a gap.
        let journal = [
            entry(0, 100, 0, Cause::Timer),
            entry(1, 200, 90, Cause::Timer),
            entry(2, 300, 900, Cause::Timer),
            entry(4, 400, 310, Cause::Timer),
            entry(5, 500, u64::MAX, Cause::Timer),
        ];
        assert!(Measured::of(&journal).is_empty());
        assert_eq!(Measured::default().at(7), None);
    }
}
