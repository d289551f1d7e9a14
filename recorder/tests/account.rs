//! A session says of itself what it holds and what it lacks.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use std::sync::Arc;

use fixture::{START, Tee, cloud, entry, header, opening, pieces, pipeline, reference, topic};
use stillpoint_recorder::{
    Closing, Completeness, Compression, Ended, Gap, LEDGER_ATTACHMENT, Lost, PartWriter, Role, Session,
    SessionError, TopicKind, recover_session,
};
use stillpoint_samples::{Cause, Journal, JournalRef, PointCloud, RefKind, Sample};

/// A part with clouds of these numbers on `cam.cloud`, and what was noted as lost.
fn part(role: Role, numbers: &[u64], lost: &[(u64, u64)]) -> PartWriter<Vec<u8>> {
    let mut w = PartWriter::new(Vec::new(), Compression::Lz4, &opening()).unwrap();
    let id = w.add_topic(topic("cam.cloud", PointCloud::KIND, role)).unwrap();
    for n in numbers {
        w.write(id, pieces(PointCloud::KIND, &cloud(header(*n), 2, 2, &[1])), START).unwrap();
    }
    for (first, count) in lost {
        w.note_lost(id, 0, *first, *count, START).unwrap();
    }
    w
}

fn open(parts: Vec<Vec<u8>>) -> Session {
    Session::from_bytes(parts.into_iter().map(Arc::from)).unwrap()
}

fn ended(role: Role, numbers: &[u64], lost: &[(u64, u64)]) -> Session {
    open(vec![part(role, numbers, lost).finish(&Closing::default()).unwrap()])
}

fn lost(first: u64, count: u64) -> Lost {
    Lost { topic: "cam.cloud".into(), incarnation: 0, first, count }
}

#[test]
fn a_whole_session_is_complete_and_gives_back_all_it_was_given() {
    let session = open(vec![pipeline(Compression::Lz4, 12).0]);
    assert_eq!(session.completeness(), Completeness::Complete);
    assert_eq!(session.ended(), Ended::InOrder);
    assert_eq!(session.attachments()["pipeline.yaml"].bytes, opening().attachments[0].bytes);
    assert_eq!(session.attachments()[LEDGER_ATTACHMENT].bytes, b"{}");
    assert_eq!(session.metadata()["seeds"]["rig"], "7");
    assert_eq!(session.frames(), opening().frames);
    assert_eq!(session.clock(), [opening().clock.unwrap()]);
    assert_eq!(session.journals()["seg"].len(), 13);
    assert_eq!(session.topics()[1].samples, 12);
    assert_eq!(session.topics()[1].frame.as_deref(), Some("camera"));
}

#[test]
fn listed_losses_of_a_source_are_gaps() {
    let session = ended(Role::Source, &[0, 1, 4], &[(2, 2)]);
    assert_eq!(session.lost(), [lost(2, 2)]);
    assert_eq!(session.completeness(), Completeness::Gaps(vec![Gap::Lost(lost(2, 2))]));
}

/// A source whose journal says that it sent the numbers 0 to 9 in two activations, and that so many of them found no memory.
fn without_memory(unsent: u64, listed: &[(u64, u64)], numbers: &[u64]) -> Session {
    let mut w = part(Role::Source, numbers, listed);
    let role = Role::Journal { inputs: Vec::new(), outputs: vec!["cam.cloud".to_owned()] };
    let journal = w.add_topic(topic("cam.journal", Journal::KIND, role)).unwrap();
    for (n, cause, refs) in [
        (0, Cause::Start, vec![]),
        (1, Cause::Timer, vec![JournalRef { count: 5, total: 5, ..reference(RefKind::Output, 0, 0, 0) }]),
        (2, Cause::Timer, vec![JournalRef { count: 5, total: 10, ..reference(RefKind::Output, 0, 0, 5) }]),
        (
            3,
            Cause::End,
            vec![JournalRef { count: 0, total: 10, lost: unsent, ..reference(RefKind::Output, 0, 0, 10) }],
        ),
    ] {
        w.write(journal, pieces(Journal::KIND, &entry(header(n), n, cause, &refs)), START).unwrap();
    }
    open(vec![w.finish(&Closing::default()).unwrap()])
}

#[test]
fn samples_that_were_never_sent_are_no_gap_though_the_recorder_lists_their_numbers() {
    let numbers = [0, 1, 2, 5, 6, 7, 8, 9];
    for listed in [&[(3, 2)][..], &[(3, 1)], &[]] {
        assert_eq!(without_memory(2, listed, &numbers).completeness(), Completeness::Complete, "{listed:?}");
    }
    let Completeness::Gaps(gaps) = without_memory(1, &[(3, 2)], &numbers).completeness() else {
        panic!("one sample was sent and is not there")
    };
    assert_eq!(gaps, [Gap::Lost(lost(3, 2))]);
}

#[test]
fn unlisted_losses_of_a_source_are_gaps() {
    let session = ended(Role::Source, &[0, 1, 4, 5, 9], &[(6, 2)]);
    let expected = vec![Gap::Lost(lost(6, 2)), Gap::Unlisted(lost(2, 2)), Gap::Unlisted(lost(8, 1))];
    assert_eq!(session.completeness(), Completeness::Gaps(expected));
}

#[test]
fn losses_of_a_computed_topic_are_no_gaps() {
    assert_eq!(ended(Role::Computed, &[0, 4], &[(1, 2)]).completeness(), Completeness::Complete);
}

#[test]
fn a_footer_without_an_end_record_is_no_end() {
    let file = Arc::new(std::sync::Mutex::new(Vec::new()));
    drop(PartWriter::new(Tee(Arc::clone(&file)), Compression::Lz4, &opening()).unwrap());
    let bytes = file.lock().unwrap().clone();
    assert!(mcap::Summary::read(&bytes).unwrap().is_some(), "the file ends in a footer");
    assert!(matches!(open(vec![bytes]).ended(), Ended::Cut { .. }));
}

#[test]
fn a_recorder_that_died_goes_on_in_the_next_part() {
    let first = part(Role::Source, &[0, 1], &[]).finish(&Closing::default()).unwrap();
    let cut = first[..first.len() - 300].to_vec();
    let second = part(Role::Source, &[2, 3], &[]).finish(&Closing::default()).unwrap();
    let session = open(vec![cut, second]);
    assert_eq!(session.topics().len(), 1);
    assert_eq!(session.samples().count(), 4);
    assert_eq!(session.completeness(), Completeness::Complete);
}

/// A part of a recorder that died: all its samples were flushed.
fn cut(numbers: &[u64], noise: u8) -> Vec<u8> {
    let mut w = PartWriter::new(Vec::new(), Compression::Lz4, &opening()).unwrap();
    let id = w.add_topic(topic("cam.cloud", PointCloud::KIND, Role::Source)).unwrap();
    for n in numbers {
        w.write(id, pieces(PointCloud::KIND, &cloud(header(*n), 2, 2, &[noise])), START).unwrap();
    }
    w.flush().unwrap();
    let bytes = w.finish(&Closing::default()).unwrap();
    // The data ends with the metadata record that says so, which a recorder that dies does not write.
    let end = bytes.windows(14).position(|w| w == b"stillpoint.end").unwrap();
    bytes[..end - 13].to_vec()
}

#[test]
fn a_sample_that_the_next_part_holds_again_counts_once_and_is_mended_away() {
    let second = part(Role::Source, &[1, 2, 3], &[]).finish(&Closing::default()).unwrap();
    let session = open(vec![cut(&[0, 1, 2], 1), second.clone()]);
    assert_eq!(session.completeness(), Completeness::Complete);
    assert_eq!(session.topics()[0].samples, 4);
    let numbers: Vec<u64> = session.samples().map(|s| s.unwrap().sequence).collect();
    assert_eq!(numbers, [0, 1, 2, 3]);

    let folder = tempfile::tempdir().unwrap();
    let first = folder.path().join("part-000.mcap");
    std::fs::write(&first, cut(&[0, 1, 2], 1)).unwrap();
    std::fs::write(folder.path().join("part-001.mcap"), second).unwrap();
    recover_session(folder.path()).unwrap();
    assert_eq!(Session::open(&first).unwrap().samples().count(), 1);
    let mended = Session::open(folder.path()).unwrap();
    assert_eq!((mended.completeness(), mended.samples().count()), (Completeness::Complete, 4));
}

#[test]
fn a_sample_that_the_next_part_holds_with_other_bytes_is_damage() {
    let second = part(Role::Source, &[1, 2, 3], &[]).finish(&Closing::default()).unwrap();
    let session = open(vec![cut(&[0, 1, 2], 9), second]);
    let Completeness::Gaps(gaps) = session.completeness() else { panic!("two samples of one name") };
    let twice = gaps.iter().filter(|g| g.to_string().contains("incarnation 0, is there twice")).count();
    assert_eq!(twice, 2, "{gaps:?}");
}

#[test]
fn what_the_supervisor_states_is_a_gap() {
    let closing = Closing { gaps: vec!["the ledger does not balance".into()], ..Closing::default() };
    let session = open(vec![part(Role::Source, &[0], &[]).finish(&closing).unwrap()]);
    let expected = vec![Gap::Stated("the ledger does not balance".into())];
    assert_eq!(session.completeness(), Completeness::Gaps(expected));
}

#[test]
fn a_run_that_did_not_end_in_order_says_why() {
    let end = |facts: &[(&str, &str)]| {
        let facts = facts.iter().map(|(name, fact)| ((*name).to_owned(), (*fact).to_owned())).collect();
        let closing = Closing { facts, ..Closing::default() };
        open(vec![part(Role::Source, &[0], &[]).finish(&closing).unwrap()]).ended()
    };
    let early = |reason: &str| Ended::Early { reason: reason.into() };
    assert_eq!(end(&[("in_order", "true")]), Ended::InOrder);
    assert_eq!(end(&[("in_order", "false"), ("ended_early", "it fell over")]), early("it fell over"));
    assert_eq!(end(&[("in_order", "false")]), early("the run did not end in order"));
}

#[test]
fn another_layout_is_refused_with_the_fields_that_differ() {
    let bytes = part(Role::Source, &[0], &[]).finish(&Closing::default()).unwrap();
    // The topic's description stands uncompressed: `xyz` becomes `zyx` and the hash another.
    let hash = PointCloud::KIND.type_name();
    let other = format!("{}0", &hash[..hash.len() - 1]);
    assert_ne!(hash, other);
    let bytes = replace(&replace(&bytes, b"[3] xyz", b"[3] zyx"), hash.as_bytes(), other.as_bytes());
    let error = Session::from_bytes([Arc::from(bytes)]).unwrap_err();
    assert!(matches!(error, SessionError::Layout { .. }));
    let text = error.to_string();
    assert!(text.contains("`float32[3] zyx in m`") && text.contains("`float32[3] xyz in m`"), "{text}");
    assert!(text.contains("cam.cloud"), "{text}");
}

#[test]
fn an_unknown_kind_is_listed_and_has_no_samples() {
    let bytes = part(Role::Source, &[0], &[]).finish(&Closing::default()).unwrap();
    let session = open(vec![replace(&bytes, b"PointCloud@", b"PaintCloud@")]);
    assert_eq!(session.topics()[0].kind, TopicKind::Opaque);
    assert_eq!(session.topics()[0].samples, 1);
    assert_eq!(session.samples().count(), 0);
    let raw: Vec<_> = session.messages(|topic| topic == "cam.cloud").map(|m| m.unwrap()).collect();
    assert_eq!((raw.len(), raw[0].schema_name), (1, "sensor_msgs/msg/PointCloud2"));
}

fn replace(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut bytes = bytes.to_vec();
    let found: Vec<_> =
        bytes.windows(from.len()).enumerate().filter(|(_, w)| *w == from).map(|(i, _)| i).collect();
    assert!(!found.is_empty());
    for i in found {
        bytes[i..i + to.len()].copy_from_slice(to);
    }
    bytes
}
