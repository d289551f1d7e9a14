//! Facts of a session in words: how its recording ended, and the layout of its topics.

use stillpoint_recorder::{Session, Topic, TopicKind};

/// How the recording ended, and what to do where it is to be mended.
pub fn ending(session: &Session) -> String {
    let advice = if session.needs_mending() { "; mend it with `stillpoint recover`" } else { "" };
    format!("{}{advice}", session.ended())
}

/// How the layout of a topic stands to this build's, where it is another.
pub fn layout(topic: &Topic) -> Option<String> {
    match &topic.kind {
        TopicKind::Known(_) | TopicKind::Opaque => None,
        TopicKind::Mapped { mapping, .. } if mapping.left_out().is_empty() => {
            Some("another layout, mapped by name".to_string())
        }
        TopicKind::Mapped { mapping, .. } => {
            Some(format!("another layout, mapped by name; left out: {}", mapping.left_out().join(", ")))
        }
        TopicKind::Changed { difference, .. } => Some(format!("another layout, not read: {difference}")),
    }
}
