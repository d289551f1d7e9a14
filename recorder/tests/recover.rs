//! A file cut at any byte is mended into one that standard readers open, and keeps what is consistent.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use std::collections::BTreeSet;
use std::sync::Arc;

use fixture::{Written, pipeline, samples};
use stillpoint_recorder::{
    Completeness, Compression, Ended, Gap, RecoverError, Report, Session, SessionError, Source, create_part,
    create_session, recover, recover_session,
};

fn mend(bytes: &[u8]) -> (Vec<u8>, Report) {
    recover(Source::Bytes(Arc::from(bytes)), Vec::new()).unwrap()
}

/// Opens a file as any MCAP tool does, by its summary and by its messages.
fn opens_in_the_ordinary_reader(bytes: &[u8]) -> usize {
    let summary = mcap::Summary::read(bytes).unwrap().expect("a summary");
    let messages = mcap::MessageStream::new(bytes).unwrap().inspect(|m| assert!(m.is_ok())).count();
    assert_eq!(summary.stats.unwrap().message_count, messages as u64);
    messages
}

/// No output without its entry, no entry without its inputs, nothing that was not written.
fn is_consistent(found: &Written, written: &Written) {
    let named = |samples: &Written, topic: &str| -> Vec<u64> {
        let of_topic = samples.iter().filter(|(name, _)| name == topic);
        of_topic.map(|(_, s)| u64::from_le_bytes(s[16..24].try_into().unwrap())).collect()
    };
    for s in found {
        assert!(written.contains(s), "a sample on {} that was never written", s.0);
    }
    let set = |topic: &str| named(found, topic).into_iter().collect::<BTreeSet<_>>();
    assert!(set("cam.image").is_subset(&set("cam.journal")));
    assert!(set("seg.cloud").is_subset(&set("seg.journal")));
    let n = written.iter().filter(|(name, _)| name == "seg.cloud").count() as u64;
    assert!(set("seg.journal").into_iter().filter(|i| *i < n).all(|i| set("cam.image").contains(&i)));
}

/// Where the records of a file start, those in chunks left out.
fn boundaries(bytes: &[u8]) -> Vec<usize> {
    let mut at = 8;
    let mut found = vec![at];
    while at + 9 <= bytes.len() - 8 {
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        found.push(at);
    }
    found
}

#[test]
fn a_file_cut_at_every_record_boundary_is_mended() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let (bytes, written) = pipeline(compression, 25);
        let boundaries = boundaries(&bytes);
        assert!(boundaries.len() > 20);
        for at in boundaries {
            let (mended, report) = mend(&bytes[..at]);
            assert_eq!(opens_in_the_ordinary_reader(&mended) as u64, report.messages);
            is_consistent(&samples(&mended), &written);
        }
    }
}

#[test]
fn a_file_cut_at_any_byte_is_mended() {
    for compression in [Compression::None, Compression::Lz4] {
        let (bytes, written) = pipeline(compression, 25);
        for at in (8..bytes.len()).step_by(97).chain(bytes.len() - 40..bytes.len()) {
            let (mended, report) = mend(&bytes[..at]);
            assert_eq!(opens_in_the_ordinary_reader(&mended) as u64, report.messages, "cut at {at}");
            is_consistent(&samples(&mended), &written);
        }
    }
}

#[test]
fn all_that_was_flushed_survives() {
    let (bytes, written) = pipeline(Compression::Lz4, 25);
    // The first chunk is the opening's; the two behind it were flushed after ten activations each.
    let chunks: Vec<_> = boundaries(&bytes).into_iter().filter(|at| bytes.get(*at) == Some(&6)).collect();
    let (mended, report) = mend(&bytes[..chunks[3]]);
    assert_eq!(samples(&mended), written[..80]);
    assert_eq!(report.attachments, 1);
    assert_eq!(report.damage, [""; 0]);
}

#[test]
fn mending_what_is_whole_drops_nothing_and_keeps_the_end() {
    let (bytes, written) = pipeline(Compression::Lz4, 25);
    let (mended, report) = mend(&bytes);
    assert_eq!(samples(&mended), written);
    assert_eq!((report.entries_dropped, report.outputs_dropped, report.bytes_cut), (0, 0, 0));
    assert_eq!(Session::from_bytes([mended.into()]).unwrap().ended(), Ended::InOrder);
}

#[test]
fn a_mended_file_is_not_said_to_have_ended_in_order() {
    let (bytes, _) = pipeline(Compression::Lz4, 25);
    let (mended, _) = mend(&bytes[..bytes.len() / 2]);
    let session = Session::from_bytes([mended.into()]).unwrap();
    assert_eq!(session.ended(), Ended::Mended { part: "part-000.mcap".into() });
    assert!(!session.needs_mending());
    assert!(session.metadata().contains_key("stillpoint.recovered"));
    let Completeness::Gaps(gaps) = session.completeness() else { panic!("nothing says what followed") };
    assert_eq!(gaps[0], Gap::Mended { part: "part-000.mcap".into() });
}

#[test]
fn a_part_that_is_being_written_is_not_mended_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session");
    create_session(&path).unwrap();
    let (bytes, _) = pipeline(Compression::Lz4, 25);
    let (part, mut file) = create_part(&path).unwrap();
    let error = recover_session(&path).unwrap_err();
    assert!(matches!(error, RecoverError::BeingRecorded { .. }) && part.exists(), "{error}");
    std::io::Write::write_all(&mut file, &bytes[..bytes.len() / 2]).unwrap();
    for named in [&path, &part] {
        let error = recover_session(named).unwrap_err();
        assert!(error.to_string().contains("still being recorded"), "{error}");
        let session = Session::open(named).unwrap();
        assert_eq!(session.ended(), Ended::BeingRecorded { part: part.clone() });
        assert!(!session.needs_mending());
        let Completeness::Gaps(gaps) = session.completeness() else { panic!("it goes on") };
        assert_eq!(gaps[0], Gap::BeingRecorded { part: part.clone() });
    }
    drop(file);
    let session = Session::open(&path).unwrap();
    assert!(matches!(session.ended(), Ended::Cut { .. }) && session.needs_mending());
    assert_eq!(recover_session(&path).unwrap().len(), 1);
}

#[test]
fn a_damaged_length_takes_nothing_away_for_good() {
    let folder = tempfile::tempdir().unwrap();
    let part = folder.path().join("part-000.mcap");
    let (bytes, _) = pipeline(Compression::None, 200);
    let chunks: Vec<_> = boundaries(&bytes).into_iter().filter(|at| bytes.get(*at) == Some(&6)).collect();
    let mut damaged = bytes.clone();
    damaged[chunks[2] + 6] ^= 1;
    std::fs::write(&part, &damaged).unwrap();
    let (_, report) = recover_session(folder.path()).unwrap().pop().unwrap();
    assert!(report.bytes_cut > bytes.len() as u64 / 2, "{report}");
    let retained = folder.path().join("part-000.mcap.damaged");
    assert_eq!(report.retained.as_ref(), Some(&retained));
    assert!(report.to_string().ends_with(&format!("is stored as {}", retained.display())), "{report}");
    assert_eq!(std::fs::read(&retained).unwrap(), damaged);
    opens_in_the_ordinary_reader(&std::fs::read(&part).unwrap());
    // Once more: what was kept is not written over.
    std::fs::write(&part, &damaged).unwrap();
    let repeated = recover_session(folder.path()).unwrap().pop().unwrap().1.retained.unwrap();
    assert_eq!(repeated, folder.path().join("part-000.mcap.damaged-1"));
    // A kill leaves less behind than a chunk: that is dropped.
    std::fs::write(&part, &bytes[..chunks[3] + 5000]).unwrap();
    assert_eq!(recover_session(folder.path()).unwrap().pop().unwrap().1.retained, None);
}

#[test]
fn what_another_program_recorded_has_no_end_and_is_mended_only_where_it_is_cut() {
    let mut w = mcap::Writer::new(std::io::Cursor::new(Vec::new())).unwrap();
    let channel = w.add_channel(0, "/odom", "cdr", &Default::default()).unwrap();
    let header =
        mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time: 1, publish_time: 1 };
    w.write_to_known_channel(&header, &[7; 100]).unwrap();
    w.finish().unwrap();
    let bytes = w.into_inner().into_inner();
    let whole = Session::from_bytes([Arc::from(&bytes[..])]).unwrap();
    assert_eq!(whole.completeness(), Completeness::Gaps(vec![Gap::Foreign]));
    assert_eq!((whole.ended(), whole.needs_mending()), (Ended::Foreign, false));
    let cut = Session::from_bytes([Arc::from(&bytes[..bytes.len() - 20])]).unwrap();
    assert_eq!((cut.ended(), cut.needs_mending()), (Ended::Foreign, true));
    let mended = Session::from_bytes([mend(&bytes[..bytes.len() - 20]).0.into()]).unwrap();
    assert_eq!((mended.ended(), mended.needs_mending()), (Ended::Foreign, false));
}

#[test]
fn a_damaged_file_that_was_mended_does_not_call_itself_complete() {
    let (bytes, _) = pipeline(Compression::None, 25);
    let mut damaged = bytes.clone();
    // In the middle of the records of a chunk that says of no channel what it is.
    let chunks: Vec<_> = boundaries(&bytes).into_iter().filter(|at| bytes.get(*at) == Some(&6)).collect();
    damaged[chunks[2] + 2000] ^= 1;
    let (mended, report) = mend(&damaged);
    assert_eq!(report.damage.len(), 1, "{report}");
    let repeated = mend(&mended).0;
    for file in [mended, repeated] {
        let session = Session::from_bytes([file.into()]).unwrap();
        let Completeness::Gaps(gaps) = session.completeness() else { panic!("it lacks what was damaged") };
        assert!(gaps.iter().any(|g| g.to_string().contains("1 places were damaged")), "{gaps:?}");
    }
}

#[test]
fn a_damaged_chunk_takes_no_channel_with_it_where_the_summary_is_there() {
    let (bytes, written) = pipeline(Compression::Lz4, 25);
    let chunks: Vec<_> = boundaries(&bytes).into_iter().filter(|at| bytes.get(*at) == Some(&6)).collect();
    for chunk in &chunks[..2] {
        let mut damaged = bytes.clone();
        damaged[chunk + 200] ^= 1;
        let session = Session::from_bytes([damaged.clone().into()]).unwrap();
        let retained = session.samples().count();
        assert!(
            retained >= written.len() / 3 && retained <= written.len(),
            "{retained} of {}",
            written.len()
        );
        let (mended, report) = mend(&damaged);
        assert_eq!(report.damage.len(), 1, "{report}");
        assert_eq!(samples(&mended).len(), retained);
        opens_in_the_ordinary_reader(&mended);
    }
}

#[test]
fn outputs_ahead_of_their_journal_and_entries_ahead_of_their_inputs_are_dropped_and_counted() {
    use fixture::{cloud, depth, entry, header, opening, pieces, reference, sample, topic};
    use stillpoint_recorder::{PartWriter, Role};
    use stillpoint_samples::{Cause, DepthImage, Journal, PointCloud, Pose, RefKind, Sample};
    let file = Arc::new(std::sync::Mutex::new(Vec::new()));
    let mut w = PartWriter::new(fixture::Tee(Arc::clone(&file)), Compression::Lz4, &opening()).unwrap();
    let journal = |inputs: &[&str], outputs: &[&str]| Role::Journal {
        inputs: inputs.iter().map(|s| (*s).to_owned()).collect(),
        outputs: outputs.iter().map(|s| (*s).to_owned()).collect(),
    };
    let image = w.add_topic(topic("cam.image", DepthImage::KIND, Role::Source)).unwrap();
    let clouds = w.add_topic(topic("seg.cloud", PointCloud::KIND, Role::Computed)).unwrap();
    let cam = w.add_topic(topic("cam.journal", Journal::KIND, journal(&[], &["cam.image"]))).unwrap();
    let poses = w.add_topic(topic("seg.pose", Pose::KIND, Role::Computed)).unwrap();
    let others = w.add_topic(topic("rig.truth", Pose::KIND, Role::Source)).unwrap();
    let outputs = ["seg.cloud", "seg.pose"];
    let seg = w.add_topic(topic("seg.journal", Journal::KIND, journal(&["cam.image"], &outputs))).unwrap();
    for i in 0..6 {
        if i < 4 {
            let bytes = entry(header(i), i, Cause::Timer, &[reference(RefKind::Output, 0, 0, i)]);
            w.write(cam, pieces(Journal::KIND, &bytes), 0).unwrap();
        }
        if i < 3 || i == 5 {
            w.write(image, pieces(DepthImage::KIND, &depth(header(i), 2, 2, 1.0, &[1])), 0).unwrap();
        }
        let refs = [(RefKind::Fresh, 0), (RefKind::Output, 0), (RefKind::Output, 1)];
        let refs = refs.map(|(kind, port)| reference(kind, port, 0, i));
        w.write(seg, pieces(Journal::KIND, &entry(header(i), i, Cause::Input, &refs)), 0).unwrap();
        w.write(clouds, pieces(PointCloud::KIND, &cloud(header(i), 2, 2, &[1])), 0).unwrap();
        for topic in [poses, others] {
            w.write(topic, pieces(Pose::KIND, &sample(Pose::KIND, header(i), &[1])), 0).unwrap();
        }
    }
    w.flush().unwrap();
    let cut = file.lock().unwrap().clone();
    let (mended, report) = mend(&cut);
    // Image 5 has no entry of the camera; without it, entries 3, 4 and 5 lack their input, and clouds and poses 3, 4 and
    // 5 their entry.
    assert_eq!((report.entries_dropped, report.outputs_dropped), (3, 7), "{report}");
    let on = |topic: &str| {
        mcap::MessageStream::new(&mended)
            .unwrap()
            .filter(|m| m.as_ref().unwrap().channel.topic == topic)
            .count()
    };
    let retained = ["/seg/pose", "/seg/pose/stamped", "/rig/truth", "/rig/truth/stamped", "/tf"].map(on);
    assert_eq!(retained, [3, 3, 6, 6, 9], "transforms go with their poses");
}

#[test]
fn a_session_is_mended_in_place_and_opens_as_before() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session");
    create_session(&path).unwrap();
    let (bytes, _) = pipeline(Compression::Lz4, 25);
    let (part, mut file) = create_part(&path).unwrap();
    std::io::Write::write_all(&mut file, &bytes[..bytes.len() / 2]).unwrap();
    drop(file);
    let before = Session::open(&path).unwrap().samples().count();
    let mended = recover_session(&path).unwrap();
    assert_eq!(mended.len(), 1);
    assert_eq!(mended[0].0, part);
    let after = Session::open(&path).unwrap().samples().count() as u64;
    assert_eq!(after + mended[0].1.entries_dropped + mended[0].1.outputs_dropped, before as u64);
    opens_in_the_ordinary_reader(&std::fs::read(&part).unwrap());
    assert!(recover_session(&path).unwrap().is_empty(), "mending again finds nothing to do");
    use std::os::unix::fs::PermissionsExt;
    assert_eq!(std::fs::metadata(&part).unwrap().permissions().mode() & 0o777, 0o600);
    assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o700);
}

#[test]
fn what_is_no_mcap_file_is_refused() {
    let error = recover(Source::Bytes(Arc::from(&b"#!/bin/sh\n"[..])), Vec::new()).unwrap_err();
    assert!(matches!(error, RecoverError::Session(SessionError::NotMcap { .. })));
}

#[test]
fn a_part_in_which_nothing_stands_hides_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let (bytes, _) = pipeline(Compression::Lz4, 3);
    std::fs::write(folder.path().join("part-000.mcap"), &bytes).unwrap();
    std::fs::write(folder.path().join("part-001.mcap"), []).unwrap();
    let before = Session::open(folder.path()).unwrap().samples().count();
    assert!(before > 0);
    stillpoint_recorder::recover_session(folder.path()).unwrap();
    assert!(!folder.path().join("part-001.mcap").exists());
    assert_eq!(Session::open(folder.path()).unwrap().samples().count(), before);
}
