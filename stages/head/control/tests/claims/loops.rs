//! `control.target` and the controllers in closed loops, simulated.

use stillpoint_samples::{DutiesElement, DutyReason, Target, TargetStatus};
use stillpoint_testing::Run;

use super::plants::{closed_loop, duties, truth};

/// The dissertation's step, 2 s after the start is known.
pub const STEP: &str = "moves: [{ at: 2 s, z: 11.5 mm, pitch: 1.35 deg, roll: 10 deg }]";
const LAWS: [&str; 3] =
    ["control.pi, every: 10 ms", "control.lqg, every: 10 ms", "control.mrac, every: 10 ms"];

fn degrees(rad: f64) -> f64 {
    rad.to_degrees()
}

/// The greatest distance from where it began, mm and degrees, less the dissertation's step, from `from` seconds on.
pub fn worst_after(run: &Run, from: f64) -> [f64; 3] {
    let truth = truth(run);
    let start = truth[0].1;
    truth.iter().filter(|(t, _)| *t >= from).fold([0.0_f64; 3], |worst, (_, at)| {
        let moved = [(at[0] - start[0]) * 1e3, degrees(at[1] - start[1]), degrees(at[2] - start[2])];
        std::array::from_fn(|i| worst[i].max((moved[i] - [11.5, 1.35, 10.0][i]).abs()))
    })
}

fn is_shut(duties: &DutiesElement) -> bool {
    duties.idle == 1 && duties.duty == [0.0; 16] && duties.net == [0.0; 8]
}

/// When the height has gone the tenth and the nine tenths of its way, s.
pub fn rise(run: &Run) -> f64 {
    let truth = truth(run);
    let height = |part: f64| truth[0].1[0] + part * 0.0115;
    let when = |level: f64| truth.iter().find(|(_, at)| at[0] >= level).unwrap().0;
    when(height(0.9)) - when(height(0.1))
}

#[test]
fn every_law_brings_a_drifting_head_to_its_target_as_the_reference_model_says() {
    for law in LAWS {
        let run = closed_loop("", STEP, law, 80);
        let worst = worst_after(&run, 70.0);
        assert!(worst[0] < 0.5 && worst[1] < 0.2 && worst[2] < 0.2, "{law}: {worst:?}");
        // The drift is not known at first, so the head lags a little and then catches up.
        println!("{law}: rise {:.1} s", rise(&run));
        assert!((rise(&run) - 20.0).abs() < 1.0, "{law}: {}", rise(&run));
        for (t, duties) in duties(&run).iter().skip(200) {
            assert_eq!((duties.idle, duties.reasons & DutyReason::Saturated.bit()), (0, 0), "{law} at {t}");
        }
    }
}

#[test]
fn a_breath_of_any_frequency_is_answered_ahead() {
    for hertz in [0.19, 0.26] {
        let head = format!("breath: {hertz} Hz, noise: 0.02 mm, angle_noise: 0.01 deg");
        for law in ["control.pi", "control.mrac"] {
            let run = |motion: &str| {
                let law =
                    format!("{law}, every: 20 ms, params: {{ rise: 5 s, plant: {{ motion: {motion} }} }}");
                worst_after(&closed_loop(&head, STEP, &law, 60), 40.0)
            };
            let (ignored, learned) = (run("ignored"), run("learned"));
            println!("{law}, {hertz} Hz: ignored {ignored:.3?}, learned {learned:.3?}, mm and degrees");
            for i in 0..2 {
                assert!(learned[i] < 0.6 * ignored[i], "{law}, {hertz} Hz: {ignored:?} {learned:?}");
            }
        }
    }
}

#[test]
fn every_law_brings_the_head_on_the_rig_to_its_target() {
    for law in LAWS {
        let run = closed_loop("kinetics: rig, noise: 0.1 mm, angle_noise: 0.1 deg", STEP, law, 120);
        let worst = worst_after(&run, 62.0);
        println!("{law}: worst from 62 s {worst:.3?} mm and degrees, rise {:.1} s", rise(&run));
        assert!(worst[0] < 0.5 && worst[1] < 0.4 && worst[2] < 0.3, "{law}: {worst:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let run = || closed_loop("kinetics: rig, noise: 0.3 mm", STEP, LAWS[2], 10);
    let (first, second) = (run(), run());
    for topic in ["law.duties", "law.diagnostics", "target.reference"] {
        assert!(!first.bytes(topic).is_empty() && first.bytes(topic) == second.bytes(topic), "{topic}");
    }
}

#[test]
fn without_an_estimate_all_valves_are_shut_and_the_reason_is_said() {
    for law in LAWS {
        let run = closed_loop("opens: 1 s", "", law, 2);
        let all = duties(&run);
        let before: Vec<_> = all.iter().filter(|(t, _)| *t < 0.99).collect();
        assert!(before.len() > 90);
        for (_, duties) in before {
            assert!(is_shut(duties) && duties.reasons & DutyReason::NoEstimate.bit() != 0, "{law}");
        }
        // The target needs half a second to find the start.
        let (_, settling) = all.iter().find(|(t, _)| *t > 1.3).unwrap();
        assert!(is_shut(settling) && settling.reasons & DutyReason::NoTarget.bit() != 0, "{law}");
        assert_eq!((all.last().unwrap().1.idle, all.last().unwrap().1.valves), (0, 6));
    }
}

#[test]
fn what_makes_a_controller_idle_makes_it_so_in_time_and_it_comes_back_without_a_jump() {
    let cases = [
        ("silent", DutyReason::Stale),
        ("none", DutyReason::NoEstimate),
        ("predicted", DutyReason::Stale),
        ("nan", DutyReason::NotFinite),
    ];
    for law in LAWS {
        for (fault, reason) in cases {
            let head = format!("fault: {fault}, begin: 6 s, end: 8 s");
            let all = duties(&closed_loop(&head, STEP, law, 10));
            let at = |time: f64| &all.iter().find(|(t, _)| *t >= time).unwrap().1;
            assert_eq!(at(5.9).idle, 0, "{law} {fault}");
            // The last good estimate was acquired at 5.9 s and is good for 300 ms.
            for time in [6.22, 7.0, 7.9] {
                let duties = at(time);
                assert!(is_shut(duties), "{law} {fault} at {time}: {duties:?}");
                assert!(duties.reasons & reason.bit() != 0, "{law} {fault}: {:b}", duties.reasons);
            }
            let back = at(8.05);
            assert_eq!(back.idle, 0, "{law} {fault}: {back:?}");
            let greatest = back.net.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            assert!(greatest < 0.12, "{law} {fault}: {greatest}");
        }
    }
}

#[test]
fn one_bladder_holds_one_channel() {
    let one = "params: { plant: { channels: [z], bladders: [{ z: 13 mm/s }] }, rise: 4 s }";
    for law in LAWS {
        let law = format!("{law}, {one}");
        let target = "channels: [z], moves: [{ at: 1 s, z: 10 mm }]";
        let run = closed_loop("kinetics: one_bladder, noise: 0.2 mm", target, &law, 30);
        let truth = truth(&run);
        let (start, end) = (truth[0].1[0], truth.last().unwrap().1[0]);
        assert!((end - start - 0.010).abs() < 5e-4, "{law}: {}", (end - start) * 1e3);
        assert_eq!(duties(&run).last().unwrap().1.valves, 2);
    }
}

#[test]
fn what_the_bladders_do_follows_from_the_rig() {
    let law = "control.mrac, every: 10 ms, params: { plant: { rig: three_bladders } }";
    let worst = worst_after(&closed_loop("kinetics: rig", STEP, law, 70), 60.0);
    assert!(worst[0] < 0.2 && worst[1] < 0.1 && worst[2] < 0.1, "{worst:?}");
    let law = "control.mrac, every: 10 ms, params: { plant: { rig: one_bladder, channels: [z] }, rise: 4 s }";
    let target = "channels: [z], rig: one_bladder, moves: [{ at: 1 s, z: 10 mm }]";
    let truth = truth(&closed_loop("kinetics: one_bladder", target, law, 30));
    assert!((truth.last().unwrap().1[0] - truth[0].1[0] - 0.010).abs() < 2e-4);
}

#[test]
fn a_saturated_valve_freezes_the_adaptation_and_is_said() {
    let law = "control.mrac, every: 10 ms, params: { rise: 0.2 s }";
    let target = "moves: [{ at: 1 s, z: 20 mm }]";
    let all = duties(&closed_loop("", target, law, 4));
    let saturated = all.iter().filter(|(_, d)| d.saturated != 0).collect::<Vec<_>>();
    assert!(!saturated.is_empty());
    for (_, duties) in saturated {
        let both = DutyReason::Saturated.bit() | DutyReason::Frozen.bit();
        assert_eq!(duties.reasons & both, both);
    }
}

#[test]
fn a_target_that_moves_says_so_and_is_followed() {
    let target =
        "moves: [{ at: 1 s, over: 10 s, profile: smooth, z: 8 mm }, { at: 12 s, over: 4 s, z: 4 mm }]";
    let law = "control.lqg, every: 10 ms, params: { rise: 0.5 s }";
    let run = closed_loop("", target, law, 40);
    let samples = run.samples::<Target>("target.reference");
    let statuses: Vec<TargetStatus> = samples.iter().map(|s| s.first().unwrap().status()).collect();
    assert_eq!((statuses[0], *statuses.last().unwrap()), (TargetStatus::None, TargetStatus::Held));
    let moving = statuses.iter().filter(|s| **s == TargetStatus::Moving).count();
    assert!((276..=284).contains(&moving), "14 s of ticks at 50 ms: {moving}");
    let truth = truth(&run);
    assert!((truth.last().unwrap().1[0] - truth[0].1[0] - 0.004).abs() < 1e-4);
}
