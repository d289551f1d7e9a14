//! Journal entries as samples in shared memory.

use stillpoint_samples::{Entry, Journal, Pieces, Sample};
use stillpoint_shm::{Publisher, ShmError};
use zerocopy::IntoBytes;

/// An entry out of the bytes of a journal sample.
pub fn entry_of(pieces: Pieces<'_>) -> Option<Entry> {
    let view = pieces.view::<Journal>().ok()?;
    Some(Entry { header: view.header, body: *view.body, refs: view.elements.to_vec() })
}

/// Why a journal entry could not be published.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// Shared memory.
    #[error(transparent)]
    Shm(#[from] ShmError),
    /// No buffer is free.
    #[error("the journal's memory is used up: another process holds its samples")]
    Full,
}

/// Publishes a journal entry. Without it an activation must not be seen.
pub fn publish_entry(journal: &Publisher, entry: &Entry) -> Result<(), PublishError> {
    let loan = journal.loan(entry.refs.len())?;
    let mut loan = loan.ok_or(PublishError::Full)?;
    let (meta, payload) = loan.parts_mut();
    debug_assert_eq!(meta.len(), Journal::KIND.meta_size());
    let (header, body) = meta.split_at_mut(stillpoint_samples::HEADER_SIZE);
    header.copy_from_slice(entry.header.as_bytes());
    body.copy_from_slice(entry.body.as_bytes());
    let refs = entry.refs.as_bytes();
    payload[..refs.len()].copy_from_slice(refs);
    Ok(journal.send(loan).map(drop)?)
}
