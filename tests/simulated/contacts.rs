//! Contact forces at run time: those that `control.contacts` computes are those of the rig.

use stillpoint_samples::{Actuation, ActuationReason as Reason, ActuationState, Contacts, RigState};

use crate::default_pipeline::seconds;
use crate::held_head::{SMALL, held, hold_bladders, moved, rms};

/// How far a computed force may be from that of the rig, N: pressures are estimated and the pose has noise.
const NEAR: f64 = 10.0;

#[test]
fn the_contacts_of_eight_bladders_push_as_the_rig_says() {
    let run = held("head-6dof.yaml", &[SMALL], 12_000);
    let (reported, truth) =
        (run.samples::<Contacts>("contacts.contacts"), run.samples::<RigState>("rig.state"));
    let mut count = 0;
    let (mut worst, mut least) = (0.0f64, f64::INFINITY);
    for sample in reported.iter().filter(|s| seconds(s.header.stamp) > 4.0) {
        let contacts = sample.first().unwrap();
        let rig = truth.iter().rfind(|s| s.header.stamp <= sample.header.stamp).unwrap().first().unwrap();
        assert_eq!((contacts.bladders, contacts.low), (8, 0), "{contacts:?}");
        for j in 0..8 {
            worst = worst.max((contacts.force[j] - rig.force[j]).abs());
            least = least.min(contacts.margin[j]);
            count += 1;
        }
    }
    eprintln!("{count} forces, at most {worst:.2} N from the rig's; least margin {least:.2} N");
    assert!(count > 1000 && worst < NEAR && least > -NEAR, "{count} {worst} {least}");
}

#[test]
fn a_bladder_that_hardly_touches_is_a_warning_at_once_and_then_a_fault() {
    // The rig's bladders above push with 13 to 15 N: a least force of 60 N is more than any of them has.
    let low = ("params: { rig: eight_bladders }", "params: { rig: eight_bladders, least: 60 N }");
    let connected = (
        "      acknowledgement: far.acknowledgement\n",
        "      acknowledgement: far.acknowledgement\n      contacts: contacts.contacts\n",
    );
    let run = held("head-6dof.yaml", &[SMALL, low, connected], 8_000);
    let states = run.samples::<Actuation>("valves.state");
    let armed = states.iter().find(|s| s.first().unwrap().state() == ActuationState::Armed).unwrap();
    let warned = states.iter().find(|s| s.first().unwrap().reasons & Reason::CONTACT_LOW != 0).unwrap();
    let fault = states.iter().find(|s| s.first().unwrap().state() == ActuationState::Fault).unwrap();
    let (armed, at) = (seconds(armed.header.stamp), seconds(fault.header.stamp));
    assert!(seconds(warned.header.stamp) < armed + 0.1, "warned at {}", seconds(warned.header.stamp));
    assert_eq!(fault.first().unwrap().fault, Reason::CONTACT_LOW);
    assert!((armed + 1.9..armed + 2.6).contains(&at), "armed at {armed}, fault at {at}");
}

#[test]
fn a_head_on_contacts_that_roll_is_held_and_the_contacts_of_the_rig_watch_over_it() {
    let rolling = ("motion: nods,", "motion: nods, contacts: rolling, friction: 0.5,");
    let connected = (
        "      acknowledgement: far.acknowledgement\n",
        "      acknowledgement: far.acknowledgement\n      contacts: rig.contacts\n",
    );
    let run = held("head-6dof.yaml", &[SMALL, rolling, connected], 12_000);
    hold_bladders(&run);
    let (reported, truth) =
        (run.samples::<Contacts>("contacts.contacts"), run.samples::<Contacts>("rig.contacts"));
    let (mut apart, mut least) = (0.0f64, f64::INFINITY);
    for sample in reported.iter().filter(|s| seconds(s.header.stamp) > 4.0) {
        let rig = truth.iter().rfind(|s| s.header.stamp <= sample.header.stamp).unwrap().first().unwrap();
        let reported = sample.first().unwrap();
        assert_eq!((rig.bladders, rig.low), (8, 0), "{rig:?}");
        for j in 0..8 {
            apart = apart.max((reported.force[j] - rig.force[j]).abs());
            least = least.min(rig.margin[j]);
            assert!(rig.margin[j] >= 0.0, "{rig:?}");
        }
    }
    let states = run.samples::<Actuation>("valves.state");
    let warned = Reason::CONTACT_LOW;
    assert!(states.iter().all(|s| s.first().unwrap().reasons & warned == 0));
    assert!(states.last().unwrap().first().unwrap().state() == ActuationState::Armed);
    let off = rms(&moved(&run)[400..]);
    eprintln!("forces at most {apart:.2} N apart, least margin {least:.2} N, {off:.2?} off");
    // The law and its contacts know of fixed contacts without friction.
    assert!(apart < NEAR, "{apart}");
    assert!(off.iter().all(|off| *off < 1.0), "{off:?}");
}
