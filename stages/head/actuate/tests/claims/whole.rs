//! Valves and gate in the simulated executor, with a far end behind them.

use stillpoint_actuate::{Act, FarEnd, Receives, decode};
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{
    Actuation, ActuationElement, ActuationReason, ActuationState as State, Datagram, Gate, GateElement,
    GateReason,
};
use stillpoint_testing::run::{Run, START};

use super::script;
use super::sent::key;

const MS: u64 = 1_000_000;
/// What the way to the far end takes, ms.
const WAY: u64 = 2;
/// How long valves are shut before they vent, ms.
const LEAD: u64 = 40;

/// The digits of [`key`].
const KEY: &[u8] = b"00112233445566778899aabbccddeeff0123456789abcdef0123456789abcdef";

/// Params of the operators, by name; empty where nothing is said.
#[derive(Clone, Copy, Default)]
pub struct Said<'a> {
    pub person: &'a str,
    pub filter: &'a str,
    pub head: &'a str,
    pub control: &'a str,
    pub target: &'a str,
    pub valves: &'a str,
    pub gate: &'a str,
}

pub fn text(description: &Said<'_>) -> String {
    let Said { person, filter, head, control, target, valves, gate } = description;
    format!(
        "
stillpoint: 1
name: whole
seed: 3
frames: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m], measured: 2026-11-21, residual: 0.3 mm }} }}
operators:
  person: {{ use: test.person, every: 10 ms, params: {{ arm: 500 ms, {person} }} }}
  head: {{ use: test.head, every: 100 ms, frame: couch, params: {{ {head} }} }}
  filter: {{ use: test.filter, every: 100 ms, frame: couch, params: {{ {filter} }} }}
  target: {{ use: test.target, every: 100 ms, frame: couch, params: {{ {target} }} }}
  control: {{ use: test.controller, every: 10 ms, params: {{ {control} }} }}
  valves:
    use: actuate.valves
    every: 10 ms
    inputs: {{ command: control.duties, state: filter.state, reference: head.report, arm: person.arm,
              disarm: person.disarm, resume: person.resume, vent: person.vent }}
    params: {{ key: rig.key, {valves} }}
  gate:
    use: gate.beam
    every: 10 ms
    inputs: {{ state: filter.state, target: target.reference, actuation: valves.state, report: head.report }}
    params: {{ key: rig.key, dwell: 200 ms, {gate} }}
"
    )
}

pub fn files() -> MemoryFiles {
    MemoryFiles { files: [("rig.key".to_string(), KEY.to_vec())].into() }
}

pub fn registry() -> Registry {
    Registry::new(&[script::STAGES, stillpoint_actuate::STAGES])
}

pub fn run(description: &Said<'_>, ms: u64) -> Run {
    let run = stillpoint_testing::run(&text(description), &registry(), &files(), ms).unwrap();
    assert_eq!(run.failed(), &[] as &[String]);
    run
}

/// Stamp in ms, and content, of each sample of actuation.
pub fn actuation(run: &Run) -> Vec<(u64, ActuationElement)> {
    let samples = run.samples::<Actuation>("valves.state");
    samples.iter().map(|s| ((s.header.stamp - START) / MS, *s.first().unwrap())).collect()
}

/// Stamp in ms, and content, of each sample of the gate.
pub fn gate(run: &Run) -> Vec<(u64, GateElement)> {
    let samples = run.samples::<Gate>("gate.state");
    samples.iter().map(|s| ((s.header.stamp - START) / MS, *s.first().unwrap())).collect()
}

/// What valves and beam did, ms by ms, behind a way of 2 ms; datagrams of either made after `until` ms never come.
pub fn far_end(run: &Run, until: u64) -> (FarEnd, Vec<(u64, Act, bool)>) {
    let mut sent: Vec<(u64, Vec<u8>)> = Vec::new();
    for topic in ["valves.datagram", "gate.datagram"] {
        for sample in run.samples::<Datagram>(topic) {
            sent.push(((sample.header.stamp - START) / MS, sample.elements.to_vec()));
        }
    }
    sent.sort_by_key(|(stamp, _)| *stamp);
    let mut far = FarEnd::new(&key(), Receives::valves(6));
    let end = sent.last().map_or(0, |(stamp, _)| *stamp);
    let mut did = Vec::new();
    let mut next = sent.iter().filter(|(stamp, _)| *stamp <= until).peekable();
    for ms in 0..end {
        while let Some((_, bytes)) = next.next_if(|(stamp, _)| stamp + WAY <= ms) {
            far.receive(bytes, START + ms * MS).unwrap();
        }
        let doing = far.step(START + ms * MS);
        did.push((ms, doing.valves, doing.beam));
    }
    (far, did)
}

/// First ms from `from` on at which something holds.
fn first<T>(all: &[(u64, T)], from: u64, holds: impl Fn(&T) -> bool) -> Option<u64> {
    all.iter().find(|(ms, sample)| *ms >= from && holds(sample)).map(|(ms, _)| *ms)
}

#[test]
fn a_person_arms_the_head_is_held_and_the_beam_goes_on_after_the_dwell() {
    let run = run(&Said::default(), 2_000);
    let (states, gates) = (actuation(&run), gate(&run));
    assert_eq!(first(&states, 0, |a| a.state() == State::Armed), Some(500));
    assert_eq!(first(&gates, 0, |g| g.beam == 1), Some(700));
    assert!(states.iter().all(|(ms, a)| (*ms >= 500) == (a.order == 2) && a.faults + a.refused == 0));
    assert!(gates.iter().all(|(ms, g)| (g.beam == 1) == (*ms >= 700) && (g.beam == 1) == (g.reasons == 0)));
    let last = gates.last().unwrap().1;
    assert_eq!((last.leases, last.position_error[2]), (1, 1e-4));
    assert!(last.position_error[0].is_nan() && last.lease_ends > START);
    // What was sent is what stands in the state.
    let sent = run.samples::<Datagram>("valves.datagram");
    assert_eq!(sent.len(), states.len());
    for (datagram, (_, state)) in sent.iter().zip(&states) {
        let message = decode(datagram.elements, &key()).unwrap();
        assert_eq!(message.duty.map(f64::from), state.duty);
        assert_eq!((message.sequence, message.stamp), (state.datagram, datagram.header.stamp));
        assert_eq!((message.session.started, message.session.nonce), (START, state.session_nonce));
        assert_eq!((message.order as u32, message.reasons), (state.order, state.reasons));
    }
    let (far, did) = far_end(&run, u64::MAX);
    assert_eq!((far.valves().all_refused(), far.beam().all_refused()), (0, 0));
    let on: Vec<u64> = did.iter().filter(|(_, _, beam)| *beam).map(|(ms, ..)| *ms).collect();
    assert_eq!((on.first(), on.len() as u64), (Some(&702), did.last().unwrap().0 - 701));
}

/// A fault that comes at 1500 ms or with the first sample after it, while the beam is on.
struct Case<'a> {
    name: &'a str,
    description: Said<'a>,
    /// When it is first to be seen at the latest, ms.
    seen: u64,
    reason: u32,
    state: State,
}

#[test]
fn every_fault_ends_the_lease_before_it_vents_and_vents_within_100_ms() {
    use ActuationReason as Reason;
    let base = Said::default();
    let case = |name, description, seen, reason, state| Case { name, description, seen, reason, state };
    let from = "from: 1490 ms";
    let filter = |fault: &str| format!("fault: {fault}, {from}");
    let (silent, nan, nothing, frozen, off) =
        (filter("silent"), filter("not_finite"), filter("nothing"), filter("frozen"), filter("off"));
    for case in [
        // The last pose is of 1400 ms, stale after three periods.
        case("pose silent", Said { filter: &silent, ..base }, 1_710, Reason::POSE_STALE, State::Venting),
        case("pose frozen", Said { filter: &frozen, ..base }, 1_710, Reason::POSE_STALE, State::Venting),
        case("pose not finite", Said { filter: &nan, ..base }, 1_500, Reason::POSE_NOT_FINITE, State::Fault),
        case("no estimate", Said { filter: &nothing, ..base }, 1_500, Reason::NO_POSE, State::Venting),
        // The last command is of 1480 ms, stale after 60.
        case(
            "command silent",
            Said { control: &silent, ..base },
            1_550,
            Reason::COMMAND_STALE,
            State::Venting,
        ),
        case(
            "command not finite",
            Said { control: &nan, ..base },
            1_490,
            Reason::COMMAND_NOT_FINITE,
            State::Fault,
        ),
        case(
            "command for others",
            Said { control: &off, ..base },
            1_490,
            Reason::COMMAND_SHAPE,
            State::Fault,
        ),
        case("a person", Said { person: "vent: 1490 ms", ..base }, 1_490, Reason::ASKED, State::Venting),
    ] {
        let run = run(&case.description, 2_500);
        let (states, gates, name) = (actuation(&run), gate(&run), case.name);
        let halted = first(&states, 1_480, |a| a.order != 2).unwrap();
        assert!(halted <= case.seen, "{name}: {halted}");
        let off = first(&gates, 1_480, |g| g.beam == 0).unwrap();
        let vent = first(&states, 1_480, |a| a.order == 1).unwrap();
        assert!(off <= halted && off < vent, "{name}: off {off}, vent {vent}");
        assert!(vent >= halted + LEAD && vent <= case.seen + 100 - WAY, "{name}: {vent}");
        let (_, vented) = states.iter().find(|(ms, _)| *ms == vent).unwrap();
        assert_eq!((vented.state(), vented.reasons & case.reason), (case.state, case.reason), "{name}");
        // At the far end, too, and nothing is followed again.
        let (far, did) = far_end(&run, u64::MAX);
        assert_eq!(far.valves().all_refused() + far.beam().all_refused(), 0, "{name}");
        let after = |holds: &dyn Fn(&(u64, Act, bool)) -> bool| {
            did.iter().find(|d| d.0 > 1_450 && holds(d)).map(|d| d.0).unwrap()
        };
        let (dark, vents) = (after(&|d| !d.2), after(&|d| d.1 == Act::Vent));
        assert!(dark < vents && vents <= case.seen + 100, "{name}: dark {dark}, vents {vents}");
        assert!(did.iter().all(|d| d.0 < dark || !d.2), "{name}");
        assert!(did.iter().all(|d| d.0 < vents || d.1 == Act::Vent), "{name}");
    }
}

#[test]
fn a_program_that_dies_leaves_a_dark_beam_and_then_a_vented_rig_after_60_ms() {
    let run = run(&Said::default(), 1_500);
    // The last datagrams were made at 1000 ms.
    let (_, did) = far_end(&run, 1_000);
    let at = |ms: u64| did.iter().find(|d| d.0 == ms).unwrap();
    assert!(matches!(at(1_059), (_, Act::Follow(_), true)));
    assert_eq!(*at(1_060), (1_060, Act::Hold, false));
    assert_eq!(*at(1_061), (1_061, Act::Vent, false));
}

#[test]
fn what_speaks_against_the_beam_alone_ends_it_and_leaves_the_valves() {
    use GateReason as Reason;
    let base = Said::default();
    let cases = [
        ("fault: off, from: 1490 ms, to: 1590 ms", "", Reason::POSITION, 1_500),
        ("fault: vague, from: 1490 ms, to: 1590 ms", "", Reason::UNCERTAIN, 1_500),
        ("", "fault: moves, from: 1490 ms, to: 1590 ms", Reason::TARGET_MOVES, 1_500),
        ("", "fault: nothing, from: 1490 ms, to: 1590 ms", Reason::NO_TARGET, 1_500),
        ("", "fault: not_finite, from: 1490 ms, to: 1590 ms", Reason::NOT_FINITE, 1_500),
        ("", "fault: silent, from: 1490 ms, to: 2090 ms", Reason::TARGET_STALE, 1_900),
    ];
    for (filter, target, reason, ms) in cases {
        let run = run(&Said { filter, target, ..base }, 3_000);
        let (states, gates) = (actuation(&run), gate(&run));
        assert!(states.iter().all(|(ms, a)| (*ms >= 500) == (a.state() == State::Armed)));
        assert_eq!(first(&gates, 1_480, |g| g.beam == 0), Some(ms), "{reason}");
        let (_, off) = gates.iter().find(|(at, g)| *at == ms && g.beam == 0).unwrap();
        assert_eq!((off.reasons, off.ended_by, off.lease_ends), (reason, reason, 0));
        let (_, last) = gates.last().unwrap();
        // It comes back by itself, after the dwell.
        assert_eq!((last.beam, last.leases, last.reasons), (1, 2, 0));
        let repeated = first(&gates, ms + 1, |g| g.beam == 1).unwrap();
        assert!(gates.iter().all(|(at, g)| !(ms + 1..repeated).contains(at) || g.reasons != 0));
        let well = first(&gates, ms + 1, |g| g.reasons == Reason::DWELLING).unwrap();
        assert_eq!(repeated - well, 200, "{reason}");
    }
}

#[test]
fn the_first_frame_without_a_pose_ends_the_lease_while_the_filter_still_predicts() {
    for fault in ["off", "vague", "not_finite"] {
        let head = format!("fault: {fault}, from: 1490 ms, to: 1590 ms");
        let run = run(&Said { head: &head, ..Said::default() }, 3_000);
        let gates = gate(&run);
        assert_eq!(first(&gates, 1_480, |g| g.beam == 0), Some(1_500), "{fault}");
        let (_, off) = gates.iter().find(|(ms, g)| *ms == 1_500 && g.beam == 0).unwrap();
        assert_eq!((off.reasons, off.ended_by), (GateReason::TRACKER, GateReason::TRACKER), "{fault}");
        // One frame with a pose, and the dwell.
        assert_eq!(first(&gates, 1_510, |g| g.beam == 1), Some(1_800), "{fault}");
    }
    // The last report is of 1400 ms: too old after 1.5 periods and 5 ms.
    let silent = run(&Said { head: "fault: silent, from: 1490 ms", ..Said::default() }, 3_000);
    assert!(first(&gate(&silent), 1_480, |g| g.beam == 0).is_some_and(|ms| (1_560..=1_570).contains(&ms)));
    let waived = Said { head: "fault: off, from: 1490 ms", gate: "tracker: waived", ..Said::default() };
    assert_eq!(first(&gate(&run(&waived, 3_000)), 1_480, |g| g.beam == 0), None);
}

#[test]
fn a_head_that_slides_sideways_ends_the_beam_and_leaves_the_valves() {
    let run = run(&Said { filter: "fault: slid, from: 1490 ms, to: 2490 ms", ..Said::default() }, 4_000);
    let gates = gate(&run);
    assert!(first(&gates, 500, |g| g.beam == 1).is_some_and(|ms| ms < 1_490));
    assert_eq!(first(&gates, 1_480, |g| g.beam == 0), Some(1_500));
    let (_, off) = gates.iter().find(|(ms, g)| *ms == 1_500 && g.beam == 0).unwrap();
    assert_eq!(off.reasons, GateReason::DRIFT);
    assert_eq!(first(&gates, 1_510, |g| g.beam == 1), Some(2_700));
    assert!(actuation(&run).iter().filter(|(ms, _)| *ms > 600).all(|(_, s)| s.state().word() == "armed"));
    let wide = Said {
        filter: "fault: slid, from: 1490 ms, to: 2490 ms",
        gate: "drift_tolerance: 5 mm",
        ..Said::default()
    };
    assert_eq!(first(&gate(&self::run(&wide, 4_000)), 1_480, |g| g.beam == 0), None);
}

#[test]
fn a_head_that_is_followed_behind_an_arm_is_held_without_beam() {
    let run = run(&Said { head: "fault: arm, from: 1490 ms, to: 4490 ms", ..Said::default() }, 6_000);
    let gates = gate(&run);
    assert_eq!(first(&gates, 1_480, |g| g.beam == 0), Some(1_500));
    assert_eq!(first(&gates, 1_510, |g| g.beam == 1), Some(4_700), "one frame with a head, and the dwell");
    let (_, off) = gates.iter().find(|(ms, g)| *ms == 1_500 && g.beam == 0).unwrap();
    assert_eq!(off.reasons, GateReason::TRACKER);
    assert!(actuation(&run).iter().filter(|(ms, _)| *ms > 600).all(|(_, s)| s.state().word() == "armed"));
}

#[test]
fn a_face_that_hides_the_pose_for_three_seconds_ends_the_beam_holds_the_valves_and_vents_nothing() {
    let face = "fault: face, from: 1490 ms, to: 4490 ms";
    let run = run(&Said { head: face, filter: &face.replace("face,", "nothing,"), ..Said::default() }, 6_000);
    let (gates, states) = (gate(&run), actuation(&run));
    assert_eq!(first(&gates, 1_480, |g| g.beam == 0), Some(1_500));
    assert_eq!(first(&gates, 1_510, |g| g.beam == 1), Some(4_700), "one frame with a pose, and the dwell");
    let held: Vec<_> = states.iter().filter(|(ms, _)| (1_500..4_500).contains(ms)).collect();
    assert!(
        held.iter().all(|(_, s)| s.state().word() == "holding" && s.reasons == ActuationReason::FACE_MOVES)
    );
    let (_, last) = states.last().unwrap();
    assert_eq!((last.state().word(), last.faults), ("armed", 0));
    assert!(states.iter().all(|(_, s)| s.state().word() != "venting"));
}

#[test]
fn a_face_that_hides_the_pose_for_longer_than_five_seconds_vents() {
    let face = "fault: face, from: 1490 ms";
    let run = run(&Said { head: face, filter: &face.replace("face,", "nothing,"), ..Said::default() }, 8_000);
    let vents = first(&actuation(&run), 1_490, |s| s.state().word() == "venting");
    assert_eq!(vents, Some(6_500));
}

#[test]
fn the_beam_needs_a_plan_that_holds_in_the_requested_set_up_where_a_plan_is_connected() {
    let (without, with) = (
        "report: head.report }\n    params: { key: rig.key, dwell",
        "report: head.report, plan: plans.plan, plan_request: plans.request }\n    params: { key: rig.key, dwell",
    );
    let text = text(&Said::default()).replacen(without, with, 1).replacen(
        "operators:\n",
        "operators:\n  plans: { use: test.plans, every: 10 ms }\n",
        1,
    );
    let play = || stillpoint_testing::run(&text, &registry(), &files(), 2_500).unwrap();
    let run = play();
    assert_eq!(run.failed(), &[] as &[String]);
    let gates = gate(&run);
    let against =
        |ms: u64| gates.iter().rev().find(|(at, _)| *at <= ms).unwrap().1.reasons & GateReason::PLAN;
    assert_eq!([against(290), against(1_490)], [GateReason::PLAN, 0]);
    // The request ends the lease, before anything is known of the set-up.
    assert_eq!(first(&gates, 1_000, |g| g.beam == 0), Some(1_500));
    let (_, off) = gates.iter().find(|(ms, g)| *ms == 1_500 && g.beam == 0).unwrap();
    assert_eq!((off.reasons, off.ended_by), (GateReason::PLAN, GateReason::PLAN));
    assert!((1_500..2_000).all(|ms| against(ms) == GateReason::PLAN));
    // The plan that a person accepted holds; the beam waits for the dwell.
    assert_eq!(first(&gates, 1_501, |g| g.beam == 1), Some(2_200));
    assert_eq!(run.bytes("gate.state"), play().bytes("gate.state"));
    // Plans that are made in a pipeline have no couch angles.
    let turned = text.replacen(
        "plan_request: plans.request }\n    params: {",
        "plan_request: plans.request }\n    params: { couch: 30 deg,",
        1,
    );
    assert_ne!(turned, text);
    let refused = stillpoint_testing::run(&turned, &registry(), &files(), 100).err().unwrap();
    assert!(refused.contains("all beams at couch angle 0, and `couch` is 30 deg"), "{refused}");
    // Without a request nobody knows for which set-up a plan was judged.
    let lone = text.replacen(", plan_request: plans.request", "", 1);
    let refused = stillpoint_testing::run(&lone, &registry(), &files(), 100).err().unwrap();
    assert!(refused.contains("connect both `plan`"), "{refused}");
}

#[test]
fn a_repeated_measurement_ends_the_lease_at_once() {
    let frozen = "fault: frozen, from: 1490 ms";
    let run_of = |gate| run(&Said { filter: frozen, gate, ..Said::default() }, 2_500);
    let run = run_of("");
    assert_eq!(first(&gate(&run), 1_480, |g| g.beam == 0), Some(1_500));
    let (_, off) = *gate(&run).iter().find(|(ms, g)| *ms == 1_500 && g.beam == 0).unwrap();
    assert_eq!(off.reasons, GateReason::POSE_STALE);
    // The valves wait for more: a single image that comes twice is no reason to vent.
    assert_eq!(first(&actuation(&run), 1_480, |a| a.order != 2), Some(1_710));
    let patient = run_of("pose: { frozen_after: 1000000 }, tracker: waived");
    assert!(first(&gate(&patient), 1_480, |g| g.beam == 0).unwrap() > 1_700);
}

#[test]
fn a_stage_that_comes_back_is_followed_without_a_jump() {
    let silent = "duty: 0.8, fault: silent, from: 1490 ms, to: 2000 ms";
    let late = "fault: silent, from: 1490 ms, to: 2400 ms";
    for description in [Said { control: silent, ..Said::default() }, Said { filter: late, ..Said::default() }]
    {
        let run = run(&Said { valves: "slew: 2 1/s", ..description }, 4_000);
        let states = actuation(&run);
        for pair in states.windows(2) {
            let ((from, before), (to, after)) = (&pair[0], &pair[1]);
            // Two activations of one ms are a nanosecond apart.
            let growth = 2.0 * (to - from) as f64 * 1e-3 + 1e-8;
            assert!((0..16).all(|v| after.duty[v] <= before.duty[v] + growth), "{to} ms");
        }
        let vent = first(&states, 1_490, |a| a.order == 1).unwrap();
        let repeated = first(&states, vent, |a| a.order == 2).unwrap();
        let (_, first_again) = states.iter().find(|(ms, _)| *ms == repeated).unwrap();
        assert!(
            first_again.duty[0] <= 0.02 + 1e-9 && first_again.reasons & ActuationReason::SLEW_LIMITED != 0
        );
        assert!(states.last().unwrap().1.duty[0] > 0.39);
        // Nobody had to resume: it was no fault.
        assert_eq!(states.last().unwrap().1.faults, 0);
    }
}

#[test]
fn a_frame_that_comes_late_has_the_valves_hold_and_no_more() {
    // Frames of 1500 to 1700 ms are lost: the pose is stale from 1710 ms on, and the next one comes at 1800 ms.
    let lost = "fault: silent, from: 1490 ms, to: 1710 ms";
    for (lead, vents) in [("lead: 80 ms", true), ("pose: { frame_period: 120 ms }", false)] {
        let run = run(&Said { filter: lost, valves: lead, ..Said::default() }, 2_500);
        let states = actuation(&run);
        assert_eq!(states.iter().any(|(_, a)| a.order == 1), vents, "{lead}");
        let held = first(&states, 1_500, |a| a.state() == State::Holding).unwrap();
        let repeated = first(&states, held, |a| a.order == 2).unwrap();
        assert_eq!(repeated, if vents { 1_900 } else { 1_800 }, "{lead}");
    }
}

#[test]
fn arming_without_reference_or_extrinsic_or_pose_is_refused_and_said() {
    use ActuationReason as Reason;
    let base = Said::default();
    for (description, lacking) in [
        (Said { head: "fault: nothing", ..base }, Reason::REFERENCE),
        (Said { head: "fault: silent", ..base }, Reason::REFERENCE),
        (Said { valves: "extrinsic: { max_age: 24 h }", ..base }, Reason::EXTRINSIC),
        (Said { filter: "fault: silent", ..base }, Reason::NO_POSE),
        (Said { filter: "fault: silent, from: 50 ms", ..base }, Reason::POSE_STALE),
        (Said { control: "fault: silent", ..base }, Reason::NO_COMMAND),
    ] {
        let run = run(&description, 1_000);
        let states = actuation(&run);
        let (_, last) = states.last().unwrap();
        assert_eq!((last.state(), last.refused, last.lacking), (State::Disarmed, 1, lacking));
        assert!(states.iter().all(|(_, a)| a.order == 0 && a.duty == [0.0; 16]));
        assert!(gate(&run).iter().all(|(_, g)| g.beam == 0));
        assert!(far_end(&run, u64::MAX).1.iter().skip(3).all(|(_, act, beam)| *act == Act::Hold && !beam));
    }
}

#[test]
fn a_new_reference_disarms_and_a_person_arms_again() {
    let run = run(&Said { head: "fault: moves, from: 1490 ms", ..Said::default() }, 2_000);
    let states = actuation(&run);
    assert_eq!(first(&states, 600, |a| a.state() == State::Disarmed), Some(1_500));
    assert!(states.iter().all(|(_, a)| a.order != 1));
    assert_eq!(states.last().unwrap().1.lacking, ActuationReason::REFERENCE);
}

#[test]
fn a_person_resumes_after_a_fault_and_not_before_its_cause_is_gone() {
    for (resume, refused, state) in [("1550 ms", 1, State::Fault), ("2000 ms", 0, State::Armed)] {
        let person = format!("resume: {resume}");
        let control = "fault: not_finite, from: 1490 ms, to: 1600 ms";
        let run = run(&Said { person: &person, control, ..Said::default() }, 2_500);
        let states = actuation(&run);
        let (_, last) = states.last().unwrap();
        assert_eq!((last.state(), last.refused, last.faults), (state, refused, 1), "{resume}");
    }
}

#[test]
fn an_idle_controller_and_a_disarmed_stage_shut_the_valves_and_end_the_beam() {
    let idle = run(&Said { control: "fault: nothing, from: 1490 ms", ..Said::default() }, 2_000);
    let disarmed = run(&Said { person: "disarm: 1490 ms", ..Said::default() }, 2_000);
    for (run, state) in [(&idle, State::Holding), (&disarmed, State::Disarmed)] {
        let (states, gates) = (actuation(run), gate(run));
        assert_eq!(first(&states, 600, |a| a.state() == state), Some(1_490));
        assert_eq!(first(&gates, 1_000, |g| g.beam == 0), Some(1_490));
        assert!(states.iter().all(|(_, a)| a.order != 1));
    }
}

#[test]
fn inlets_stay_below_the_limit_of_the_pressure_under_any_command() {
    let control = "duty: 1.0";
    let valves = "pressure: { start: [0 Pa], limit: 15 kPa, taper: 3 kPa }";
    let run = run(&Said { control, valves, ..Said::default() }, 6_000);
    let states = actuation(&run);
    assert!(states.iter().all(|(_, a)| a.pressure[..3].iter().all(|p| *p <= 15e3) && a.faults == 0));
    let (_, last) = states.last().unwrap();
    assert!(last.pressure[0] > 12e3 && last.duty[0] < 0.3, "{last:?}");
    assert_eq!(last.reasons & ActuationReason::PRESSURE_LIMITED, ActuationReason::PRESSURE_LIMITED);
    assert_eq!(last.limited & 1, 1);
}

#[test]
fn bladders_start_at_one_pressure_or_each_at_its_own() {
    let first = |valves: &str| {
        let run = run(&Said { valves, ..Said::default() }, 100);
        actuation(&run)[0].1.pressure[..3].iter().map(|p| p.round()).collect::<Vec<_>>()
    };
    assert_eq!(first("pressure: { start: [7 kPa] }"), [7e3; 3]);
    assert_eq!(first("pressure: { start: [7 kPa, 3.8 kPa, 0 Pa] }"), [7e3, 3.8e3, 0.0]);
    for none in ["[]", "[7 kPa, 7 kPa]", "[1 kPa, 1 kPa, 1 kPa, 1 kPa]"] {
        let description = Said { valves: &format!("pressure: {{ start: {none} }}"), ..Said::default() };
        let refused = stillpoint_testing::run(&text(&description), &registry(), &files(), 100).err().unwrap();
        assert!(refused.contains("give one for all or one for each"), "{refused}");
    }
}

#[test]
fn a_pressure_above_its_limit_is_a_fault() {
    // A taper that is too short for the inlets to be shut in time.
    let valves = "pressure: { start: [20 kPa], limit: 20.1 kPa, taper: 0.001 Pa }";
    let run = run(&Said { valves, ..Said::default() }, 1_500);
    let states = actuation(&run);
    let fault = first(&states, 500, |a| a.state() == State::Fault).unwrap();
    let vent = first(&states, 500, |a| a.order == 1).unwrap();
    let (_, last) = states.last().unwrap();
    assert_eq!((vent - fault, last.fault, last.faults), (LEAD, ActuationReason::PRESSURE, 1));
    // Venting lowers the estimate, too.
    assert!(last.pressure[0] < 20e3, "{}", last.pressure[0]);
}

#[test]
fn two_runs_send_the_same_bytes() {
    let description = Said { control: "fault: silent, from: 800 ms, to: 1200 ms", ..Said::default() };
    let (one, two) = (run(&description, 2_000), run(&description, 2_000));
    for topic in ["valves.datagram", "valves.state", "valves.diagnostics", "gate.datagram", "gate.state"] {
        assert!(!one.bytes(topic).is_empty());
        assert_eq!(one.bytes(topic), two.bytes(topic), "{topic}");
    }
}

/// Stamps of all orders, us, where commands come with this period and the valves act on each.
fn orders_us(every: &str) -> Vec<u64> {
    let text = text(&Said::default())
        .replace(
            "control: { use: test.controller, every: 10 ms",
            &format!("control: {{ use: test.controller, every: {every}"),
        )
        .replace("command: control.duties", "command: { from: control.duties, queue: 2 }");
    let run = stillpoint_testing::run(&text, &registry(), &files(), 1_000).unwrap();
    run.samples::<Datagram>("valves.datagram").iter().map(|s| (s.header.stamp - START) / 1_000).collect()
}

#[test]
fn an_order_follows_each_command_at_once_and_a_law_that_floods_does_not_flood_the_far_end() {
    let orders = orders_us("7 ms");
    for command in (0..=140).map(|k| 7_000 * k) {
        // A command right after an order waits for the next tick.
        let at = orders[orders.partition_point(|order| *order < command)];
        assert!(at == command || (command % 10_000 < 2_000 && at - command < 10_000), "{command}: {at}");
    }
    for every in ["100 us", "500 us"] {
        let orders = orders_us(every);
        assert!((450..=610).contains(&orders.len()), "{every}: {}", orders.len());
        let is_apart = |pair: &[u64]| pair[1] - pair[0] >= 2_000 || pair[1].is_multiple_of(10_000);
        assert!(orders.windows(2).all(is_apart), "{every}");
    }
}
