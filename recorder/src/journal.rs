//! Whether a journal can be what an operator wrote: an entry out of its sample, and the order of time.

use stillpoint_samples::{BytesError, Cause, Entry, Journal, JournalRef, Pieces, RefKind, Sample};

/// Why a sample is not an entry of a journal.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum JournalFault {
    #[error(transparent)]
    Bytes(#[from] BytesError),
    #[error("no {what} has the number {number}")]
    Unknown { what: &'static str, number: u32 },
    #[error("it names {side} {port}, and the operator has {ports}")]
    Port { side: &'static str, port: u32, ports: usize },
    #[error("it counts {count} samples on input {port}")]
    Count { count: u32, port: u32 },
    #[error("it numbers samples on {side} {port} beyond what can be counted")]
    Sequence { side: &'static str, port: u32 },
}

/// The entry that a sample is, of an operator with so many inputs and outputs.
pub(crate) fn entry_of(sample: &[u8], inputs: usize, outputs: usize) -> Result<Entry, JournalFault> {
    let pieces = Pieces::split(Journal::KIND, sample)?;
    let view = pieces.view::<Journal>()?;
    let entry = Entry { header: view.header, body: *view.body, refs: view.elements.to_vec() };
    let Some(cause) = entry.cause() else {
        return Err(JournalFault::Unknown { what: "cause", number: entry.body.cause });
    };
    if entry.outcome().is_none() {
        return Err(JournalFault::Unknown { what: "outcome", number: entry.body.outcome });
    }
    let activates = !matches!(cause, Cause::Start | Cause::End);
    entry.refs.iter().try_for_each(|r| check(r, inputs, outputs, activates))?;
    Ok(entry)
}

/// An activation consumes one sample of an input; other entries only count what was consumed.
fn check(r: &JournalRef, inputs: usize, outputs: usize, activates: bool) -> Result<(), JournalFault> {
    let (port, count) = (r.port, r.count);
    let (side, ports) = match RefKind::from_number(r.kind) {
        None => return Err(JournalFault::Unknown { what: "reference", number: r.kind }),
        Some(RefKind::Output) => ("output", outputs),
        Some(RefKind::Fresh | RefKind::Held) => ("input", inputs),
    };
    if port as usize >= ports {
        return Err(JournalFault::Port { side, port, ports });
    }
    if side == "input" && count != u32::from(activates) {
        return Err(JournalFault::Count { count, port });
    }
    if r.first.checked_add(u64::from(count)).is_none() {
        return Err(JournalFault::Sequence { side, port });
    }
    Ok(())
}

/// The time of each entry of a journal, which never goes back, and what is wrong with an entry whose stamp would have it do
/// so. Such an entry has the nearest time that it can have.
pub fn times(journal: &[Entry]) -> impl Iterator<Item = (u64, Option<String>)> {
    let mut before = 0;
    journal.iter().enumerate().map(move |(i, entry)| {
        let stamp = entry.header.stamp;
        // One behind it that is too early is wrong itself.
        let next = journal.get(i + 1).map(|next| next.header.stamp).filter(|next| *next >= before);
        let time = stamp.min(next.unwrap_or(u64::MAX)).max(before);
        before = time;
        let sequence = entry.header.sequence;
        let what =
            || format!("its journal is damaged: the time of entry {sequence} is not between its neighbours'");
        (time, (time != stamp).then(what))
    })
}

/// The references of an entry to what it sent on an output.
pub(crate) fn outputs(entry: &Entry, port: usize) -> impl Iterator<Item = &JournalRef> {
    entry.refs_of(RefKind::Output).filter(move |r| r.port as usize == port)
}
