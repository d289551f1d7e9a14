//! Facts of a session in words: how its recording ended, what a replay lacks, and the layout of its topics.

use stillpoint_operator::Registry;
use stillpoint_pipeline::session_files::SessionFiles;
use stillpoint_recorder::{Completeness, Session, Topic, TopicKind};

use crate::session_pipeline::pipeline_of;

/// Why a session is not complete: samples and entries that are missing, files that operators cannot read, and a pipeline
/// that `replay` refuses. Empty if it is complete.
pub fn gaps_of(session: &Session, registry: &Registry) -> Vec<String> {
    let refused = pipeline_of(session, registry).err().map(|reason| reason.to_string());
    gaps_with(session, refused.as_deref())
}

/// The same, given why the pipeline of the session is refused.
pub(crate) fn gaps_with(session: &Session, refused: Option<&str>) -> Vec<String> {
    let mut gaps: Vec<String> = match session.completeness() {
        Completeness::Complete => Vec::new(),
        Completeness::Gaps(gaps) => gaps.iter().map(ToString::to_string).collect(),
    };
    for (name, reason) in SessionFiles::of(session).lacking() {
        gaps.push(format!("{name}: {reason}; operators that read it cannot be replayed"));
    }
    gaps.extend(refused.map(|reason| format!("it cannot be replayed: {reason}")));
    gaps
}

/// How the recording ended, and what to do if it needs repair.
pub fn ending(session: &Session) -> String {
    let advice = if session.needs_mending() { "; repair it with `stillpoint recover`" } else { "" };
    format!("{}{advice}", session.ended())
}

/// How the layout of a topic relates to the layout of this build, if they differ.
pub fn layout(topic: &Topic) -> Option<String> {
    match &topic.kind {
        TopicKind::Known(_) | TopicKind::Opaque => None,
        TopicKind::Mapped { mapping, .. } if mapping.left_out().is_empty() => {
            Some("a different layout, mapped by field name".to_string())
        }
        TopicKind::Mapped { mapping, .. } => Some(format!(
            "a different layout, mapped by field name; omitted: {}",
            mapping.left_out().join(", ")
        )),
        TopicKind::Changed { difference, .. } => {
            Some(format!("a different layout that cannot be read: {difference}"))
        }
    }
}
