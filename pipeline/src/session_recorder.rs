//! Keeps a run that happens in this process as a session: simulated, lock-step or replayed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use stillpoint_recorder::{
    Closing, Compression, Opening, PartWriter, TopicId, WriteError, create_part, create_session,
    session_parts,
};
use stillpoint_samples::Entry;
use zerocopy::IntoBytes;

use crate::graph::Graph;
use crate::limits::named;
use crate::sample_store::OwnedSample;
use crate::schedule::{Observer, ObserverError};
use crate::session::topic_infos;

/// Makes the folder of a new session, or says what stands in the way and what to do.
pub fn create_folder(session: &Path) -> Result<(), SessionError> {
    create_session(session).map_err(|reason| {
        let place = session.to_path_buf();
        match reason.kind() {
            std::io::ErrorKind::AlreadyExists if session.symlink_metadata().is_ok() => {
                SessionError::Exists { place }
            }
            _ => SessionError::Refused { place, reason },
        }
    })
}

/// Removes the session of a run that did not begin: nothing was recorded. What else stands in its folder stays.
pub fn remove_folder(session: &Path) {
    for part in session_parts(session).unwrap_or_default() {
        let _ = std::fs::remove_file(part);
    }
    let _ = std::fs::remove_dir(session);
}

/// Why a session cannot be begun, written or ended.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// There is something of this name already.
    #[error(
        "{}: it is there already, and a session is never written over; name a folder that is not there",
        place.display()
    )]
    Exists {
        /// The folder of the session.
        place: PathBuf,
    },
    /// The system refuses to create the folder or a part, or to write a part to the disk.
    #[error("{}: {reason}; choose another folder with --record", place.display())]
    Refused {
        /// The folder, or the part.
        place: PathBuf,
        /// What the system says.
        reason: std::io::Error,
    },
    /// A part takes no more.
    #[error("{}: {reason}{}; make room, or choose another folder with --record", part.display(), named(reason))]
    NoRoom {
        /// The part.
        part: PathBuf,
        /// What the system says.
        reason: WriteError,
    },
    /// An activation could not be written, for this reason, so what followed it is missing, too.
    #[error("{0}")]
    Earlier(String),
}

impl SessionError {
    pub(crate) fn refused(place: &Path, reason: std::io::Error) -> Self {
        Self::Refused { place: place.to_path_buf(), reason }
    }

    pub(crate) fn no_room(part: &Path, reason: WriteError) -> Self {
        Self::NoRoom { part: part.to_path_buf(), reason }
    }
}

/// A session that is written during a run. Its log times are the stamps, so that two equal runs give equal files.
pub struct SessionRecorder {
    part: PartWriter<std::fs::File>,
    path: PathBuf,
    /// By operator: its journal, and each output that is kept.
    topics: Vec<(Option<TopicId>, BTreeMap<usize, TopicId>)>,
    scratch: stillpoint_samples::AlignedBytes,
    last: u64,
    /// The first reason why something could not be written: what is written after it fails by it.
    refused: Option<String>,
}

impl SessionRecorder {
    /// Begins a session in a new folder.
    pub fn create(
        session: &Path,
        graph: &Graph,
        opening: &Opening,
        compression: Compression,
    ) -> Result<Self, SessionError> {
        create_folder(session)?;
        Self::open(session, graph, opening, compression).inspect_err(|_| remove_folder(session))
    }

    fn open(
        session: &Path,
        graph: &Graph,
        opening: &Opening,
        compression: Compression,
    ) -> Result<Self, SessionError> {
        let (path, file) = create_part(session).map_err(|e| SessionError::refused(session, e))?;
        let mut part =
            PartWriter::new(file, compression, opening).map_err(|e| SessionError::no_room(&path, e))?;
        let mut topics = vec![(None, BTreeMap::new()); graph.operators.len()];
        for (info, (operator, port)) in topic_infos(graph) {
            let id = part.add_topic(info).map_err(|e| SessionError::no_room(&path, e))?;
            match port {
                None => topics[operator].0 = Some(id),
                Some(port) => {
                    topics[operator].1.insert(port, id);
                }
            }
        }
        let scratch = stillpoint_samples::AlignedBytes::default();
        Ok(Self { part, path, topics, scratch, last: 0, refused: None })
    }

    /// Ends the session in order, with its ledger as JSON. Gives the file.
    pub fn finish(self, ledger: Option<String>) -> Result<PathBuf, SessionError> {
        self.close(ledger, end_facts(None))
    }

    /// Ends the session of a run that ended before its time, and says why.
    pub fn finish_early(self, ledger: Option<String>, reason: &str) -> Result<PathBuf, SessionError> {
        self.close(ledger, end_facts(Some(reason)))
    }

    fn close(self, ledger: Option<String>, facts: BTreeMap<String, String>) -> Result<PathBuf, SessionError> {
        let closing = Closing {
            ledger: ledger.map(String::into_bytes),
            gaps: Vec::new(),
            facts,
            realtime_ns: self.last,
        };
        match (self.part.finish(&closing), self.refused) {
            (Ok(_), None) => Ok(self.path),
            (_, Some(first)) => Err(SessionError::Earlier(first)),
            (Err(e), None) => Err(SessionError::no_room(&self.path, e)),
        }
    }

    fn write(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), WriteError> {
        let stamp = entry.header.stamp;
        self.last = self.last.max(stamp);
        let (journal, retained) = &self.topics[operator];
        if let Some(journal) = journal {
            let (header, body, refs) =
                (entry.header.as_bytes(), entry.body.as_bytes(), entry.refs.as_bytes());
            let meta = header.len() + body.len();
            self.scratch.resize(meta + refs.len());
            self.scratch[..header.len()].copy_from_slice(header);
            self.scratch[header.len()..meta].copy_from_slice(body);
            self.scratch[meta..].copy_from_slice(refs);
            let (meta, payload) = self.scratch.split_at(meta);
            self.part.write(*journal, stillpoint_samples::Pieces { meta, payload }, stamp)?;
        }
        for (port, owned) in outputs {
            if let Some(topic) = retained.get(port) {
                self.part.write(*topic, owned.pieces(), stamp)?;
            }
        }
        Ok(())
    }
}

/// What the end of a session says of the end of its run: why that was early, if it was.
pub(crate) fn end_facts(early: Option<&str>) -> BTreeMap<String, String> {
    let in_order = ("in_order".to_string(), early.is_none().to_string());
    let reason = early.map(|reason| ("ended_early".to_string(), reason.to_string()));
    reason.into_iter().chain([in_order]).collect()
}

impl Observer for SessionRecorder {
    fn on_activation(
        &mut self,
        operator: usize,
        entry: &Entry,
        outputs: &[(usize, OwnedSample)],
    ) -> Result<(), ObserverError> {
        self.write(operator, entry, outputs).map_err(|e| {
            let message = SessionError::no_room(&self.path, e).to_string();
            ObserverError::Failed(self.refused.get_or_insert(message).clone())
        })
    }
}
