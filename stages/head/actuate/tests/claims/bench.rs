//! The operators on the bench: what they refuse to start with, and single activations.

use stillpoint_actuate::pose_watch::PoseWatch;
use stillpoint_actuate::{Order, decode};
use stillpoint_samples::{
    Actuation, ActuationElement, ActuationReason as Reason, ActuationState as State, ConsoleCommand,
    Datagram, Duties, DutiesElement, DutyReason, Gate, GateElement, PoseReport, PoseReportElement, RigState,
    RigStateElement, Target, Track, TrackElement, Verb,
};
use stillpoint_testing::Bench;
use stillpoint_testing::bench::Left;

use zerocopy::FromZeros;

use super::script::{STAGES, command, duties, report, track};
use super::sent::key;
use super::whole::{Said, files, text};

const COMMAND: usize = 0;
const STATE: usize = 1;
const REFERENCE: usize = 2;
const ARM: usize = 3;
const RESUME: usize = 5;
const MEASURED: usize = 7;
const MS: u64 = 1_000_000;

fn bench(text: &str, name: &str) -> Result<Bench, String> {
    let stages = [STAGES, stillpoint_actuate::STAGES].concat();
    Bench::new(text, name, &stages, &files())
}

fn valves(params: &str) -> Bench {
    bench(&text(&Said { valves: params, ..Said::default() }), "valves").unwrap()
}

fn state(left: &Left) -> ActuationElement {
    assert_eq!(left.fault, None);
    let (_, owned) = left.outputs.iter().find(|(port, _)| *port == 1).unwrap();
    *owned.pieces().view::<Actuation>().unwrap().first().unwrap()
}

fn order(left: &Left) -> Order {
    let (_, owned) = left.outputs.iter().find(|(port, _)| *port == 0).unwrap();
    decode(owned.pieces().view::<Datagram>().unwrap().elements, &key()).unwrap().order
}

/// Valves that were armed with everything there, 40 ms after the start.
fn armed(params: &str) -> Bench {
    let mut bench = valves(params);
    bench.feed::<PoseReport>(REFERENCE, &(), &[report(1)], 0);
    bench.feed::<Track>(STATE, &(), &[track(1)], 0);
    bench.feed::<Duties>(COMMAND, &(), &[duties(0.4)], 0);
    let left = bench.feed::<ConsoleCommand>(ARM, &(), &[command(Verb::Arm)], 0);
    assert_eq!((state(&left).state(), order(&left)), (State::Armed, Order::Follow));
    bench
}

#[test]
fn what_cannot_work_is_refused_when_it_is_made() {
    let fault = |from: &str, to: &str, name: &str| {
        let whole = text(&Said::default());
        assert!(whole.contains(from));
        bench(&whole.replace(from, to), name).err().unwrap_or_default()
    };
    let slow =
        fault("use: actuate.valves\n    every: 10 ms", "use: actuate.valves\n    every: 40 ms", "valves");
    assert!(slow.contains("`life` is 60 ms and the timer ticks every 40 ms"), "{slow}");
    let slow = fault("use: gate.beam\n    every: 10 ms", "use: gate.beam\n    every: 60 ms", "gate");
    assert!(slow.contains("`lease` is 100 ms and the timer ticks every 60 ms"), "{slow}");
    let shut = text(&Said { valves: "dead_band: 0.1, max_duty: 0.1", ..Said::default() });
    let shut = bench(&shut, "valves").err().unwrap_or_default();
    assert!(shut.contains("no valve would ever open"), "{shut}");
    let lone = fault("reference: head.report, ", "", "valves");
    assert!(lone.contains("say `reference: waived`"), "{lone}");
    let blind = fault("actuation: valves.state, report: head.report", "actuation: valves.state", "gate");
    assert!(blind.contains("connect `report: head.report`, or say `tracker: waived`"), "{blind}");
    for name in ["valves", "gate"] {
        let unmeasured = fault("measured: 2026-11-21, ", "", name);
        assert!(
            unmeasured.contains("and the frame `camera` has no `measured: YYYY-MM-DD`: say in"),
            "{unmeasured}"
        );
        let vague = fault("residual: 0.3 mm", "residual: 3 mm", name);
        assert!(vague.contains("the frame `camera` has a residual of 3 mm, more than 1 mm"), "{vague}");
    }
    let frames = fault("dwell: 200 ms", "extrinsic: { frames: [kamera] }", "gate");
    assert!(frames.contains("`kamera` in `extrinsic.frames` is not a frame"), "{frames}");
    assert_eq!(
        fault("key: rig.key, dwell", "key: rig.key, extrinsic: { frames: [camera] }, dwell", "gate"),
        ""
    );
}

#[test]
fn a_key_file_without_a_key_is_refused_by_its_name() {
    let mut files = files();
    files.files.insert("rig.key".into(), b"secret".to_vec());
    let stages = [STAGES, stillpoint_actuate::STAGES].concat();
    let fault = Bench::new(&text(&Said::default()), "valves", &stages, &files).err().unwrap();
    assert_eq!(
        fault,
        "rig.key: line 1 of the key file has a character at 1 that is not a hexadecimal digit: a key is 64 of 0-9 and a-f"
    );
}

#[test]
fn a_key_file_that_others_may_read_is_refused_unless_it_is_the_example() {
    use std::os::unix::fs::PermissionsExt;
    let folder = std::env::temp_dir().join(format!("stillpoint-key-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("rig.key");
    let own = b"00112233445566778899aabbccddeeff0123456789abcdef0123456789abcdef".as_slice();
    let example = include_bytes!("../../../../../examples/data/rig.key").as_slice();
    let stages = [STAGES, stillpoint_actuate::STAGES].concat();
    let description = |key: &[u8], mode: u32| {
        std::fs::write(&file, key).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(mode)).unwrap();
        let files = stillpoint_operator::files::DiskFiles::next_to(&folder.join("whole.yaml"));
        Bench::new(&text(&Said::default()), "valves", &stages, &files).err()
    };
    let refused = description(own, 0o640).unwrap();
    assert!(refused.contains("others may read this key file (mode 0640)") && refused.contains("chmod 600"));
    assert_eq!([description(own, 0o600), description(example, 0o644)], [None, None]);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_person_is_heard_between_ticks() {
    let mut bench = armed("safe: hold");
    let left = bench.at(41 * MS).feed::<ConsoleCommand>(6, &(), &[command(Verb::Vent)], 0);
    assert_eq!((state(&left).state(), order(&left)), (State::Venting, Order::Hold));
    assert_eq!(order(&bench.at(80 * MS).tick()), Order::Hold);
    assert_eq!(order(&bench.at(81 * MS).tick()), Order::Vent);
}

#[test]
fn an_input_that_carries_another_verb_asks_for_nothing() {
    let mut bench = armed("");
    let left = bench.feed::<ConsoleCommand>(4, &(), &[command(Verb::Capture)], 0);
    assert_eq!(state(&left).state(), State::Armed);
    let left = bench.feed::<ConsoleCommand>(RESUME, &(), &[command(Verb::Vent)], 0);
    assert_eq!(state(&left).state(), State::Armed);
}

#[test]
fn a_stage_that_stood_still_starts_from_shut_valves() {
    let mut bench = armed("slew: 5 1/s, watchdog: 10 s, pose: { frame_period: 1 s }");
    for _ in 0..4 {
        bench.tick();
    }
    let before = state(&bench.tick());
    assert!(before.duty[0] > 0.25, "{}", before.duty[0]);
    // Stopped for a second: its datagrams are dead, and the far end vented.
    let left = bench.at(1_100 * MS).tick();
    let after = state(&left);
    assert_eq!((order(&left), after.reasons & Reason::GAP), (Order::Follow, Reason::GAP));
    assert!(after.duty[0] <= 0.05 + 1e-9, "{}", after.duty[0]);
}

#[test]
fn a_reference_that_is_waived_is_not_needed() {
    let whole = text(&Said { valves: "reference: waived", ..Said::default() });
    let mut bench = bench(&whole.replace("reference: head.report, ", ""), "valves").unwrap();
    bench.feed::<Track>(STATE, &(), &[track(1)], 0);
    bench.feed::<Duties>(COMMAND, &(), &[duties(0.4)], 0);
    let left = bench.feed::<ConsoleCommand>(ARM, &(), &[command(Verb::Arm)], 0);
    assert_eq!(state(&left).state(), State::Armed);
}

#[test]
fn a_measured_pressure_replaces_the_estimate_and_is_a_fault_above_the_limit() {
    let mut bench = armed("");
    let rig = |pressure: f64| {
        let mut rig = RigStateElement::new_zeroed();
        (rig.bladders, rig.pressure[1], rig.pressure[7]) = (3, pressure, 90e3);
        rig
    };
    let left = bench.feed::<RigState>(MEASURED, &(), &[rig(25e3)], 0);
    let seen = state(&left);
    assert!((seen.pressure[1] - 25e3).abs() < 1e-6 && seen.pressure[7] == 0.0);
    // Nearer to the limit than the taper: the inlet shuts by and by.
    let near = state(&bench.feed::<RigState>(MEASURED, &(), &[rig(39.8e3)], 0));
    assert!(near.duty[2] <= 0.051 && near.duty[0] > 0.1, "{near:?}");
    assert_eq!(near.reasons & Reason::PRESSURE_LIMITED, Reason::PRESSURE_LIMITED);
    let none = state(&bench.feed::<RigState>(MEASURED, &(), &[rig(f64::NAN)], 0));
    assert!((none.pressure[1] - 39.8e3).abs() < 50.0);
    let left = bench.feed::<RigState>(MEASURED, &(), &[rig(40.1e3)], 0);
    assert_eq!((state(&left).state(), state(&left).fault), (State::Fault, Reason::PRESSURE));
}

#[test]
fn a_law_that_is_lost_is_a_fault_though_it_asks_for_shut_valves() {
    let mut bench = armed("");
    let lost = DutiesElement::shut(6, DutyReason::NotFinite.bit());
    let left = bench.feed::<Duties>(COMMAND, &(), &[lost], 0);
    assert_eq!((state(&left).state(), state(&left).fault), (State::Fault, Reason::COMMAND_NOT_FINITE));
}

#[test]
fn a_filter_that_only_predicts_goes_stale() {
    let mut bench = armed("watchdog: 10 s");
    for ms in (50..=320).step_by(10) {
        let left = bench.at(ms * MS).feed::<Track>(STATE, &(), &[track(1)], 0);
        assert_eq!(state(&left).state(), State::Armed, "{ms}");
    }
    let left = bench.at(330 * MS).feed::<Track>(STATE, &(), &[track(1)], 0);
    assert_eq!((state(&left).state(), state(&left).reasons), (State::Holding, Reason::POSE_STALE));
}

#[test]
fn a_clock_that_is_ahead_makes_nothing_fresh_for_longer() {
    let mut watch = PoseWatch::new(3);
    watch.see(&track(1), 3_600_000 * MS, 0, 50 * MS);
    assert_eq!((watch.age(50 * MS), watch.age(350 * MS)), (Some(0), Some(300 * MS)));
}

#[test]
fn a_track_without_channels_or_numbers_is_no_pose() {
    let see = |change: fn(&mut TrackElement)| {
        let (mut watch, mut track) = (PoseWatch::new(3), track(1));
        change(&mut track);
        watch.see(&track, 0, 0, 0);
        (watch.is_broken(), watch.track().is_some(), watch.age(0).is_some())
    };
    assert_eq!(see(|_| ()), (false, true, true));
    assert_eq!(see(|t| t.orientation[3] = f64::NAN), (true, false, false));
    assert_eq!(see(|t| t.position[0] = f64::INFINITY), (true, false, false));
    assert_eq!(see(|t| t.channels = 0), (true, false, false));
    assert_eq!(see(|t| *t = TrackElement::NONE), (false, false, false));
    // Channels that the filter does not follow have no numbers, and need none.
    assert_eq!(
        see(|t| (t.channels, t.position[0], t.orientation) = (4, f64::NAN, [f64::NAN; 4])),
        (false, true, true)
    );
    assert_eq!(see(|t| t.repeated = 3), (false, true, false));
}

/// What the gate states.
fn gate(left: &Left) -> GateElement {
    assert_eq!(left.fault, None);
    let (_, owned) = left.outputs.iter().find(|(port, _)| *port == 1).unwrap();
    *owned.pieces().view::<Gate>().unwrap().first().unwrap()
}

/// The state of actuation that follows.
fn following() -> ActuationElement {
    ActuationElement {
        state: State::Armed as u32,
        order: Order::Follow as u32,
        ..ActuationElement::default()
    }
}

/// The gate after so many rounds of good samples, with the beam on from the first round in which it is, and the time of its
/// last word, ms.
fn beaming() -> (Bench, u64) {
    let mut bench = bench(&text(&Said::default()), "gate").unwrap();
    let mut ms = 10;
    loop {
        if feed_gate(&mut bench, ms) == 1 {
            return (bench, ms + 2);
        }
        ms += 10;
        assert!(ms < 500, "the beam never comes on");
    }
}

/// A round of good samples; whether the beam is on.
fn feed_gate(bench: &mut Bench, ms: u64) -> u32 {
    bench.at((ms - 1) * MS).feed::<PoseReport>(3, &(), &[report(1)], 0);
    bench.at(ms * MS).feed::<Track>(0, &(), &[track(ms)], 0);
    bench.at((ms + 1) * MS).feed::<Target>(1, &(), &[super::script::target()], 0);
    gate(&bench.at((ms + 2) * MS).feed::<Actuation>(2, &(), &[following()], 0)).beam
}

#[test]
fn limits_of_the_gate_are_only_narrowed_while_the_beam_is_on_and_each_answer_has_its_generation() {
    let (mut on, ms) = beaming();
    let wider = on.at((ms + 1) * MS).set("gate.position_tolerance", "5 mm").unwrap();
    assert_eq!((wider.taken, wider.generation), (0, 0));
    let why = wider.refusal().unwrap();
    assert!(
        why.starts_with("`position_tolerance` is wider while the beam is on: 5 mm (allowed: up to "),
        "{why}"
    );
    let narrower = on.at((ms + 2) * MS).set("gate.position_tolerance", "0.0001 mm").unwrap();
    assert_eq!((narrower.taken, narrower.generation), (1, 1));
    // Another operator's change is not answered.
    assert_eq!(on.at((ms + 3) * MS).set("law.position_tolerance", "5 mm"), None);
    let mut off = bench(&text(&Said::default()), "gate").unwrap();
    assert_eq!(off.set("gate.position_tolerance", "5 mm").unwrap().taken, 1);
    for (path, value, words) in [
        ("gate.position_tolerance", "5", "unit"),
        ("gate.lease", "50 ms", "is not live"),
        ("gate.confidence", "2", "from 0 to 1"),
    ] {
        let refused = off.set(path, value).unwrap();
        assert!(refused.refusal().unwrap().contains(words), "{:?}", refused.refusal());
        assert_eq!(refused.generation, 1);
    }
}

#[test]
fn silence_of_actuation_and_its_word_that_nothing_is_followed_each_end_the_lease() {
    use stillpoint_samples::GateReason;
    let armed = following();
    let (mut silent, ms) = beaming();
    assert_eq!(gate(&silent.at((ms + 30) * MS).tick()).beam, 1);
    let off = gate(&silent.at((ms + 31) * MS).tick());
    assert_eq!((off.beam, off.reasons, off.lease_ends), (0, GateReason::ACTUATION_SILENT, 0));
    for state in [State::Holding, State::Disarmed, State::Venting, State::Fault] {
        let (mut reported, ms) = beaming();
        let word = ActuationElement { state: state as u32, order: Order::Hold as u32, ..armed };
        let off = gate(&reported.at((ms + 1) * MS).feed::<Actuation>(2, &(), &[word], 0));
        assert_eq!((off.beam, off.reasons), (0, GateReason::ACTUATION), "{state:?}");
    }
}

#[test]
fn a_beam_at_another_couch_angle_than_the_session_has_no_lease_and_says_why() {
    use stillpoint_samples::GateReason;
    let at = |params: &str| bench(&text(&Said { gate: params, ..Said::default() }), "gate");
    // Couch and beam agree, also a whole turn apart: there is a lease. Otherwise there is none, ever.
    for (params, is_on) in [
        ("couch: 30 deg, beam_couch: 30 deg", true),
        ("couch: 330 deg, beam_couch: -30 deg", true),
        ("couch: 30 deg", false),
        ("beam_couch: 30 deg", false),
        ("couch: 30 deg, beam_couch: -30 deg", false),
    ] {
        let mut bench = at(params).unwrap();
        let beams: Vec<u32> = (10..500).step_by(10).map(|ms| feed_gate(&mut bench, ms)).collect();
        assert_eq!(beams.contains(&1), is_on, "{params}");
        let last = gate(&bench.at(500 * MS).feed::<Actuation>(2, &(), &[following()], 0));
        assert_eq!(last.reasons & GateReason::COUCH != 0, !is_on, "{params}");
    }
    // The next beam is named while one is on: its lease ends at once, and begins anew when the beam fits.
    let (mut on, ms) = beaming();
    assert_eq!(on.at((ms + 1) * MS).set("gate.beam_couch", "30 deg").unwrap().taken, 1);
    let off = gate(&on.at((ms + 2) * MS).feed::<Actuation>(2, &(), &[following()], 0));
    assert_eq!((off.beam, off.reasons, off.ended_by), (0, GateReason::COUCH, GateReason::COUCH));
    assert_eq!(on.at((ms + 3) * MS).set("gate.beam_couch", "0.04 deg").unwrap().taken, 1);
    let next = ms.next_multiple_of(10) + 10;
    assert!((next..next + 500).step_by(10).any(|ms| feed_gate(&mut on, ms) == 1));
    // The couch of a session stands.
    for (path, value, words) in [
        ("gate.couch", "30 deg", "is not live"),
        ("gate.beam_couch", "400 deg", "360"),
        ("gate.beam_couch", "NaN deg", "not an angle"),
        ("gate.beam_couch", "30", "unit"),
    ] {
        let refused = on.at((next + 600) * MS).set(path, value).unwrap();
        assert!(
            (refused.taken, refused.generation) == (0, 2) && refused.refusal().unwrap().contains(words),
            "{path} {value}: {:?}",
            refused.refusal()
        );
    }
    for wrong in ["couch: 400 deg", "couch: .nan deg", "couch: 30", "beam_couch: -361 deg"] {
        let why = at(wrong).err().unwrap();
        assert!(why.contains("couch"), "{wrong}: {why}");
    }
}

#[test]
fn a_camera_that_is_left_out_is_named_while_the_tracker_has_no_proof_and_never_ends_a_lease_alone() {
    use stillpoint_samples::{GateReason, Health, Proof, SensorHealth};
    let cameras = |reasons: [&str; 2]| {
        let camera = |reason| SensorHealth {
            reason: SensorHealth::field(reason),
            name: SensorHealth::field("second"),
            ..SensorHealth::new_zeroed()
        };
        reasons.map(camera)
    };
    let (mut on, ms) = beaming();
    on.at((ms + 1) * MS).feed::<Health>(6, &(), &cameras(["used", "blocked"]), 0);
    let next = ms.next_multiple_of(10) + 10;
    assert_eq!(feed_gate(&mut on, next), 1);
    let mut unproven = |ms: u64, reasons: [&str; 2]| {
        on.at(ms * MS).feed::<Health>(6, &(), &cameras(reasons), 0);
        let report = PoseReportElement { proof: Proof::Waiting as u32, ..report(1) };
        let left = on.at((ms + 1) * MS).feed::<PoseReport>(3, &(), &[report], 0);
        let gate = gate(&left);
        (gate.beam, gate.reasons)
    };
    let (alone, with) = (GateReason::UNPROVEN, GateReason::UNPROVEN | GateReason::CAMERA);
    assert_eq!(unproven(next + 3, ["used", "blocked"]), (0, with));
    assert_eq!(unproven(next + 6, ["used", "used"]), (0, alone));
}

#[test]
fn what_lies_beyond_a_sample_reaches_nothing() {
    let run = |padding: usize| {
        let mut bench = armed("").padded(padding);
        (0..20).flat_map(|_| bench.tick().bytes()).collect::<Vec<u8>>()
    };
    assert_eq!(run(0), run(64));
}
