//! Whether everything that replay needs is in a session, and what is missing where not.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::PathBuf;

use stillpoint_samples::{Cause, Entry};

use crate::account::{DAMAGED_PLACES, END_RECORD, Lost, RECOVERED_RECORD};
use crate::ended::Ended;
use crate::journal::{outputs, times};
use crate::part::SessionPart;
use crate::session::Session;
use crate::topic::Role;

/// Whether a session says of itself that it is complete.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Completeness {
    /// Every source sample, every remote sample and the journal are there.
    Complete,
    /// They are not: why, never empty.
    Gaps(Vec<Gap>),
}

/// One reason why a session is not complete.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Gap {
    /// The recorder died.
    Cut {
        /// The last part.
        part: PathBuf,
        /// Where its last whole record ends, bytes.
        whole: u64,
        /// Bytes in the file.
        size: u64,
    },
    /// The recorder died, and the part was mended.
    Mended {
        /// The last part.
        part: PathBuf,
    },
    /// The recorder has not ended it yet.
    BeingRecorded {
        /// The part that it writes.
        part: PathBuf,
    },
    /// Another program recorded it.
    Foreign,
    /// Bytes are not what was written.
    Damaged {
        /// The part.
        part: PathBuf,
        /// Where, in bytes from the start of the file.
        offset: u64,
        /// Description of the fault.
        what: String,
    },
    /// Samples of a topic that replay needs, listed as lost by the recorder.
    Lost(Lost),
    /// Samples of a topic that replay needs, missing without being listed.
    Unlisted(Lost),
    /// What recorder or supervisor said at the end.
    Stated(String),
}

impl fmt::Display for Gap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cut { part, whole, size } => write!(
                f,
                "{}: the recorder died; {whole} of {size} bytes are whole records and no end of session follows",
                part.display()
            ),
            Self::Mended { part } => {
                write!(f, "{}: the recorder died; what it had not flushed is missing", part.display())
            }
            Self::BeingRecorded { part } => {
                write!(f, "{}: it is being recorded; what follows is not there yet", part.display())
            }
            Self::Foreign => {
                f.write_str("this is not a session of stillpoint: nothing says what should be there")
            }
            Self::Damaged { part, offset, what } => {
                write!(f, "{}: what is at offset {offset} is damaged: {what}", part.display())
            }
            Self::Lost(l) => write!(
                f,
                "`{}`, incarnation {}: {} samples from {} on were not recorded",
                l.topic, l.incarnation, l.count, l.first
            ),
            Self::Unlisted(l) => write!(
                f,
                "`{}`, incarnation {}: {} samples from {} on are missing and not listed as lost",
                l.topic, l.incarnation, l.count, l.first
            ),
            Self::Stated(text) => f.write_str(text),
        }
    }
}

impl Session {
    /// Whether everything that replay needs is there, and if not, what is missing.
    pub fn completeness(&self) -> Completeness {
        let gaps = gaps(self);
        if gaps.is_empty() { Completeness::Complete } else { Completeness::Gaps(gaps) }
    }
}

/// All that is missing.
fn gaps(session: &Session) -> Vec<Gap> {
    let mut gaps = Vec::new();
    gaps.extend(match session.ended() {
        Ended::InOrder | Ended::Early { .. } => None,
        Ended::BeingRecorded { part } => Some(Gap::BeingRecorded { part }),
        Ended::Cut { part, whole, size } => Some(Gap::Cut { part, whole, size }),
        Ended::Mended { part } => Some(Gap::Mended { part }),
        Ended::Foreign => Some(Gap::Foreign),
    });
    gaps.extend(open_ends(session));
    gaps.extend(session.journals().iter().filter_map(|(operator, entries)| {
        let what = times(entries).find_map(|(_, wrong)| wrong)?;
        Some(Gap::Stated(format!("`{operator}`: {what}")))
    }));
    for part in &session.parts {
        for d in &part.damage {
            gaps.push(Gap::Damaged { part: part.path.clone(), offset: d.offset, what: d.what.clone() });
        }
        gaps.extend(mended_damage(part));
    }
    for (name, value) in session.metadata().get(END_RECORD).into_iter().flatten() {
        if name.starts_with("gap.") {
            gaps.push(Gap::Stated(value.clone()));
        }
    }
    let required: BTreeSet<&str> =
        session.topics().iter().filter(|t| t.role.is_required()).map(|t| t.name.as_str()).collect();
    let mut listed: BTreeMap<(&str, u32), Vec<&Lost>> = BTreeMap::new();
    for lost in session.lost().iter().filter(|lost| required.contains(lost.topic.as_str())) {
        listed.entry((&lost.topic, lost.incarnation)).or_default().push(lost);
    }
    for (number, topic) in session.topics().iter().enumerate().filter(|(_, t)| t.role.is_required()) {
        let mut there: BTreeMap<u32, Vec<Range>> = BTreeMap::new();
        for (incarnation, sequence) in session.numbers(number) {
            push(there.entry(incarnation).or_default(), sequence);
        }
        let sent = sent(session, number);
        let with_losses =
            listed.keys().filter(|(name, _)| *name == topic.name).map(|(_, incarnation)| incarnation);
        let incarnations: BTreeSet<u32> =
            there.keys().chain(sent.keys()).chain(with_losses).copied().collect();
        for incarnation in incarnations {
            let mut known = there.remove(&incarnation).unwrap_or_default();
            let up_to = known.last().map_or(0, |r| r.end);
            let sent = sent.get(&incarnation);
            let expected = sent.map_or_else(|| vec![Range { first: 0, end: up_to }], |s| s.ranges.clone());
            let listed = listed.remove(&(topic.name.as_str(), incarnation)).unwrap_or_default();
            known.extend(
                listed.iter().map(|l| Range { first: l.first, end: l.first.saturating_add(l.count) }),
            );
            let missing = without(expected, known);
            let unlisted = missing.iter().map(|r| r.end - r.first);
            let count = listed.iter().map(|l| l.count).chain(unlisted).fold(0, u64::saturating_add);
            // The recorder lists each number that did not come. What was never sent is missing nowhere.
            if count <= sent.map_or(0, |s| s.no_memory) {
                continue;
            }
            gaps.extend(listed.into_iter().cloned().map(Gap::Lost));
            gaps.extend(missing.into_iter().map(|r| {
                Gap::Unlisted(Lost {
                    topic: topic.name.clone(),
                    incarnation,
                    first: r.first,
                    count: r.end - r.first,
                })
            }));
        }
    }
    gaps
}

/// What mending a part dropped for good: the mended part shows no damage any more.
fn mended_damage(part: &SessionPart) -> Option<Gap> {
    let records = part.scan.metadata.iter().filter(|(name, _)| name == RECOVERED_RECORD);
    let places = |entries: &BTreeMap<String, String>| entries.get(DAMAGED_PLACES)?.parse::<u64>().ok();
    let dropped: u64 = records.filter_map(|(_, entries)| places(entries)).fold(0, u64::saturating_add);
    let path = part.path.display();
    (dropped > 0).then(|| {
        Gap::Stated(format!(
            "{path}: {dropped} places were damaged when it was mended: what they held is lost"
        ))
    })
}

/// Incarnations that were over when the recording went on in the next part: nothing says whether entries followed the
/// last one that was kept.
fn open_ends(session: &Session) -> Vec<Gap> {
    let mut gaps = Vec::new();
    let earlier = session.parts.split_last().map_or(&[][..], |(_, earlier)| earlier);
    for (number, _) in earlier.iter().enumerate().filter(|(_, part)| !part.ended_in_order()) {
        for (topic, t) in session.topics().iter().enumerate() {
            if !matches!(t.role, Role::Journal { .. }) {
                continue;
            }
            let entries = || session.index.range((topic, 0, 0)..=(topic, u32::MAX, u64::MAX));
            let last = entries().rfind(|(_, place)| place.part as usize <= number);
            let next = entries().find(|(_, place)| place.part as usize > number);
            let begun = last.map_or(0, |((_, i, _), _)| i.saturating_add(1));
            if let Some((&(_, later, _), _)) = next.filter(|((_, i, _), _)| *i > begun) {
                gaps.push(Gap::Stated(format!(
                    "`{}`, incarnation {begun} to {}: entries may not have been recorded, since the recorder died",
                    t.name,
                    later - 1
                )));
            }
            let Some((&(_, incarnation, sequence), _)) = last else { continue };
            let goes_on = next.is_some_and(|((_, i, _), _)| *i == incarnation);
            let ended = session.journals().get(&t.operator).is_some_and(|entries| {
                let find = |e: &&Entry| (e.header.incarnation, e.header.sequence) == (incarnation, sequence);
                entries.iter().find(find).is_some_and(|e| e.cause() == Some(Cause::End))
            });
            if !goes_on && !ended {
                gaps.push(Gap::Stated(format!(
                    "`{}`, incarnation {incarnation}: entries behind number {sequence} may not have been recorded, since the \
                     recorder died",
                    t.name
                )));
            }
        }
    }
    gaps
}

/// Sequence numbers from `first` to before `end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Range {
    first: u64,
    end: u64,
}

/// Adds a number that is not below those before it.
fn push(ranges: &mut Vec<Range>, sequence: u64) {
    let end = sequence.saturating_add(1);
    match ranges.last_mut() {
        Some(last) if last.end == sequence => last.end = end,
        _ => ranges.push(Range { first: sequence, end }),
    }
}

/// What of `expected` no range of `known` covers.
fn without(mut expected: Vec<Range>, mut known: Vec<Range>) -> Vec<Range> {
    expected.sort();
    known.sort();
    let mut missing = Vec::new();
    let mut done = 0;
    let mut k = 0;
    for range in expected {
        let mut at = range.first.max(done);
        while at < range.end {
            while k < known.len() && known[k].end <= at {
                k += 1;
            }
            match known.get(k) {
                Some(next) if next.first <= at => at = next.end,
                next => {
                    let end = next.map_or(range.end, |n| n.first.min(range.end));
                    missing.push(Range { first: at, end });
                    at = end;
                }
            }
        }
        done = done.max(range.end);
    }
    missing
}

/// What the producer's journal says that it sent.
#[derive(Default)]
struct Sent {
    ranges: Vec<Range>,
    /// Samples that found no memory: they may be missing.
    no_memory: u64,
}

/// What was sent on a topic, by incarnation, as far as the journal of its producer tells. The outputs of the last
/// entry of an incarnation that did not end in order are left out: they may never have been sent.
fn sent(session: &Session, topic: usize) -> BTreeMap<u32, Sent> {
    let name = &session.topics()[topic].name;
    let operator = &session.topics()[topic].operator;
    let ports = session.topics().iter().find_map(|t| match &t.role {
        Role::Journal { outputs, .. } if t.operator == *operator => outputs.iter().position(|o| o == name),
        _ => None,
    });
    let mut by_incarnation: BTreeMap<u32, Sent> = BTreeMap::new();
    let (Some(port), Some(entries)) = (ports, session.journals().get(operator)) else {
        return by_incarnation;
    };
    for (i, entry) in entries.iter().enumerate() {
        let last = entries.get(i + 1).is_none_or(|next| next.header.incarnation != entry.header.incarnation);
        let sent = by_incarnation.entry(entry.header.incarnation).or_default();
        for r in outputs(entry, port) {
            // What found no memory is known once its activation is over: the next entry says so.
            sent.no_memory = sent.no_memory.max(r.lost);
            if last && entry.cause() != Some(Cause::End) {
                continue;
            }
            let end = r.first.saturating_add(u64::from(r.count));
            if r.count > 0 {
                sent.ranges.push(Range { first: r.first, end });
            }
        }
    }
    by_incarnation
}
