//! Keeps a run that happens in this process as a session: simulated, lock-step or replayed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use stillpoint_recorder::{Closing, Compression, Opening, PartWriter, TopicId, create_part, create_session};
use stillpoint_samples::Entry;
use zerocopy::IntoBytes;

use crate::graph::Graph;
use crate::schedule::Witness;
use crate::session::topic_infos;
use crate::shelf::Parcel;

/// Makes the folder of a new session, or says what stands in the way and what to do.
pub fn create_folder(session: &Path) -> Result<(), String> {
    create_session(session).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists if session.symlink_metadata().is_ok() => format!(
            "{}: it is there already, and a session is never written over; name a folder that is not there",
            session.display()
        ),
        _ => refused(session, &e),
    })
}

/// What is said where a session cannot be written.
pub(crate) fn refused(place: &Path, e: &std::io::Error) -> String {
    format!("{}: {e}; choose another folder with --record", place.display())
}

/// A session that is written as the run goes on. Its log times are the stamps, so that two equal runs give equal files.
pub struct Keeper {
    part: PartWriter<std::fs::File>,
    path: PathBuf,
    /// By operator: its journal, and each output that is kept.
    topics: Vec<(Option<TopicId>, BTreeMap<usize, TopicId>)>,
    scratch: stillpoint_samples::AlignedBytes,
    last: u64,
}

impl Keeper {
    /// Begins a session in a new folder.
    pub fn create(session: &Path, graph: &Graph, opening: &Opening) -> Result<Self, String> {
        Self::create_with(session, graph, opening, Compression::Lz4)
    }

    /// Begins a session in a new folder, compressed so.
    pub fn create_with(
        session: &Path,
        graph: &Graph,
        opening: &Opening,
        compression: Compression,
    ) -> Result<Self, String> {
        create_folder(session)?;
        let (path, file) = create_part(session).map_err(|e| refused(session, &e))?;
        let mut part = PartWriter::new(file, compression, opening).map_err(|e| e.to_string())?;
        let mut topics = vec![(None, BTreeMap::new()); graph.operators.len()];
        for (info, (operator, port)) in topic_infos(graph) {
            let id = part.add_topic(info).map_err(|e| e.to_string())?;
            match port {
                None => topics[operator].0 = Some(id),
                Some(port) => {
                    topics[operator].1.insert(port, id);
                }
            }
        }
        let scratch = stillpoint_samples::AlignedBytes::default();
        Ok(Self { part, path, topics, scratch, last: 0 })
    }

    /// Ends the session in order, with its ledger as JSON. Gives the file.
    pub fn finish(self, ledger: Option<String>) -> Result<PathBuf, String> {
        self.close(ledger, BTreeMap::from([("in_order".to_string(), "true".to_string())]))
    }

    /// Ends the session of a run that ended before its time, and says why.
    pub fn finish_early(self, ledger: Option<String>, reason: &str) -> Result<PathBuf, String> {
        let facts = [("in_order", "false"), ("ended_early", reason)];
        self.close(ledger, facts.map(|(name, fact)| (name.to_string(), fact.to_string())).into())
    }

    fn close(self, ledger: Option<String>, facts: BTreeMap<String, String>) -> Result<PathBuf, String> {
        let closing = Closing {
            ledger: ledger.map(String::into_bytes),
            gaps: Vec::new(),
            facts,
            realtime_ns: self.last,
        };
        self.part.finish(&closing).map_err(|e| e.to_string())?;
        Ok(self.path)
    }
}

impl Witness for Keeper {
    fn saw(&mut self, operator: usize, entry: &Entry, outputs: &[(usize, Parcel)]) -> Result<(), String> {
        let stamp = entry.head.stamp;
        self.last = self.last.max(stamp);
        let (journal, kept) = &self.topics[operator];
        if let Some(journal) = journal {
            let (head, body, refs) = (entry.head.as_bytes(), entry.body.as_bytes(), entry.refs.as_bytes());
            let meta = head.len() + body.len();
            self.scratch.resize(meta + refs.len());
            self.scratch[..head.len()].copy_from_slice(head);
            self.scratch[head.len()..meta].copy_from_slice(body);
            self.scratch[meta..].copy_from_slice(refs);
            let (meta, payload) = self.scratch.split_at(meta);
            let pieces = stillpoint_samples::Pieces { meta, payload };
            self.part.write(*journal, pieces, stamp).map_err(|e| e.to_string())?;
        }
        for (port, parcel) in outputs {
            if let Some(topic) = kept.get(port) {
                self.part.write(*topic, parcel.pieces(), stamp).map_err(|e| e.to_string())?;
            }
        }
        Ok(())
    }
}
