use std::collections::BTreeMap;

use stillpoint_samples::{Cause, Entry, Header, JournalBody, JournalRef, RefKind};

use super::*;
use crate::wiring::Stage;

const MS: u64 = 1_000_000;

/// An entry: its stamp and origin in ms, its cause, the sample that it takes on input 0, the sample that it sends on output
/// 0, and when the outputs of the entry before were sent.
fn entry(
    (stamp, origin): (u64, u64),
    cause: Cause,
    (taken, kind): (Option<u64>, RefKind),
    sent: Option<u64>,
    sent_before: u64,
) -> Entry {
    let reference = |first: u64, kind: RefKind| JournalRef {
        first,
        count: 1,
        kind: kind as u32,
        ..JournalRef::default()
    };
    let mut refs: Vec<JournalRef> = taken.into_iter().map(|s| reference(s, kind)).collect();
    refs.extend(sent.map(|s| reference(s, RefKind::Output)));
    let body = JournalBody {
        cause: cause as u32,
        nominal: stamp / 20 * 20 * MS,
        sent_before: sent_before * MS,
        ..JournalBody::default()
    };
    Entry { header: Header { stamp: stamp * MS, origin: origin * MS, ..Header::default() }, body, refs }
}

fn stage(name: &str, inputs: &[&str], outputs: &[&str]) -> Stage {
    let topics = |names: &[&str]| names.iter().map(|t| t.to_string()).collect();
    Stage { name: name.into(), inputs: topics(inputs), outputs: topics(outputs) }
}

/// A camera each 100 ms whose image is 5 ms old; a face that steps for 10 ms, once for 60 ms, and leaves one image out; a law
/// with a timer of 20 ms.
fn camera() -> Vec<Entry> {
    let image = |i: u64| {
        let before = if i == 0 { 0 } else { (i - 1) * 100 + 11 };
        entry((10 + i * 100, 5 + i * 100), Cause::Timer, (None, RefKind::Fresh), Some(i), before)
    };
    (0..5).map(image).collect()
}

fn face() -> Vec<Entry> {
    let none = (None, RefKind::Fresh);
    let step = |i: u64, sends: Option<u64>, before: u64| {
        entry((13 + i * 100, 5 + i * 100), Cause::Input, (Some(i), RefKind::Fresh), sends, before)
    };
    vec![
        step(0, Some(0), 0),
        step(1, None, 23),
        step(2, Some(1), 123),
        step(3, Some(2), 273),
        entry((420, 405), Cause::End, none, None, 323),
    ]
}

fn law() -> Vec<Entry> {
    let mut entries = Vec::new();
    let mut newest = None;
    for tick in 2..22 {
        let now = tick * 20;
        let seen = [(0, 23), (1, 273), (2, 323)].iter().rfind(|(_, sent)| *sent < now).map(|(s, _)| *s);
        let kind = if seen == newest { RefKind::Held } else { RefKind::Fresh };
        newest = seen;
        entries.push(entry((now, now - 18), Cause::Timer, (seen, kind), Some(tick - 2), now - 19));
    }
    entries
}

fn traced(entries: &[Vec<Entry>]) -> Trace {
    let stages = [
        stage("rig", &[], &["rig.depth", "rig.truth"]),
        stage("face", &["rig.depth"], &["face.face"]),
        stage("law", &["face.face"], &["law.duties"]),
    ];
    let all = stages.into_iter().zip(entries).map(|(stage, e)| (stage, e.as_slice(), false)).collect();
    Trace::of(&Journals::new(all, None), |_, _| true)
}

#[test]
fn a_path_names_where_each_sample_waited_stepped_and_ended() {
    let trace = traced(&[camera(), face(), law()]);
    assert_eq!(trace.paths.len(), 1);
    let path = &trace.paths[0];
    assert_eq!((path.from.as_str(), path.to.as_str()), ("rig.depth", "law"));
    assert_eq!(path.path, "rig.depth -> face.face -> law");
    // Image 1 gave no face, image 4 was not taken before the journal's end.
    assert_eq!((path.samples, path.arrived), (5, 3));
    let lost: Vec<(&str, &str, usize)> =
        path.lost.iter().map(|l| (l.operator.as_str(), l.why, l.samples)).collect();
    assert_eq!(lost.iter().map(|l| l.2).sum::<usize>(), 2);
    assert!(lost.contains(&("face", "nothing sent", 1)), "{lost:?}");
    // Acquired at 5 ms; taken by the law at its tick at 40, 280 and 340 ms, and sent 1 ms later.
    let mut totals: Vec<f64> = path.worst.iter().map(|w| w.total_ms).collect();
    totals.sort_by(f64::total_cmp);
    assert_eq!(totals, [36.0, 36.0, 76.0]);
    let face = &path.hops[1];
    assert_eq!((face.step_ms.p50, face.step_ms.max), (Some(10.0), Some(60.0)));
    let law = &path.hops[2];
    assert_eq!((law.wait_ms.p50, law.parts_ms["tick"].max), (Some(17.0), Some(17.0)));
    assert!(path.hops.iter().all(|h| !h.parts_ms.contains_key("delay")));
}

#[test]
fn the_longest_is_blamed_on_what_took_more_than_its_median() {
    let trace = traced(&[camera(), face(), law()]);
    let path = &trace.paths[0];
    let worst = &path.worst[0];
    assert_eq!((worst.operator.as_str(), worst.part, worst.sequence), ("face", PoseRole::Step, 2));
    assert_eq!((worst.total_ms, worst.beyond_ms), (76.0, 50.0));
    // The parts of each sample add up to its time: what is named is all of it.
    let sum: f64 = path.hops.iter().flat_map(|h| h.parts_ms.values()).filter_map(|s| s.max).sum();
    assert!(sum >= worst.total_ms, "{sum}");
}

/// Laps of the activations of the face at 13 and 213 ms.
fn laps_of_face() -> Laps {
    let of =
        |planes: u64, rest: u64| vec![("planes".to_owned(), planes * MS), ("rest".to_owned(), rest * MS)];
    Laps::from([("face".to_owned(), BTreeMap::from([(13 * MS, of(4, 9)), (213 * MS, of(2, 58))]))])
}

#[test]
fn a_step_that_is_to_blame_names_its_lap() {
    let (camera, face, law) = (camera(), face(), law());
    let stages = vec![
        (stage("rig", &[], &["rig.depth"]), camera.as_slice(), true),
        (stage("face", &["rig.depth"], &["face.face"]), face.as_slice(), false),
        (stage("law", &["face.face"], &["law.duties"]), law.as_slice(), false),
    ];
    let trace = Trace::of(&Journals::new(stages, None).with_laps(laps_of_face()), |_, _| true);
    let path = &trace.paths[0];
    // In the order of the step, not of the names.
    let laps: Vec<_> =
        path.hops[1].laps.iter().map(|l| (l.lap.as_str(), l.time_ms.count, l.time_ms.max)).collect();
    assert_eq!(laps, [("planes", 2, Some(4.0)), ("rest", 2, Some(58.0))]);
    assert!(path.hops[0].laps.is_empty() && path.hops[2].laps.is_empty());
    assert_eq!((path.worst[0].operator.as_str(), path.worst[0].lap.as_deref()), ("face", Some("rest")));
    // A sample whose activation was not measured has no lap to blame.
    assert!(path.worst[1..].iter().all(|w| w.operator != "face" || w.sequence == 0 || w.lap.is_none()));
}

#[test]
fn the_parts_of_a_passage_are_its_whole_time() {
    let (camera, face, law) = (camera(), face(), law());
    let stages = vec![
        (stage("rig", &[], &["rig.depth"]), camera.as_slice(), true),
        (stage("face", &["rig.depth"], &["face.face"]), face.as_slice(), false),
        (stage("law", &["face.face"], &["law.duties"]), law.as_slice(), false),
    ];
    let journals = Journals::new(stages, None);
    let (paths, _) = paths::of(&journals);
    let passages: Vec<_> = follow::all(&journals, &paths[0]).into_iter().flatten().collect();
    assert_eq!(passages.len(), 3);
    for passage in passages {
        let parts: u64 = passage.stops.iter().flat_map(|s| s.parts).sum();
        assert_eq!(parts, passage.total(), "{passage:?}");
    }
}

#[test]
fn a_perfetto_trace_has_a_slice_for_each_activation_and_arrows_within_slices() {
    let (camera, face, law) = (camera(), face(), law());
    let stages = vec![
        (stage("rig", &[], &["rig.depth"]), camera.as_slice(), true),
        (stage("face", &["rig.depth"], &["face.face"]), face.as_slice(), false),
        (stage("law", &["face.face"], &["law.duties"]), law.as_slice(), false),
    ];
    let value = perfetto(&Journals::new(stages, None).with_laps(laps_of_face()));
    let events = value["traceEvents"].as_array().unwrap_or_else(|| panic!("{value}"));
    let of = |phase: &str| events.iter().filter(|e| e["ph"] == phase).collect::<Vec<_>>();
    // The last activation of each operator has no known end.
    assert_eq!(of("X").iter().filter(|e| e["cat"] == "step").count(), 4 + 4 + 19);
    let laps: Vec<_> = of("X").into_iter().filter(|e| e["cat"] == "lap").collect();
    // A lap ends with its step.
    assert_eq!((&laps[0]["dur"], &laps[1]["dur"]), (&4000.0.into(), &6000.0.into()));
    assert_eq!((of("s").len(), of("f").len()), (7, 7));
    assert_eq!(of("M").len(), 6);
}
