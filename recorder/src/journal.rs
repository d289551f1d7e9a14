//! Whether a journal can be what an operator wrote: an entry out of its sample, and the order of time.

use stillpoint_samples::{Cause, Entry, Journal, JournalRef, Pieces, RefKind, Sample};

/// The entry that a sample is, of an operator with so many inputs and outputs.
pub(crate) fn entry_of(sample: &[u8], inputs: usize, outputs: usize) -> Result<Entry, String> {
    let pieces = Pieces::split(Journal::KIND, sample).map_err(|e| e.to_string())?;
    let view = pieces.view::<Journal>().map_err(|e| e.to_string())?;
    let entry = Entry { header: view.header, body: *view.body, refs: view.elements.to_vec() };
    let Some(cause) = entry.cause() else {
        return Err(format!("no cause has the number {}", entry.body.cause));
    };
    if entry.outcome().is_none() {
        return Err(format!("no outcome has the number {}", entry.body.outcome));
    }
    let activates = !matches!(cause, Cause::Start | Cause::End);
    entry.refs.iter().try_for_each(|r| check(r, inputs, outputs, activates))?;
    Ok(entry)
}

/// An activation consumes one sample of an input; other entries only count what was consumed.
fn check(r: &JournalRef, inputs: usize, outputs: usize, activates: bool) -> Result<(), String> {
    let (side, ports) = match RefKind::from_number(r.kind) {
        None => return Err(format!("no reference has the number {}", r.kind)),
        Some(RefKind::Output) => ("output", outputs),
        Some(RefKind::Fresh | RefKind::Held) => ("input", inputs),
    };
    if r.port as usize >= ports {
        return Err(format!("it names {side} {}, and the operator has {ports}", r.port));
    }
    if side == "input" && r.count != u32::from(activates) {
        return Err(format!("it counts {} samples on input {}", r.count, r.port));
    }
    if r.first.checked_add(u64::from(r.count)).is_none() {
        return Err(format!("it numbers samples on {side} {} beyond what can be counted", r.port));
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
