//! What the head does, and what the camera sees of it.

use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{DepthImage, Pose, RigMode};
use stillpoint_testing::Bench;

use super::script::{STAGES, heights, last_state, pitch, simulate, text};

#[test]
fn a_still_head_with_shut_valves_stays_where_it_is() {
    let run = simulate(&text("three_bladders", "motion: still", "duty: 0"), 3000);
    let heights = heights(&run);
    assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-9), "{heights:?}");
    let state = last_state(&run);
    assert_eq!((state.mode(), state.bladders, state.faults, state.unmodelled), (RigMode::Driven, 3, 0, 0));
    assert!(state.pressure[..3].iter().all(|p| (1e3..5e4).contains(p)), "{state:?}");
}

#[test]
fn poses_come_at_the_rigs_rate_and_images_at_the_cameras() {
    let run = simulate(&text("three_bladders", "motion: still", ""), 1000);
    let images = run.samples::<DepthImage>("rig.depth");
    assert_eq!((images.len(), run.samples::<Pose>("rig.truth").len()), (10, 100));
    for pair in images.windows(2) {
        assert_eq!(pair[1].header.stamp - pair[0].header.stamp, 100_000_000);
        // The duties behind it are older than what it shows.
        assert_eq!(pair[1].header.origin, pair[1].header.stamp);
    }
}

/// The reference trajectory `c_rig_3dof_traj`: after 2.5 s the base's inlet was open for 2 s at 0.25.
#[test]
fn the_head_follows_the_plant_of_the_reference() {
    let run = simulate(&text("three_bladders", "motion: still", ""), 2510);
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/vectors/c_rig_3dof_traj.json");
    let file: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let y = &file["cases"][0]["out"]["y"];
    let row = |n: usize| [0, 1].map(|i| y[n][i].as_f64().unwrap());
    let (start, end) = (row(0), row(10));
    let heights = heights(&run);
    let rise = heights[250] - heights[0];
    assert!((rise - (end[0] - start[0])).abs() < 1e-6, "{rise} {}", end[0] - start[0]);
    let turn = pitch(&run, 250);
    assert!((turn - (end[1] - start[1])).abs() < 1e-5, "{turn} {}", end[1] - start[1]);
}

#[test]
fn the_camera_sees_the_head_rise() {
    let run = simulate(&text("one_bladder", "motion: still", "valves: 2, duty: 0.5"), 3000);
    let heights = heights(&run);
    let rise = heights[299] - heights[0];
    assert!(rise > 8e-3, "{rise}");
    let images = run.samples::<DepthImage>("rig.depth");
    // The middle of the image shows the face, from 45 degrees above the feet.
    let depth = |image: usize| {
        let counts = &images[image].elements;
        let patch: Vec<f64> =
            (0..400).map(|i| f64::from(counts[(50 + i / 20) * 160 + 70 + i % 20])).collect();
        let seen: Vec<f64> = patch.into_iter().filter(|c| *c > 0.0).collect();
        seen.iter().sum::<f64>() / seen.len() as f64 * 1e-4
    };
    let nearer = depth(0) - depth(29);
    assert!(nearer > 0.3 * rise && nearer < 1.7 * rise, "{nearer} {rise}");
}

#[test]
fn a_head_that_nothing_controls_moves_about_as_far_as_its_habit_says() {
    let run = simulate(&text("three_bladders", "motion: nods, seed: 3", "duty: 0"), 12_000);
    let turns: Vec<f64> = (0..1200).map(|i| pitch(&run, i).to_degrees()).collect();
    let (least, greatest) = turns.iter().fold((0.0, 0.0), |(l, g): (f64, f64), t| (l.min(*t), g.max(*t)));
    assert!((-2.5..-1.0).contains(&least) && (1.0..2.5).contains(&greatest), "{least} {greatest}");
}

#[test]
fn each_of_the_six_directions_moves_between_eight_bladders() {
    // The four from below: duty on their inlets lifts the head; on one of them it also turns it.
    let still = simulate(&text("eight_bladders", "motion: still", "valves: 16, duty: 0"), 2000);
    let heights = heights(&still);
    assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-8), "{:?}", heights.last());
    let state = last_state(&still);
    assert_eq!((state.bladders, state.unmodelled), (8, 0));
    assert!(state.force.iter().all(|f| *f > 5.0), "{state:?}");
    let one = simulate(&text("eight_bladders", "motion: still", "valves: 16, valve: 0, duty: 0.3"), 3000);
    let poses = one.samples::<Pose>("rig.truth");
    let (first, last) = (*poses[0].first().unwrap(), *poses[299].first().unwrap());
    for i in 0..3 {
        let moved = (last.position[i] - first.position[i]).abs();
        assert!((2e-4..3e-2).contains(&moved), "{i}: {moved}");
        assert!((1e-3..0.3).contains(&last.orientation[i + 1].abs()), "{:?}", last.orientation);
    }
}

#[test]
fn a_heavier_head_rests_on_more_pressure() {
    let base = |params: &str| {
        last_state(&simulate(&text("one_bladder", params, "valves: 2, duty: 0"), 100)).pressure[0]
    };
    let (light, heavy) = (base("head_mass: 3 kg, motion: still"), base("head_mass: 6 kg, motion: still"));
    assert!(heavy > 1.3 * light, "{light} {heavy}");
}

#[test]
fn the_bytes_depend_on_the_seeds_and_on_nothing_else() {
    let bytes = |text: &str| {
        let run = simulate(text, 1000);
        [run.bytes("rig.depth"), run.bytes("rig.truth"), run.bytes("rig.state")].concat()
    };
    let one = text("three_bladders", "seed: 7", "");
    assert!(bytes(&one) == bytes(&one));
    assert!(bytes(&one) != bytes(&text("three_bladders", "seed: 8", "")));
    assert!(bytes(&one) != bytes(&one.replace("seed: 7\nframes", "seed: 9\nframes")));
    let padded = |bytes| {
        let stages = [stillpoint_rig::STAGES, STAGES].concat();
        let bench = Bench::new(&one, "rig", &stages, &MemoryFiles::default()).unwrap();
        let mut bench = bench.padded(bytes);
        (0..30).flat_map(|_| bench.tick().bytes()).collect::<Vec<u8>>()
    };
    assert!(padded(0) == padded(13));
}

#[test]
fn a_push_moves_the_head_about_as_far_as_it_says_and_lets_it_go_again() {
    let pushes = "motion: still, pushes: [{ at: 1 s, lasts: 2 s, shift: [0 mm, 0 mm, 3 mm], turn: [2 deg, 0 deg, 0 deg] }]";
    let run = simulate(&text("three_bladders", pushes, "duty: 0"), 6000);
    let heights = heights(&run);
    let (rise, turn) = (heights[299] - heights[0], pitch(&run, 299).to_degrees());
    assert!((1.5e-3..4.5e-3).contains(&rise) && (1.0..3.5).contains(&turn), "{rise} {turn}");
    assert!((heights[599] - heights[0]).abs() < 2e-4 && pitch(&run, 599).to_degrees().abs() < 0.1);
}

#[test]
fn a_rig_that_sucks_for_long_comes_to_rest_on_its_foam() {
    let run =
        simulate(&text("three_bladders", "motion: still", "valve: 1, duty: 1, from: 0 s, to: 1 h"), 20_000);
    let heights = heights(&run);
    assert!(heights.iter().all(|z| z.is_finite()) && (heights[1999] - heights[1900]).abs() < 1e-4);
    let state = last_state(&run);
    assert!(state.pressure.iter().chain(&state.gap).chain(&state.force).all(|x| x.is_finite()), "{state:?}");
    assert_eq!(state.force[0], 0.0);
}

#[test]
fn further_cameras_see_the_same_head_from_their_own_places() {
    let view = "  view: { use: rig.view, every: 50 ms, frame: above, inputs: { truth: rig.truth }, params: { noise: kinect_v2, width: 160 px, height: 120 px, focal_length: 141 px } }\n";
    let frame =
        "frames: { above: { parent: couch, at: [0 mm, 0 mm, 720 mm], rotation: [180 deg, 0 deg, 0 deg] }, ";
    let text =
        text("one_bladder", "motion: still", "valves: 2, duty: 0.5").replace("frames: { ", frame) + view;
    let run = simulate(&text, 3000);
    let images = run.samples::<DepthImage>("view.depth");
    assert_eq!((images.len(), run.samples::<DepthImage>("rig.depth").len()), (60, 30));
    // Straight from above, the face comes nearer by as much as it rises.
    let depth = |image: usize| {
        let counts = &images[image].elements;
        let patch =
            (0..400).map(|i| f64::from(counts[(50 + i / 20) * 160 + 70 + i % 20])).filter(|c| *c > 0.0);
        let patch: Vec<f64> = patch.collect();
        patch.iter().sum::<f64>() / patch.len() as f64 * 1e-4
    };
    let heights = heights(&run);
    let (rise, nearer) = (heights[295] - heights[0], depth(0) - depth(59));
    assert!(rise > 8e-3 && (nearer - rise).abs() < 2e-3, "{nearer} {rise}");
}

/// Height 0.8 s after a fill of 2 s and 9 s later, from the start, m.
fn filled(kind: &str, imperfect: &str) -> [f64; 2] {
    let valves = if kind == "one_bladder" { 2 } else { 6 };
    let params = format!("motion: still, {imperfect}");
    let heights = heights(&simulate(&text(kind, &params, &format!("valves: {valves}, duty: 0.25")), 12_600));
    [heights[330] - heights[0], heights[1259] - heights[0]]
}

#[test]
fn rubber_creeps_after_a_fill_and_friction_holds_a_head_back() {
    let [ideal, ideal_later] = filled("one_bladder", "creep: 0");
    let [stiff, crept] = filled("one_bladder", "creep: 0.05");
    // The air stays. A wall that was just stretched pushes harder than the elastic one, and lets the head sink to where
    // that would hold it.
    assert!((ideal_later - ideal).abs() < 2e-5, "{ideal} {ideal_later}");
    assert!(
        stiff > ideal + 5e-5 && crept < stiff - 5e-5 && crept > ideal_later - 1e-6,
        "{stiff} {crept} {ideal}"
    );
    // The side bladders of the rig with three hold the head that the base lifts; a bladder by itself is not rubbed.
    let [free, _] = filled("three_bladders", "friction: 0");
    let [rolling, _] = filled("three_bladders", "friction: 0.03");
    let [sliding, _] = filled("three_bladders", "friction: 0.5");
    assert!(sliding < rolling && rolling < free && sliding > 0.2 * free, "{sliding} {rolling} {free}");
    assert_eq!(filled("one_bladder", "friction: 0.5"), [ideal, ideal_later]);
}

#[test]
fn valves_that_wait_move_the_head_later_and_as_far() {
    let [ideal, later] = filled("one_bladder", "creep: 0");
    let [delayed, end] = filled("one_bladder", "valve_delay: 40 ms, valve_spread: 0");
    // A fill of the same length moves the head as far.
    assert!(
        (delayed - ideal).abs() < 0.02 * ideal && (end - later).abs() < 1e-5,
        "{delayed} {ideal} {end} {later}"
    );
    let ramp =
        |params: &str| heights(&simulate(&text("one_bladder", params, "valves: 2, duty: 0.25"), 2_000));
    let (now, late) = (ramp("motion: still"), ramp("motion: still, valve_delay: 40 ms, valve_spread: 0"));
    let worst = (60..190).map(|k| (late[k + 4] - now[k]).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst}");
}
