//! `control.target` on a bench: commands, refusals, and what a config may not say.

use proptest::prelude::*;
use stillpoint_operator::Stage;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{
    Command, ConsoleCommand, Diagnostics, Refusal, Standing, Target, TargetElement, TargetStatus, Track,
    TrackElement, Verb,
};
use stillpoint_testing::Bench;
use stillpoint_testing::bench::Left;

const TEXT: &str = "
stillpoint: 1
name: goal
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
  console: { use: console, every: 20 ms }
  feed: { use: feed.track, frame: couch }
  target:
    use: control.target
    every: 50 ms
    inputs: { state: feed.out, command: console.target, capture: console.capture }
    params: { settle: 0 s }
";

fn bench(params: &str) -> Result<Bench, String> {
    let text = TEXT.replace("settle: 0 s", &format!("settle: 0 s, {params}"));
    let stages: Vec<Stage> = [stillpoint_testing::pipeline::STAGES, stillpoint_control::STAGES].concat();
    Bench::new(&text, "target", &stages, &MemoryFiles::default())
}

fn track(z: f64, pitch: f64) -> TrackElement {
    let half = 0.5 * pitch;
    TrackElement {
        position: [0.0, 0.0, z],
        orientation: [half.cos(), half.sin(), 0.0, 0.0],
        channels: 0x3f,
        accepted: 1,
        standing: Standing::Measured as u32,
        ..TrackElement::NONE
    }
}

fn target(left: &Left) -> TargetElement {
    assert_eq!(left.fault, None);
    *left.outputs[0].1.pieces().view::<Target>().unwrap().first().unwrap()
}

fn see(bench: &mut Bench, z: f64, pitch: f64) -> TargetElement {
    target(&bench.feed::<Track>(0, &(), &[track(z, pitch)], 0))
}

fn ask(bench: &mut Bench, values: &[f64]) -> TargetElement {
    let mut command = Command { verb: Verb::Target as u32, given: values.len() as u32, ..Command::default() };
    command.values[..values.len()].copy_from_slice(values);
    target(&bench.feed::<ConsoleCommand>(1, &(), &[command], 0))
}

#[test]
fn the_head_is_held_where_it_is_found() {
    let mut bench = bench("").unwrap();
    let found = see(&mut bench, 0.15, 0.2);
    assert_eq!((found.status(), found.position[2]), (TargetStatus::Held, 0.15));
    assert!((found.angles[0] - 0.2).abs() < 1e-12 && found.angles[1].abs() < 1e-12);
    assert!(found.position[0].is_nan() && found.angles[2].is_nan());
    assert_eq!((found.channels, found.asked, found.refusal), (0b01_1100, 0, 0));
    assert_eq!(see(&mut bench, 0.16, 0.1).position[2], 0.15);
}

#[test]
fn the_start_is_the_mean_of_the_first_estimates() {
    let text = TEXT.replace("settle: 0 s", "settle: 30 ms");
    let stages: Vec<Stage> = [stillpoint_testing::pipeline::STAGES, stillpoint_control::STAGES].concat();
    let mut bench = Bench::new(&text, "target", &stages, &MemoryFiles::default()).unwrap();
    for z in [0.10, 0.12, 0.14] {
        assert_eq!(see(&mut bench, z, 0.0).status(), TargetStatus::None);
    }
    assert!((see(&mut bench, 0.16, 0.0).position[2] - 0.13).abs() < 1e-12);
}

#[test]
fn a_person_moves_the_target_from_where_the_head_was_found() {
    let mut bench = bench("").unwrap();
    see(&mut bench, 0.15, 0.0);
    let asked = ask(&mut bench, &[0.01, 0.02, -0.1]);
    assert!((asked.position[2] - 0.16).abs() < 1e-12 && (asked.angles[0] - 0.02).abs() < 1e-12);
    assert_eq!((asked.status(), asked.asked), (TargetStatus::Held, 1));
}

#[test]
fn a_target_may_be_counted_from_the_frame_and_approached_over_time() {
    let mut bench = bench("channels: [z], counted_from: frame, command_over: 100 ms").unwrap();
    see(&mut bench, 0.15, 0.0);
    assert_eq!(ask(&mut bench, &[0.16]).status(), TargetStatus::Moving);
    let halfway = (0..5).map(|_| see(&mut bench, 0.15, 0.0)).last().unwrap();
    assert!((halfway.position[2] - 0.155).abs() < 1e-9 && (halfway.velocity[2] - 0.1).abs() < 1e-9);
}

#[test]
fn what_is_not_reachable_is_refused_and_the_target_before_stands() {
    let mut bench = bench("").unwrap();
    assert_eq!(ask(&mut bench, &[0.0, 0.0, 0.0]).refusal, Refusal::NoStart as u32);
    see(&mut bench, 0.15, 0.0);
    ask(&mut bench, &[0.005, 0.0, 0.0]);
    for (values, refusal, unreachable) in [
        (&[0.03, 0.0, 0.0][..], Refusal::Unreachable, 0b00_0100),
        (&[0.0, 0.3, -0.4], Refusal::Unreachable, 0b01_1000),
        (&[0.0, 0.0], Refusal::WrongNumber, 0),
        (&[f64::NAN, 0.0, 0.0], Refusal::NotFinite, 0),
    ] {
        let refused = ask(&mut bench, values);
        assert_eq!((refused.refusal, refused.unreachable), (refusal as u32, unreachable), "{values:?}");
        assert_eq!(refused.status(), TargetStatus::Refused);
        assert!((refused.position[2] - 0.155).abs() < 1e-12);
    }
    let good = ask(&mut bench, &[0.0, 0.0, 0.0]);
    assert_eq!((good.status(), good.refusal, good.asked), (TargetStatus::Held, 0, 7));
}

#[test]
fn what_the_rigs_bladders_cannot_hold_is_refused_and_the_bladder_is_named() {
    let wide = "reach: { z: [-100 mm, 100 mm], pitch: [-90 deg, 90 deg], roll: [-90 deg, 90 deg] }";
    let mut bench = bench(&format!("{wide}, rig: three_bladders")).unwrap();
    see(&mut bench, 0.15, 0.0);
    assert_eq!(ask(&mut bench, &[0.0115, 0.0236, 0.1745]).refusal, 0);
    let command = Command {
        verb: Verb::Target as u32,
        given: 3,
        values: [0.0115, 0.0236, 1.2, 0.0, 0.0, 0.0],
        ..Command::default()
    };
    let left = bench.feed::<ConsoleCommand>(1, &(), &[command], 0);
    let refused = target(&left);
    assert_eq!((refused.refusal, refused.unreachable), (Refusal::Unreachable as u32, 0b1_0000));
    let view = left.outputs[1].1.pieces().view::<Diagnostics>().unwrap();
    let bladder = view.elements.iter().find(|m| m.name() == "bladder_in_the_way").unwrap().value;
    assert!((0.0..3.0).contains(&bladder), "{bladder}");
    let error = self::bench(&format!("{wide}, rig: three_bladders, moves: [{{ roll: 70 deg }}]"))
        .map(|_| ())
        .unwrap_err();
    assert!(error.contains("`moves[0]` cannot be held: bladder"), "{error}");
}

#[test]
fn a_capture_holds_the_head_where_it_is_then_and_repeats_no_move() {
    let mut bench = bench("moves: [{ at: 0 s, z: 5 mm }]").unwrap();
    assert!((see(&mut bench, 0.15, 0.0).position[2] - 0.155).abs() < 1e-12);
    let command = Command { verb: Verb::Capture as u32, ..Command::default() };
    let captured = target(&bench.feed::<ConsoleCommand>(2, &(), &[command], 0));
    assert_eq!(captured.status(), TargetStatus::None);
    assert!((see(&mut bench, 0.154, 0.0).position[2] - 0.154).abs() < 1e-12);
}

#[test]
fn configs_that_cannot_be_are_refused_with_the_place() {
    for (params, words) in [
        (
            "moves: [{ z: 5 mm }, { at: 1 s, z: 40 mm }]",
            "`moves[1].z` is 0.04 m, and the bladders reach from -0.015 to 0.025 m",
        ),
        ("moves: [{ x: 5 mm }]", "`moves[0]` moves x, which is not held"),
        (
            "channels: [z, x], rig: three_bladders",
            "`channels` has x, and the bladders of `rig` move z, pitch, roll",
        ),
        ("moves: [{ at: 1 s }]", "`moves[0]` moves nothing"),
        (
            "moves: [{ at: 2 s, z: 1 mm }, { at: 1 s, z: 2 mm }]",
            "`moves[1]` begins at 1 s, before the move above it at 2 s",
        ),
        ("channels: []", "`channels`: name at least one channel"),
        ("channels: [z, z]", "`channels`: z is named twice"),
        ("reach: { z: [-1 mm, 1 mm] }", "`reach` lacks pitch"),
        ("reach: { z: [1 mm, 2 mm], pitch: [0 deg, 0 deg], roll: [0 deg, 0 deg] }", "`reach.z` is from"),
        ("moves: [{ z: 5 }]", "unit"),
        ("channels: [zz]", "zz"),
    ] {
        let error = bench(params).map(|_| ()).unwrap_err();
        assert!(error.contains(words), "{params}: {error}");
    }
}

proptest! {
    #[test]
    fn no_command_takes_the_target_out_of_reach(
        asked in prop::collection::vec(prop::collection::vec(prop_oneof![
            4 => -0.05..0.05f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(1e300),
        ], 0..6), 1..20),
    ) {
        let mut bench = bench("").unwrap();
        see(&mut bench, 0.15, 0.1);
        for values in asked {
            let now = ask(&mut bench, &values);
            prop_assert!((-0.015 - 1e-12..=0.025 + 1e-12).contains(&(now.position[2] - 0.15)), "{now:?}");
            prop_assert!(now.angles[0].is_finite() && now.angles[1].is_finite());
        }
    }
}
