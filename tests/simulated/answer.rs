//! A head that does not answer: actuation says so, and is a fault with its reason before long.

use stillpoint_samples::{
    Actuation, ActuationReason as Reason, ActuationState, Duties, DutyReason, FarEnd, Track,
};
use stillpoint_testing::Run;

use crate::default_pipeline::{default_pipeline, seconds};
use crate::held_head::{SMALL, held};

/// When things break: the head is on its way.
const BREAKS: f64 = 5.0;

/// The default pipeline with this fault of the rig, with few pixels.
fn broken(fault: &str, ms: u64, changes: &[(&str, &str)]) -> Run {
    let rig = format!(
        "motion: breathes, camera: {{ every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }}, \
         faults: [{{ {fault}, at: 5 s }}]"
    );
    let changes = [&[("motion: breathes, camera: { every: 100 ms }", rig.as_str())], changes].concat();
    default_pipeline(&changes, ms)
}

/// When and why it was a fault first.
fn fault(run: &Run) -> Option<(f64, u32)> {
    let states = run.samples::<Actuation>("valves.state");
    let first = states.iter().find(|s| s.first().unwrap().state() == ActuationState::Fault)?;
    Some((seconds(first.header.stamp), first.first().unwrap().fault))
}

/// Whether the beam was on at any time from here on, at the far end.
fn beam_after(run: &Run, from: f64) -> bool {
    let far = run.samples::<FarEnd>("far.state");
    far.iter().any(|s| seconds(s.header.stamp) > from && s.first().unwrap().beam == 1)
}

#[test]
fn lost_orders_an_empty_supply_and_leaks_become_a_fault_with_its_reason_and_end_the_beam() {
    for what in [
        "kind: lost_duties, left: 0.05",
        "kind: weak_supply, left: 0",
        "kind: leak, which: 0, diameter: 0.5 mm",
        "kind: leak, which: 1, diameter: 0.5 mm",
    ] {
        // The second leak is held for 17 s before the bladder is at its limit.
        let run = broken(what, 32_000, &[]);
        let duties = run.samples::<Duties>("law.duties");
        let output_text =
            duties.iter().find(|d| d.first().unwrap().reasons & DutyReason::TrackingError.bit() != 0);
        let output_text = output_text.map(|d| seconds(d.header.stamp));
        let (at, why) =
            fault(&run).unwrap_or_else(|| panic!("{what}: no fault; error said at {output_text:?}"));
        eprintln!(
            "{what}: error at {output_text:?}, fault at {at:.2} s: {:?}",
            Reason::words(why).collect::<Vec<_>>()
        );
        assert_ne!(why & Reason::TRACKING_ERROR, 0, "{what}: {why:#x}");
        let output_text = output_text.unwrap();
        assert!(
            output_text > BREAKS && at > output_text && at < output_text + 6.0,
            "{what}: {output_text} {at}"
        );
        // The lease of the beam ends within 100 ms.
        assert!(!beam_after(&run, at + 0.1), "{what}");
        // The reason stood in the state of actuation from the first moment of the error.
        let states = run.samples::<Actuation>("valves.state");
        let warned = states.iter().find(|s| s.first().unwrap().reasons & Reason::TRACKING_ERROR != 0);
        let warned = seconds(warned.unwrap().header.stamp);
        assert!(warned < output_text + 0.05, "{what}: {output_text} {warned}");
    }
}

#[test]
fn a_stuck_valve_and_a_leak_that_a_law_holds_are_a_fault_before_they_lose_the_head() {
    // Without this fault the head is held for half a minute, and then sinks: the estimate of a pressure is at its limit.
    for what in ["kind: stuck_valve, which: 1", "kind: leak, which: 2, diameter: 0.5 mm"] {
        let run = broken(what, 40_000, &[]);
        let (at, why) = fault(&run).unwrap_or_else(|| panic!("{what}: no fault"));
        eprintln!("{what}: fault at {at:.2} s: {:?}", Reason::words(why).collect::<Vec<_>>());
        assert_eq!(why, Reason::NO_EFFECT, "{what}: {why:#x}");
        assert!(at > BREAKS + 16.0 && !beam_after(&run, at + 0.1), "{what}: {at}");
        let tracks = run.samples::<Track>("filter.state");
        let held = tracks.iter().filter(|s| (15.0..at).contains(&seconds(s.header.stamp)));
        let heights = held.map(|s| s.first().unwrap().position[2]);
        let [least, most] = heights.fold([f64::MAX, f64::MIN], |[a, b], z| [a.min(z), b.max(z)]);
        assert!(most - least < 2e-3, "{what}: the head moved by {} m before", most - least);
    }
}

#[test]
fn orders_before_a_person_arms_are_not_held_against_the_valves() {
    // The law acts for half a minute, nothing follows it, and its integrals grow one-sided.
    let small =
        "motion: breathes, camera: { every: 100 ms, width: 160 px, height: 120 px, focal_length: 141 px }";
    let changes = [
        ("motion: breathes, camera: { every: 100 ms }", small),
        ("{ at: 1.5 s, say: arm, repeat: 500 ms }", "{ at: 35 s, say: arm, repeat: 500 ms }"),
    ];
    let run = default_pipeline(&changes, 60_000);
    assert_eq!(fault(&run), None);
    let last = |run: &Run| run.samples::<Actuation>("valves.state").last().unwrap().first().unwrap().state();
    assert_eq!(last(&run), ActuationState::Armed);
    let duties = run.samples::<Duties>("law.duties");
    assert!(duties.iter().all(|d| d.first().unwrap().reasons & DutyReason::NoEffect.bit() == 0));
}

#[test]
fn a_leak_that_measured_pressures_allow_for_is_a_warning() {
    let measured = "      disarm: console.disarm\n      measured: { from: rig.state, delay: 5 ms }\n";
    let run = broken(
        "kind: leak, which: 0, diameter: 0.5 mm",
        40_000,
        &[("      disarm: console.disarm\n", measured)],
    );
    assert_eq!(fault(&run), None);
    let states = run.samples::<Actuation>("valves.state");
    let last = states.last().unwrap().first().unwrap();
    assert_ne!(last.reasons & Reason::NO_EFFECT, 0, "{:#x}", last.reasons);
    assert!(beam_after(&run, 38.0));
}

#[test]
fn a_pressure_estimate_at_its_limit_during_an_error_is_the_sooner_fault() {
    // The supply is empty, so the estimate fills bladders that stay as they are.
    let slow =
        "params: { key: examples/data/rig.key, dead_band: 0.07, answer: { error_patience: 1 min } }\n  gate:";
    let run = broken(
        "kind: weak_supply, left: 0",
        40_000,
        &[("params: { key: examples/data/rig.key, dead_band: 0.07 }\n  gate:", slow)],
    );
    let (at, why) = fault(&run).expect("a fault");
    eprintln!("fault at {at:.2} s: {:?}", Reason::words(why).collect::<Vec<_>>());
    assert_eq!(why, Reason::TRACKING_ERROR | Reason::PRESSURE_DOUBTED);
    let states = run.samples::<Actuation>("valves.state");
    let estimated = |s: &stillpoint_samples::View<'_, Actuation>| {
        s.first().unwrap().pressure.iter().copied().fold(0.0, f64::max)
    };
    let highest = states.iter().filter(|s| seconds(s.header.stamp) < at).map(estimated).fold(0.0, f64::max);
    assert!(highest > 30e3, "{highest}");
    assert!(!beam_after(&run, at + 0.1));
}

#[test]
fn a_leak_and_lost_orders_between_eight_bladders_are_faults_too() {
    for what in ["kind: lost_duties, left: 0.05", "kind: leak, which: 0, diameter: 2 mm"] {
        let motion = format!("motion: nods, faults: [{{ {what}, at: 5 s }}]");
        let run = held("head-6dof.yaml", &[SMALL, ("motion: nods", &motion)], 30_000);
        let (at, why) = fault(&run).unwrap_or_else(|| panic!("{what}: no fault"));
        eprintln!("{what}: fault at {at:.2} s: {:?}", Reason::words(why).collect::<Vec<_>>());
        assert_ne!(why & Reason::TRACKING_ERROR, 0, "{what}: {why:#x}");
        assert!(at > BREAKS && !beam_after(&run, at + 0.1), "{what}: {at}");
    }
}
