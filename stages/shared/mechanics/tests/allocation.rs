//! What runs in a loop of control allocates nothing.

#![allow(clippy::unwrap_used)]

use allocation_counter::measure;
use nalgebra::{SVector, Vector3};
use stillpoint_mechanics::plant::grip::Grip;
use stillpoint_mechanics::plant::layouts::{START_GAP, rolling};
use stillpoint_mechanics::plant::{Limits, SixDof, State, ThreeDof};
use stillpoint_mechanics::shell::Shell;

#[test]
fn a_plants_step_allocates_nothing() {
    let three = ThreeDof::rig(5.0);
    let air = three.start_air();
    let start = State::at_rest(three.equilibrium(&air, Vector3::zeros()).unwrap(), air);
    let mut drive = three.idle();
    drive.duty[0] = [0.3, 0.0];
    let mut end = start;
    let counted = measure(|| end = three.advance(&start, &drive, 1e-3));
    assert_eq!(counted.count_total, 0);
    assert!(end.air[0] > start.air[0]);
}

#[test]
fn asking_whether_a_pose_can_be_held_allocates_nothing() {
    let eight = SixDof::rig(5.0);
    let (pose, requested) = (SVector::from([2e-3, 0.0, 5e-3, 0.02, 0.0, 0.03]), SVector::repeat(20.0));
    let mut held = None;
    let counted = measure(|| held = Some(eight.reach(&pose, &Limits::RIG, &requested)));
    assert_eq!(counted.count_total, 0);
    assert!(held.unwrap().is_ok());
}

#[test]
fn a_step_with_contacts_that_roll_allocates_nothing() {
    let channels = [0, 1, 2, 3, 4, 5];
    let contacts = rolling(&channels, 5.0, &Shell::rig()).unwrap();
    let eight = SixDof::rig(5.0).with_rolling(contacts.clone());
    let start = State::at_rest(SVector::zeros(), eight.start_air());
    let mut grip = Grip::<8>::new(0.5, &eight.shell, START_GAP);
    let mut drive = eight.idle();
    drive.duty[0] = [0.3, 0.0];
    let mut end = start;
    let counted = measure(|| {
        drive.held = Some(grip.held(&contacts, &start.position));
        end = eight.advance(&start, &drive, 1e-3);
        let pressed = eight.bladders(&end.position, &end.air);
        grip.advance(&contacts, &start.position, &end.position, &pressed);
    });
    assert_eq!(counted.count_total, 0);
    assert!(end.air[0] > start.air[0]);
}
