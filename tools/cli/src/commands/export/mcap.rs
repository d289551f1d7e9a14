//! A smaller recording: some topics, some time. It holds what was chosen, so a replay of it has gaps.

use std::collections::BTreeMap;
use std::path::Path;

use stillpoint_pipeline::session::{IDENTITY, RUN};
use stillpoint_recorder::{
    Closing, Compression, Opening, PartWriter, Role, Session, TopicInfo, create_part, write_metadata,
};
use stillpoint_samples::Pieces;

use super::{Chosen, Written};
use crate::exit::Failure;

/// Metadata record of a recording that holds a part of a session.
const EXPORTED: &str = "stillpoint.export";

/// Writes the chosen samples into a folder, as a bag of rosbag2.
pub fn write(
    session: &Session,
    chosen: &Chosen,
    out: &Path,
    compression: Compression,
) -> Result<Vec<Written>, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::failed(format!("{}: {e}", out.display()));
    let mut metadata: BTreeMap<String, BTreeMap<String, String>> = session.metadata().clone();
    metadata.retain(|name, _| name == RUN || name == IDENTITY);
    let span = BTreeMap::from([
        ("from_ns".to_owned(), chosen.from.to_string()),
        ("before_ns".to_owned(), chosen.before.to_string()),
    ]);
    metadata.insert(EXPORTED.to_owned(), span);
    let opening = Opening {
        attachments: Vec::new(),
        metadata,
        frames: session.frames().to_vec(),
        clock: session.clock().first().copied(),
    };
    let (file, created) = create_part(out).map_err(|e| failed(&e))?;
    let mut part = PartWriter::new(created, compression, &opening).map_err(|e| failed(&e))?;
    let mut topics = BTreeMap::new();
    for (number, topic) in session.topics().iter().enumerate().filter(|(number, _)| chosen.topics[*number]) {
        let Some(kind) = topic.kind.kind() else { continue };
        let role = match &topic.role {
            // A journal with gaps on purpose would be taken for a damaged one.
            Role::Journal { .. } => Role::Computed,
            other => other.clone(),
        };
        let info = TopicInfo {
            name: topic.name.clone(),
            operator: topic.operator.clone(),
            kind,
            frame: topic.frame.clone(),
            role,
        };
        let id = part.add_topic(info).map_err(|e| failed(&e))?;
        topics.insert(number, (id, kind, topic.name.clone(), 0));
    }
    for recorded in session.samples() {
        let recorded = recorded.map_err(Failure::failed)?;
        let Some((id, kind, _, samples)) = topics.get_mut(&recorded.topic) else { continue };
        let pieces = Pieces::split(kind, &recorded.sample).map_err(Failure::failed)?;
        if chosen.is_in_time(pieces.header().stamp) {
            part.write(*id, pieces, recorded.log_time).map_err(|e| failed(&e))?;
            *samples += 1;
        }
    }
    part.finish(&Closing::default()).map_err(|e| failed(&e))?;
    let written = Session::open_any(out).map_err(Failure::failed)?;
    write_metadata(out, &written).map_err(|e| failed(&e))?;
    let of = |(_, (_, _, topic, samples))| Written { file: file.clone(), topic, samples, lines: 0 };
    Ok(topics.into_iter().map(of).collect())
}
