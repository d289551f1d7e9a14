//! What the rig tells of its contacts, fixed and rolling.

use std::collections::BTreeMap;

use stillpoint_samples::{Contacts, ContactsElement, Diagnostics, Pose, RigState};
use stillpoint_testing::Run;

use super::script::{heights, simulate, text};

fn reported(run: &Run) -> Vec<ContactsElement> {
    run.samples::<Contacts>("rig.contacts").iter().map(|c| *c.first().unwrap()).collect()
}

/// The metrics of each sample of `rig.diagnostics`.
fn metrics(run: &Run) -> Vec<BTreeMap<String, f64>> {
    let samples = run.samples::<Diagnostics>("rig.diagnostics");
    let named = |elements: &[stillpoint_samples::Metric]| {
        elements.iter().map(|m| (m.name().into(), m.value)).collect()
    };
    samples.iter().map(|sample| named(sample.elements)).collect()
}

/// A head that nods and coughs between bladders of which one fills.
fn nodding(kind: &str, contacts: &str) -> Run {
    let valves = if kind == "three_bladders" { 6 } else { 16 };
    let params = format!("motion: nods, seed: 3, {contacts}");
    simulate(&text(kind, &params, &format!("valves: {valves}, duty: 0.1")), 6000)
}

#[test]
fn contacts_that_roll_push_and_stay_in_their_cones() {
    for (kind, friction) in [("three_bladders", 0.02), ("eight_bladders", 0.1)] {
        let run = nodding(kind, &format!("contacts: rolling, friction: {friction}"));
        let contacts = reported(&run);
        let states = run.samples::<RigState>("rig.state");
        assert_eq!((contacts.len(), states.len()), (600, 600));
        let mut slid = 0;
        for (reported, state) in contacts.iter().zip(&states) {
            let (state, bladders) = (state.first().unwrap(), reported.bladders as usize);
            assert_eq!((reported.force, reported.gap), (state.force, state.gap));
            for j in 0..bladders {
                assert!(reported.force[j] >= 0.0 && reported.margin[j] >= -1e-12, "{reported:?}");
                let due = friction * reported.force[j] - reported.tangential[j];
                assert!((reported.margin[j] - due).abs() < 1e-12, "{reported:?}");
            }
            slid += reported.slides.count_ones();
        }
        assert!(slid > 20, "{kind}: {slid}");
    }
}

#[test]
fn the_rig_tells_the_mobility_of_its_head() {
    // Without friction each of the eight contacts slides and spins: three more freedoms than where it sticks.
    let free = metrics(&simulate(&text("eight_bladders", "motion: still", "valves: 16, duty: 0"), 500));
    assert_eq!(free.len(), 1, "{free:?}");
    assert_eq!((free[0]["mobility"], free[0]["contacts_sliding"]), (6.0 + 3.0 * 8.0, 8.0));
    let stuck = "motion: still, contacts: rolling, friction: 0.5";
    let stuck = metrics(&simulate(&text("eight_bladders", stuck, "valves: 16, duty: 0"), 500));
    assert_eq!((stuck[0]["mobility"], stuck[0]["contacts_touching"]), (6.0, 8.0));
    assert_eq!(stuck.len(), 1, "{stuck:?}");
    // A head that nods makes contacts slide and stick again.
    let nods = metrics(&nodding("eight_bladders", "contacts: rolling, friction: 0.1"));
    assert!(nods.iter().any(|m| m["contacts_sliding"] > 0.0), "{nods:?}");
    assert!(nods.len() > 3 && nods.iter().all(|m| m["mobility"] >= 6.0), "{nods:?}");
}

#[test]
fn a_still_head_on_contacts_that_roll_stays_where_it_is() {
    for (kind, valves) in [("three_bladders", 6), ("eight_bladders", 16), ("one_bladder", 2)] {
        for friction in [0.0, 0.5] {
            let params = format!("motion: still, contacts: rolling, friction: {friction}");
            let run = simulate(&text(kind, &params, &format!("valves: {valves}, duty: 0")), 2000);
            let heights = heights(&run);
            assert!(heights.iter().all(|z| (z - heights[0]).abs() < 1e-8), "{kind} {friction} {heights:?}");
        }
    }
}

#[test]
fn the_bytes_of_contacts_that_roll_are_always_the_same() {
    let bytes = |contacts: &str| {
        let run = nodding("eight_bladders", contacts);
        ["rig.depth", "rig.truth", "rig.state", "rig.contacts", "rig.diagnostics"]
            .map(|topic| run.bytes(topic))
            .concat()
    };
    let rolling = "contacts: rolling, friction: 0.3";
    assert!(bytes(rolling) == bytes(rolling));
    assert!(bytes(rolling) != bytes("contacts: fixed, friction: 0.3"));
}

#[test]
fn a_bladder_that_fills_moves_the_head_alike_over_fixed_and_rolling_contacts() {
    let end = |contacts: &str| {
        let params = format!("motion: still, {contacts}");
        let run = simulate(&text("three_bladders", &params, "duty: 0.1"), 3500);
        let poses = run.samples::<Pose>("rig.truth");
        let [first, last] = [0, 349].map(|i| *poses[i].first().unwrap());
        (last.position[2] - first.position[2], last.orientation[1])
    };
    let (fixed, rolling) = (end("contacts: fixed"), end("contacts: rolling"));
    assert!(fixed.0 > 1e-3 && (rolling.0 / fixed.0 - 1.0).abs() < 0.03, "{fixed:?} {rolling:?}");
    assert!((rolling.1 / fixed.1 - 1.0).abs() < 0.03, "{fixed:?} {rolling:?}");
}
