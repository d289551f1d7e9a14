//! Journal entries as samples in shared memory.

use stillpoint_samples::{Entry, Journal, Pieces, Sample};
use stillpoint_shm::Publisher;
use zerocopy::IntoBytes;

/// An entry out of the bytes of a journal sample.
pub fn entry_of(pieces: Pieces<'_>) -> Option<Entry> {
    let view = pieces.view::<Journal>().ok()?;
    Some(Entry { header: view.header, body: *view.body, refs: view.elements.to_vec() })
}

/// Publishes a journal entry. Without it an activation must not be seen.
pub fn publish_entry(journal: &Publisher, entry: &Entry) -> Result<(), String> {
    let loan = journal.loan(entry.refs.len()).map_err(|e| e.to_string())?;
    let mut loan = loan.ok_or("the journal's memory is used up: somebody holds its samples")?;
    let (meta, payload) = loan.parts_mut();
    debug_assert_eq!(meta.len(), Journal::KIND.meta_size());
    let (header, body) = meta.split_at_mut(stillpoint_samples::HEADER_SIZE);
    header.copy_from_slice(entry.header.as_bytes());
    body.copy_from_slice(entry.body.as_bytes());
    let refs = entry.refs.as_bytes();
    payload[..refs.len()].copy_from_slice(refs);
    journal.send(loan).map(drop).map_err(|e| e.to_string())
}
