//! Messages that are not what their channel promises, though no checksum says so.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use std::sync::Arc;

use stillpoint_recorder::{Completeness, Compression, Session, Source, recover, recover_session};
use stillpoint_samples::{Journal, Sample};

/// A file in which the entry of `seg` behind the middle says that it has more references than can be.
fn with_a_bad_entry() -> Vec<u8> {
    let (mut bytes, written) = fixture::pipeline(Compression::None, 25);
    let (_, entry) = written.iter().filter(|(topic, _)| topic == "seg.journal").nth(15).unwrap();
    let at = bytes.windows(entry.len()).position(|w| w == &entry[..]).unwrap();
    let length = at + Journal::KIND.meta_size() - 4;
    bytes[length..length + 4].fill(0xff);
    // A chunk whose checksum is 0 has none.
    let mut chunk = 8;
    while chunk < bytes.len() - 8 {
        let behind = chunk + 9 + u64::from_le_bytes(bytes[chunk + 1..chunk + 9].try_into().unwrap()) as usize;
        if bytes[chunk] == 6 && (chunk..behind).contains(&at) {
            bytes[chunk + 33..chunk + 37].fill(0);
        }
        chunk = behind;
    }
    bytes
}

#[test]
fn an_entry_that_cannot_be_read_is_damage_and_is_named() {
    let bytes = with_a_bad_entry();
    let session = Session::from_bytes([bytes.clone().into()]).unwrap();
    let whole = Session::from_bytes([fixture::pipeline(Compression::None, 25).0.into()]).unwrap();
    assert_eq!(session.journals()["seg"].len() + 1, whole.journals()["seg"].len());
    let Completeness::Gaps(gaps) = session.completeness() else { panic!("an entry is lost") };
    assert!(gaps.iter().any(|g| g.to_string().contains("sample 15 of `seg.journal`")), "{gaps:?}");
    // Mending leaves it out, and there is nothing more to mend then.
    let mended = recover(Source::Bytes(Arc::from(bytes)), Vec::new()).unwrap().0;
    let session = Session::from_bytes([mended.into()]).unwrap();
    assert!(!session.needs_mending());
    assert!(matches!(session.completeness(), Completeness::Gaps(_)));
}

#[test]
fn a_part_with_a_damaged_place_is_kept_beside_the_mended_one() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = with_a_bad_entry();
    std::fs::write(folder.path().join("part-000.mcap"), &bytes).unwrap();
    let (_, report) = recover_session(folder.path()).unwrap().pop().unwrap();
    assert_eq!(std::fs::read(report.retained.unwrap()).unwrap(), bytes);
}

#[test]
fn a_part_that_is_there_and_holds_nothing_is_not_called_missing() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("part-000.mcap"), b"1234567").unwrap();
    let message = Session::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains("part-000.mcap is there and holds nothing"), "{message}");
}
