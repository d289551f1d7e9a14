//! The session that a command reads.

use std::path::Path;

use stillpoint_recorder::{Session, SessionError};

use crate::exit::Failure;

/// A session that was opened, unless it is empty: a command about nothing does not end well.
pub fn with_topics(opened: Result<Session, SessionError>, path: &Path) -> Result<Session, Failure> {
    let session = opened.map_err(Failure::failed)?;
    match session.topics().is_empty() {
        true => Err(Failure::failed(format!("{}: it holds no topic", path.display()))),
        false => Ok(session),
    }
}
