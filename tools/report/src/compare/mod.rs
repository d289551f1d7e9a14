//! Two sessions, topic by topic and field by field: what differs first, by how much, and how it goes on.
//!
//! - `align`: which sample of one session belongs to which of the other
//! - `field`: the differences of one number of a topic
//! - `figures`: the figures at the end of both runs
//! - `pages`: the page with both runs in each chart

mod align;
mod field;
mod figures;
mod pages;

use std::collections::BTreeMap;

use serde::Serialize;
use stillpoint_operator::Registry;
use stillpoint_recorder::{Role, Session, SessionError};
use stillpoint_samples::{Journal, Pieces, Sample, SampleKind};

pub use align::{Alignment, Choice};
use align::{Key, Pairs};
use field::Fields;
pub use field::{FieldDifference, Trend};
pub use figures::Figure;
pub use pages::sections;

/// How two sessions differ.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The topics that both sessions hold.
    pub topics: Vec<TopicDifference>,
    /// Topics that only the first session, and only the second one, holds.
    pub only: [Vec<String>; 2],
    /// Topics that both hold and this build cannot read.
    pub unread: Vec<String>,
    /// The figures at the end of both runs, where either has one.
    pub figures: Vec<Figure>,
    /// The topic that differs first; of several at one time, the first one in the order of the session.
    pub first: Option<First>,
}

/// Where two sessions differ first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct First {
    /// The topic.
    pub topic: String,
    /// Session time, s.
    pub at_s: f64,
    /// The field; none where the sample is only in one session.
    pub field: Option<String>,
}

/// How a topic differs in two sessions.
#[derive(Clone, Debug, Serialize)]
pub struct TopicDifference {
    /// The topic.
    pub topic: String,
    /// Type of its samples.
    pub kind: &'static str,
    /// Whether all samples are the same, to the bit.
    pub identical: bool,
    /// Samples in each session.
    pub samples: [u64; 2],
    /// How samples of the two sessions are paired.
    pub alignment: Alignment,
    /// Pairs of samples.
    pub pairs: u64,
    /// Pairs whose bytes, header included, are not the same.
    pub differing: u64,
    /// Samples without a partner, in each session.
    pub alone: [u64; 2],
    /// Session time of the first difference, s.
    pub since_s: Option<f64>,
    /// The fields that differ.
    pub fields: Vec<FieldDifference>,
    /// The numbers of both runs over time, for charts.
    #[serde(skip)]
    pub curves: Vec<field::Curves>,
}

/// What is seen of one topic.
struct Seen {
    kind: &'static SampleKind,
    is_journal: bool,
    numbers: [usize; 2],
    pairs: Pairs,
    alignment: Alignment,
    keys: [Vec<Key>; 2],
    fields: Fields,
    compared: u64,
    differing: u64,
    since: Option<(u64, Option<String>)>,
}

/// Compares two sessions.
///
/// # Errors
/// A sample cannot be read.
pub fn of_sessions(
    sessions: [&Session; 2],
    choice: Choice,
    registry: &Registry,
) -> Result<Comparison, SessionError> {
    let [a, b] = sessions;
    let zero = [a, b].map(zero);
    let mut keys = [keys_of(a)?, keys_of(b)?];
    let (mut topics, mut only, mut unread): (BTreeMap<usize, Seen>, _, _) =
        (BTreeMap::new(), [vec![], vec![]], vec![]);
    for (number, topic) in a.topics().iter().enumerate().filter(|(_, t)| t.role != Role::Measured) {
        let Some(other) = b.topic_number(&topic.name) else {
            only[0].push(topic.name.clone());
            continue;
        };
        let (Some(kind), Some(theirs)) = (topic.kind.kind(), b.topics()[other].kind.kind()) else {
            unread.push(topic.name.clone());
            continue;
        };
        if *kind != *theirs {
            unread.push(topic.name.clone());
            continue;
        }
        let keys = [keys[0].remove(&number).unwrap_or_default(), keys[1].remove(&other).unwrap_or_default()];
        let is_journal = *kind == *Journal::KIND;
        let alignment = align::choose(&keys, zero, if is_journal { Choice::Sequence } else { choice });
        let pairs = Pairs::of(&keys, zero, alignment);
        topics.insert(
            number,
            Seen {
                kind,
                is_journal,
                numbers: [number, other],
                pairs,
                alignment,
                keys,
                fields: Fields::new(kind),
                compared: 0,
                differing: 0,
                since: None,
            },
        );
    }
    let known =
        |t: &&stillpoint_recorder::Topic| t.role != Role::Measured && a.topic_number(&t.name).is_none();
    only[1].extend(b.topics().iter().filter(known).map(|t| t.name.clone()));

    for recorded in a.samples_where(|t| t.role != Role::Measured) {
        let recorded = recorded?;
        let Some(seen) = topics.get_mut(&recorded.topic) else { continue };
        let key = (recorded.incarnation, recorded.sequence);
        let Some(partner) = seen.pairs.partner(key) else { continue };
        let first = Pieces::split(seen.kind, &recorded.sample).ok();
        let Some(first) = first else { continue };
        let at = first.header().stamp.saturating_sub(zero[0]);
        seen.compared += 1;
        let is_same =
            partner == key && b.holds(seen.numbers[1], partner.0, partner.1, &recorded.sample)? == Some(true);
        if is_same {
            if !seen.is_journal {
                seen.fields.same(at, first);
            }
            continue;
        }
        let Some(other) = b.sample(seen.numbers[1], partner.0, partner.1)? else { continue };
        let Ok(second) = Pieces::split(seen.kind, &other.sample) else { continue };
        let field = if seen.is_journal { None } else { seen.fields.compare(at, first, second) };
        seen.differing += 1;
        // Samples of two live runs never have the same times: what counts is what they say.
        if field.is_some() || zero[0] == zero[1] {
            let since = seen.since.get_or_insert((at, field.clone()));
            if since.0 == at && since.1.is_none() {
                since.1 = field;
            }
        }
    }
    let mut found: Vec<TopicDifference> = Vec::new();
    for (number, mut seen) in topics {
        for (side, zero) in zero.iter().enumerate() {
            for key in seen.pairs.alone(side, &seen.keys[side]) {
                let at = key.stamp.saturating_sub(*zero);
                if seen.since.as_ref().is_none_or(|(since, _)| at < *since) {
                    seen.since = Some((at, None));
                }
            }
        }
        let alone = [0, 1].map(|side| seen.pairs.alone(side, &seen.keys[side]).count() as u64);
        let (fields, curves) = seen.fields.finish();
        found.push(TopicDifference {
            topic: a.topics()[number].name.clone(),
            kind: seen.kind.name,
            identical: seen.differing == 0 && alone == [0, 0],
            samples: [0, 1].map(|side| seen.keys[side].len() as u64),
            alignment: seen.alignment,
            pairs: seen.compared,
            differing: seen.differing,
            alone,
            since_s: seen.since.as_ref().map(|(at, _)| *at as f64 * 1e-9),
            fields,
            curves,
        });
    }
    let first = first_of(&found);
    Ok(Comparison { first, topics: found, only, unread, figures: figures::of_sessions(sessions, registry) })
}

/// The first difference of all topics but journals.
fn first_of(topics: &[TopicDifference]) -> Option<First> {
    let ordinary = topics.iter().filter(|t| t.kind != Journal::NAME);
    let timed = ordinary.filter_map(|t| Some((t.since_s?, t)));
    let (at_s, topic) = timed.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    let field = topic.fields.iter().find(|f| f.since_s <= at_s).map(|f| f.field.clone());
    Some(First { topic: topic.topic.clone(), at_s, field })
}

impl Comparison {
    /// Whether all that both sessions hold is the same, and neither holds more.
    pub fn is_identical(&self) -> bool {
        self.topics.iter().all(|t| t.identical)
            && self.only.iter().all(Vec::is_empty)
            && self.unread.is_empty()
    }
}

/// The session time from which times are counted: when the first operator began; where no journal says so, the first
/// sample.
fn zero(session: &Session) -> u64 {
    let started = session.journals().values().filter_map(|j| j.first()).map(|e| e.header.stamp).min();
    started.or_else(|| session.clock().first().map(|c| c.logical_ns)).unwrap_or(0)
}

/// What names each sample, by topic, in the order of the topic.
fn keys_of(session: &Session) -> Result<BTreeMap<usize, Vec<Key>>, SessionError> {
    let mut keys: BTreeMap<usize, Vec<Key>> = BTreeMap::new();
    for recorded in session.samples_where(|t| t.role != Role::Measured) {
        let recorded = recorded?;
        let Some(kind) = session.topics()[recorded.topic].kind.kind() else { continue };
        let Ok(pieces) = Pieces::split(kind, &recorded.sample) else { continue };
        let header = pieces.header();
        keys.entry(recorded.topic).or_default().push(Key {
            incarnation: recorded.incarnation,
            sequence: recorded.sequence,
            stamp: header.stamp,
            origin: header.origin,
        });
    }
    keys.values_mut().for_each(|keys| keys.sort_by_key(|k| (k.incarnation, k.sequence)));
    Ok(keys)
}
