//! What happens when something is missing or breaks.

use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{DepthImage, RigMode, RigState};
use stillpoint_testing::run;

use super::script::{STAGES, heights, last_state, simulate, text};

#[test]
fn when_duties_stop_the_rig_vents_by_itself() {
    let run = simulate(&text("three_bladders", "motion: still", "silent_from: 1 s"), 9000);
    let states = run.samples::<RigState>("rig.state");
    let vents = states.iter().position(|s| s.first().unwrap().mode() == RigMode::Venting).unwrap();
    // The last duties were made at 990 ms.
    assert!((105..=106).contains(&vents), "{vents}");
    let heights = heights(&run);
    assert!(heights[899] < heights[100] - 5e-3, "{} {}", heights[100], heights[899]);
    // It sinks onto the foam and stays there.
    assert!((heights[899] - heights[880]).abs() < 1e-3);
    let state = last_state(&run);
    assert!(state.pressure[..3].iter().all(|p| p.abs() < 2e3), "{state:?}");
    let speeds: Vec<f64> = heights.windows(2).map(|w| (w[1] - w[0]) / 0.01).collect();
    assert!(speeds.iter().all(|v| v.abs() < 0.03), "{:?}", speeds.iter().copied().fold(0.0, f64::min));
}

#[test]
fn a_rig_that_holds_keeps_the_head_up() {
    let run = simulate(&text("three_bladders", "motion: still, safe: hold", "silent_from: 1 s"), 4000);
    assert_eq!(last_state(&run).mode(), RigMode::Holding);
    let heights = heights(&run);
    assert!((heights[399] - heights[200]).abs() < 1e-5, "{} {}", heights[200], heights[399]);
}

#[test]
fn a_stuck_valve_keeps_its_opening() {
    let faults = "motion: still, faults: [{ kind: stuck_valve, which: 0, at: 1 s, lasts: 2 s }]";
    let run = simulate(&text("three_bladders", faults, "to: 1500 ms"), 3500);
    let states = run.samples::<RigState>("rig.state");
    let opening = |at: usize| states[at].first().unwrap().opening[0];
    assert!((opening(290) - 0.25).abs() < 1e-3 && opening(340) < 1e-3, "{} {}", opening(290), opening(340));
    assert_eq!((states[200].first().unwrap().faults, states[340].first().unwrap().faults), (1, 0));
}

#[test]
fn a_leak_lets_the_head_sink_and_a_lost_supply_does_not_lift_it() {
    let still = heights(&simulate(&text("three_bladders", "motion: still", "duty: 0"), 4000))[399];
    let leak = "motion: still, faults: [{ kind: leak, which: 0, at: 1 s, diameter: 0.5 mm }]";
    let leaking = heights(&simulate(&text("three_bladders", leak, "duty: 0"), 4000))[399];
    assert!(leaking < still - 1e-3, "{leaking} {still}");
    let supply = "motion: still, faults: [{ kind: weak_supply, left: 0.2, at: 0 s }]";
    let whole = heights(&simulate(&text("three_bladders", "motion: still", ""), 3000))[299];
    let weak = heights(&simulate(&text("three_bladders", supply, ""), 3000))[299];
    assert!(weak < whole - 1e-3, "{weak} {whole}");
}

#[test]
fn a_blind_camera_sends_empty_images_and_a_silent_one_none() {
    let faults =
        "faults: [{ kind: blind_camera, at: 1 s, lasts: 1 s }, { kind: silent_camera, at: 3 s, lasts: 1 s }]";
    let run = simulate(&text("three_bladders", faults, ""), 5000);
    let images = run.samples::<DepthImage>("rig.depth");
    assert_eq!(images.len(), 40);
    let empty = images.iter().filter(|i| i.elements.iter().all(|c| *c == 0)).count();
    assert_eq!(empty, 10);
}

#[test]
fn a_frozen_camera_sends_the_same_image_as_if_it_were_new() {
    let faults = "faults: [{ kind: frozen_camera, at: 1 s, lasts: 1 s }]";
    let run = simulate(&text("three_bladders", faults, ""), 3000);
    let images = run.samples::<DepthImage>("rig.depth");
    let is_same: Vec<bool> = images.windows(2).map(|pair| pair[0].elements == pair[1].elements).collect();
    assert!((0..29).all(|i| is_same[i] == (10..19).contains(&i)), "{is_same:?}");
    assert!(images.windows(2).all(|pair| pair[1].header.origin - pair[0].header.origin == 100_000_000));
    let states = run.samples::<RigState>("rig.state");
    assert_eq!([50, 150, 250].map(|tick| states[tick].first().unwrap().faults), [0, 64, 0]);
}

#[test]
fn a_camera_loses_the_part_of_its_images_that_the_config_says() {
    let lossy =
        text("three_bladders", "motion: still", "").replace("camera: { width", "camera: { lost: 0.3, width");
    let images = simulate(&lossy, 20_000).samples::<DepthImage>("rig.depth").len();
    assert!((110..170).contains(&images), "{images}");
}

#[test]
fn duties_for_another_number_of_valves_are_refused_and_the_rig_waits() {
    let run = simulate(&text("three_bladders", "motion: still", "valves: 2"), 1000);
    let state = last_state(&run);
    assert!(state.refused > 90 && state.mode() == RigMode::Waiting && state.duties_age.is_nan(), "{state:?}");
}

#[test]
fn what_cannot_be_is_refused_with_what_to_do() {
    let refused = |text: &str| {
        let registry = Registry::new(&[stillpoint_rig::STAGES, STAGES]);
        run(text, &registry, &MemoryFiles::default(), 100).err().unwrap()
    };
    let odd = text("three_bladders", "motion: still", "")
        .replace("camera: { width", "camera: { every: 33 ms, width");
    assert!(refused(&odd).contains("make the first a multiple of the second"), "{}", refused(&odd));
    let absent = text("one_bladder", "faults: [{ kind: leak, which: 1, at: 1 s }]", "valves: 2");
    assert!(
        refused(&absent).contains("invalid number of the bladder: 1 (allowed: 0 to 0)"),
        "{}",
        refused(&absent)
    );
}

#[test]
fn duties_that_all_get_lost_end_in_the_safe_state_until_they_come_again() {
    let faults = "motion: still, faults: [{ kind: lost_duties, at: 1 s, lasts: 500 ms }]";
    let run = simulate(&text("three_bladders", faults, ""), 3000);
    let mode = |tick: usize| run.samples::<RigState>("rig.state")[tick].first().unwrap().mode();
    assert_eq!((mode(90), mode(120), mode(299)), (RigMode::Driven, RigMode::Venting, RigMode::Driven));
    assert_eq!(run.samples::<RigState>("rig.state")[120].first().unwrap().faults, 32);
}

/// The rig of `text`, with a console that says these lines.
fn with_console(params: &str, script: &str, lines: &str) -> String {
    let console =
        format!("operators:\n  hand: {{ use: console, every: 20 ms, params: {{ script: [{lines}] }} }}");
    text("three_bladders", params, script)
        .replace("operators:", &console)
        .replace("duties: script.duties", "duties: script.duties, fault: hand.fault")
}

fn simulate_with_console(text: &str, ms: u64) -> stillpoint_testing::Run {
    let registry = Registry::new(&[stillpoint_testing::pipeline::STAGES, stillpoint_rig::STAGES, STAGES]);
    run(text, &registry, &MemoryFiles::default(), ms).unwrap()
}

#[test]
fn what_a_person_breaks_acts_until_it_is_over_or_mended() {
    // A leak of 1 mm in bladder 0 for 500 ms, then a stuck valve until it is mended.
    let lines = "{ at: 1 s, say: fault, values: [2, 0, 0.001, 0.5] }, { at: 2 s, say: fault, values: [1, 3] }, \
                 { at: 2500 ms, say: fault, values: [0] }";
    let run = simulate_with_console(&with_console("motion: still", "duty: 0", lines), 3000);
    assert!(run.failed().is_empty(), "{:?}", run.failed());
    let states = run.samples::<RigState>("rig.state");
    let acting = |ms: usize| states[ms / 10].first().unwrap().faults;
    assert_eq!([acting(980), acting(1100), acting(1480), acting(1540)], [0, 2, 2, 0]);
    assert_eq!([acting(1980), acting(2100), acting(2480), acting(2540)], [0, 1, 1, 0]);
    let heights = heights(&run);
    assert!(heights[150] < heights[99] - 1e-4, "{} {}", heights[150], heights[99]);
    // A command brings no tick of its own.
    assert_eq!(states.len(), 300);
}

#[test]
fn a_fault_that_makes_no_sense_fails_its_activation_and_nothing_else() {
    let lines = "{ at: 1 s, say: fault, values: [1, 6] }, { at: 1200 ms, say: fault, values: [3] }";
    let run = simulate_with_console(&with_console("motion: still", "", lines), 2000);
    assert_eq!(run.failed(), ["rig", "rig"]);
    assert_eq!(run.samples::<RigState>("rig.state").len(), 200);
}

#[test]
fn a_far_end_that_vents_lets_the_air_out_into_the_room() {
    // Duties that ask for the vent come without end; no bladder goes below the room's pressure.
    for kind in ["three_bladders", "eight_bladders"] {
        let valves = if kind == "three_bladders" { 6 } else { 16 };
        let script = format!("valves: {valves}, duty: 0, vent_from: 1 s");
        let run = simulate(&text(kind, "motion: still", &script), 6000);
        let states = run.samples::<RigState>("rig.state");
        assert_eq!(states[150].first().unwrap().mode(), RigMode::Venting, "{kind}");
        let bladders = valves / 2;
        let lowest = states.iter().flat_map(|s| s.first().unwrap().pressure[..bladders].to_vec());
        let lowest = lowest.fold(f64::INFINITY, f64::min);
        assert!(lowest > -1e3, "{kind}: {lowest} Pa");
        let last = last_state(&run);
        assert!(last.pressure[..bladders].iter().all(|p| p.abs() < 3e3), "{kind}: {:?}", last.pressure);
    }
}
