//! Replay: the journal's schedule. Every operator is run again from what it consumed, and what it sends is compared.
//!
//! Each operator is fed recorded samples, so that a difference is named where it arises and damage stays where it is.
//! By induction this equals the closed loop.
//!
//! - `difference`: which field of which sample differs, and by how much
//! - `journal`: the entries of all operators in the order of time, and their gaps
//! - `orphans`: recorded samples that no activation made
//! - `replayer`: does activations again and compares what they send
//! - `report`: how a replay went
//! - `selection`: which operators are compared, and which must run for that

mod difference;
pub(crate) mod journal;
mod orphans;
pub(crate) mod replayer;
mod report;
pub(crate) mod selection;

use std::collections::BTreeMap;
use std::sync::Arc;

use stillpoint_recorder::{Completeness, Gap, Role as TopicRole, Session};

pub use difference::Difference;
use journal::Ordered;
use replayer::Replayer;
pub use report::{Open, ReplayError, ReplayReport};
pub use selection::Selection;
use selection::{needed, selected};

use crate::graph::Graph;
use crate::operator::Files;
use crate::schedule::Observer;

/// Replays a session of this graph. `observer` sees every entry with the outputs as they were made again.
pub fn replay(
    session: &Session,
    graph: &Arc<Graph>,
    files: &dyn Files,
    selection: &Selection,
    observer: &mut dyn Observer,
) -> Result<ReplayReport, ReplayError> {
    let compared = selected(graph, selection)?;
    let run = needed(session, graph, &compared);
    let ordered = Ordered::new(session, graph);
    let seconds = ordered.seconds();
    let mut replayer = Replayer::new(session, graph, files, compared.clone(), run);
    for (operator, entry, gap) in ordered.entries() {
        replayer.enter(operator, entry, gap, observer)?;
    }
    for orphan in orphans::of_session(session, graph, &compared) {
        replayer.differ(orphan);
    }
    let measured = session.topics().iter().filter(|t| t.role == TopicRole::Measured);
    let measured = measured.map(|t| (t.name.clone(), t.samples)).collect();
    let gaps = match session.completeness() {
        Completeness::Complete => Vec::new(),
        Completeness::Gaps(gaps) => gaps,
    };
    let report = replayer.report();
    let missing = missing(session, &gaps, &report.recomputed);
    let gaps = gaps.iter().map(ToString::to_string).collect();
    let not_compared = session.other_channels().into_iter().map(str::to_owned).collect();
    Ok(ReplayReport { seconds, gaps, measured, missing, not_compared, ..report })
}

/// By recorded topic: samples that the recorder lost or that had to be made again.
fn missing(session: &Session, gaps: &[Gap], recomputed: &BTreeMap<String, u64>) -> BTreeMap<String, u64> {
    let mut listed: BTreeMap<String, u64> = BTreeMap::new();
    let unlisted =
        gaps.iter().filter_map(|gap| if let Gap::Unlisted(lost) = gap { Some(lost) } else { None });
    for lost in session.lost().iter().chain(unlisted) {
        let count = listed.entry(lost.topic.clone()).or_default();
        *count = count.saturating_add(lost.count);
    }
    for (topic, rerun) in recomputed {
        if session.topic_number(topic).is_some() {
            let known = listed.entry(topic.clone()).or_default();
            *known = (*known).max(*rerun);
        }
    }
    listed
}
