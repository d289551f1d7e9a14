//! The files that parameters name, as a session keeps them.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};
use stillpoint_operator::files::{Files, FilesError, listed};
use stillpoint_recorder::Session;

use crate::session::{FILES, HASHES, hex};

/// The files that a session kept when it began. One that was lost or changed since stands in its folder as before, but
/// cannot be read.
#[derive(Clone, Debug, Default)]
pub struct SessionFiles {
    files: BTreeMap<String, Result<Vec<u8>, &'static str>>,
}

impl SessionFiles {
    /// The files among the attachments of a session, held against the hashes that its metadata says.
    pub fn of(session: &Session) -> Self {
        let mut files: BTreeMap<String, Result<Vec<u8>, &'static str>> = session
            .attachments()
            .iter()
            .filter_map(|(name, a)| Some((name.strip_prefix(FILES)?.to_string(), Ok(a.bytes.clone()))))
            .collect();
        for (name, hash) in session.metadata().get(HASHES).into_iter().flatten() {
            let wrong = match files.get(name) {
                Some(Ok(bytes)) if hex(&Sha256::digest(bytes)) == *hash => continue,
                Some(_) => "the bytes of this file in the session are not those that were recorded",
                None => "the session lacks this file",
            };
            files.insert(name.clone(), Err(wrong));
        }
        Self { files }
    }

    /// The files that cannot be read, with the reason.
    pub fn lacking(&self) -> impl Iterator<Item = (&str, &str)> {
        self.files.iter().filter_map(|(name, file)| Some((name.as_str(), *file.as_ref().err()?)))
    }
}

impl Files for SessionFiles {
    fn read(&self, name: &str) -> Result<Vec<u8>, FilesError> {
        let file = self.files.get(name).cloned();
        file.unwrap_or(Err("the session does not keep this file")).map_err(FilesError::Unavailable)
    }

    fn list(&self, name: &str) -> Result<Vec<String>, FilesError> {
        listed(&self.files, name).ok_or(FilesError::Unavailable("the session does not keep it"))
    }
}
