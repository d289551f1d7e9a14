//! The topics that a session keeps.

use serde::Serialize;
use stillpoint_recorder::{Role, TopicKind};

use crate::ReportError;
use crate::numbers::{count, fixed, megabytes};
use crate::page::{Block, Cell, Section, Table};
use crate::source::Source;

#[derive(Serialize)]
struct TopicsFigures {
    topics: Vec<RecordedTopic>,
}

#[derive(Serialize)]
struct RecordedTopic {
    topic: String,
    kind: String,
    frame: Option<String>,
    role: &'static str,
    samples: u64,
    rate_hz: f64,
    bytes: u64,
}

pub fn section(from: &Source<'_>) -> Result<Section, ReportError> {
    let recording = &from.recording;
    let seconds = recording.length();
    let topics = recording.session.topics().iter().map(|t| RecordedTopic {
        topic: t.name.clone(),
        kind: match &t.kind {
            TopicKind::Known(kind) => kind.name.to_owned(),
            TopicKind::Mapped { ours, .. } => {
                format!("{} in a different layout, mapped by field name", ours.name)
            }
            TopicKind::Changed { ours, .. } => format!("{} in a different layout, not read", ours.name),
            TopicKind::Opaque => format!("{}: type unknown to this build", t.type_name),
        },
        frame: t.frame.clone(),
        role: match t.role {
            Role::Journal { .. } => "journal",
            Role::Source => "source",
            Role::Computed => "computed",
            Role::Measured => "measured",
        },
        samples: t.samples,
        rate_hz: if seconds > 0.0 { t.samples as f64 / seconds } else { 0.0 },
        bytes: t.bytes,
    });
    let figures = TopicsFigures { topics: topics.collect() };
    let mut table = Table::new(
        "Sizes are before compression. A replay needs the sources and the journals; it computes all other topics.",
        &["topic", "kind", "frame", "role", "samples", "Hz", "size"],
    );
    for t in &figures.topics {
        table.row([
            Cell::text(&t.topic),
            Cell::text(&t.kind),
            Cell::text(t.frame.as_deref().unwrap_or("")),
            Cell::text(t.role),
            Cell::number(count(t.samples)),
            Cell::number(fixed(t.rate_hz, 1)),
            Cell::number(megabytes(t.bytes)),
        ]);
    }
    Ok(Section::new("topics", "Topics", &figures)?.with(Block::Table(table)))
}
