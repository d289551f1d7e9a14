//! The states of actuation.

use proptest::prelude::*;
use stillpoint_actuate::machine::{Asked, Machine, Rules, Seen};
use stillpoint_actuate::{Order, Safe};
use stillpoint_samples::{ActuationReason as Reason, ActuationState as State};

const MS: u64 = 1_000_000;

fn rules(safe: Safe) -> Rules {
    Rules { safe, lead: 20 * MS, settle: 100 * MS, patience: 5_000 * MS }
}

fn seen(ms: u64) -> Seen {
    Seen { now: ms * MS, reference: Some((1, 0)), ..Seen::default() }
}

/// A machine that is armed at 0 ms.
fn armed(safe: Safe) -> Machine {
    let mut machine = Machine::new(rules(safe));
    machine.ask(Asked::Arm, &seen(0));
    assert_eq!(machine.look(&seen(0)), Order::Follow);
    machine
}

fn state(machine: &Machine) -> (State, u32) {
    (machine.state(), machine.reasons())
}

#[test]
fn nothing_moves_until_a_person_arms() {
    let mut machine = Machine::new(rules(Safe::Vent));
    for ms in 0..1_000 {
        assert_eq!(machine.look(&seen(ms)), Order::Hold);
    }
    assert_eq!(state(&machine), (State::Disarmed, Reason::NOT_ARMED));
    machine.ask(Asked::Arm, &seen(1_000));
    assert_eq!((machine.look(&seen(1_000)), machine.state()), (Order::Follow, State::Armed));
    machine.ask(Asked::Disarm, &seen(1_001));
    assert_eq!((machine.look(&seen(1_001)), machine.state()), (Order::Hold, State::Disarmed));
}

#[test]
fn arming_is_refused_for_each_thing_that_is_missing_and_says_which() {
    for bit in [Reason::REFERENCE, Reason::EXTRINSIC] {
        let mut machine = Machine::new(rules(Safe::Vent));
        machine.ask(Asked::Arm, &Seen { unready: bit, ..seen(0) });
        assert_eq!((machine.look(&seen(1)), machine.refused()), (Order::Hold, (1, bit)));
    }
    for bit in [Reason::NO_POSE, Reason::POSE_STALE, Reason::NO_COMMAND, Reason::COMMAND_STALE] {
        let mut machine = Machine::new(rules(Safe::Vent));
        machine.ask(Asked::Arm, &Seen { missing: bit, ..seen(0) });
        assert_eq!((machine.look(&seen(1)), machine.refused()), (Order::Hold, (1, bit)));
    }
    let mut machine = Machine::new(rules(Safe::Vent));
    machine.ask(Asked::Arm, &Seen { faults: Reason::POSE_NOT_FINITE, ..seen(0) });
    machine.ask(Asked::Resume, &seen(0));
    assert_eq!((machine.look(&seen(1)), machine.refused()), (Order::Hold, (2, Reason::NOT_ARMED)));
}

#[test]
fn what_is_missing_holds_for_the_lead_and_then_vents_and_goes_by_itself_once_it_settles() {
    let mut machine = armed(Safe::Vent);
    let stale = |ms: u64| Seen { missing: Reason::POSE_STALE, ..seen(ms) };
    assert_eq!(machine.look(&stale(10)), Order::Hold);
    assert_eq!(state(&machine), (State::Holding, Reason::POSE_STALE));
    assert_eq!(machine.look(&stale(29)), Order::Hold);
    assert_eq!(machine.look(&stale(30)), Order::Vent);
    assert_eq!(state(&machine), (State::Venting, Reason::POSE_STALE));
    // Fresh again, once, and gone again: no flutter.
    assert_eq!(machine.look(&seen(40)), Order::Vent);
    assert_eq!(state(&machine), (State::Venting, Reason::SETTLING));
    assert_eq!(machine.look(&stale(50)), Order::Vent);
    for ms in (60..160).step_by(10) {
        assert_eq!(machine.look(&seen(ms)), Order::Vent, "{ms}");
    }
    assert_eq!(machine.look(&seen(160)), Order::Follow);
    assert_eq!(state(&machine), (State::Armed, 0));
    assert_eq!(machine.faults(), (0, 0));
}

#[test]
fn what_was_missing_for_less_than_the_lead_is_followed_again_at_once() {
    let mut machine = armed(Safe::Vent);
    for ms in [10, 40, 70] {
        let stale = Seen { missing: Reason::POSE_STALE, ..seen(ms) };
        assert_eq!((machine.look(&stale), machine.look(&seen(ms + 15))), (Order::Hold, Order::Follow));
    }
    assert_eq!(state(&machine), (State::Armed, 0));
}

#[test]
fn a_safe_state_of_holding_never_vents_but_for_a_person() {
    let mut machine = armed(Safe::Hold);
    for ms in 1..20_000 {
        let order = machine.look(&Seen { missing: Reason::COMMAND_STALE, ..seen(ms) });
        assert_eq!(order, Order::Hold);
    }
    assert_eq!(machine.state(), State::Fault);
    machine.ask(Asked::Vent, &seen(20_000));
    assert_eq!(machine.look(&seen(20_000)), Order::Vent);
}

#[test]
fn what_is_missing_for_too_long_waits_for_a_person() {
    let mut machine = armed(Safe::Vent);
    for ms in (10..=5_010).step_by(10) {
        machine.look(&Seen { missing: Reason::COMMAND_STALE, ..seen(ms) });
    }
    let why = Reason::COMMAND_STALE | Reason::TOO_LONG;
    assert_eq!((state(&machine), machine.faults()), ((State::Fault, why), (1, why)));
    assert_eq!(machine.look(&seen(6_000)), Order::Vent);
    machine.ask(Asked::Arm, &seen(6_001));
    assert_eq!((machine.look(&seen(6_001)), machine.refused()), (Order::Vent, (1, why)));
    machine.ask(Asked::Resume, &Seen { missing: Reason::NO_POSE, ..seen(6_002) });
    assert_eq!((machine.look(&seen(6_002)), machine.refused()), (Order::Vent, (2, Reason::NO_POSE)));
    machine.ask(Asked::Resume, &seen(6_003));
    assert_eq!(machine.look(&seen(6_003)), Order::Follow);
}

#[test]
fn what_comes_and_goes_waits_for_a_person_too_where_it_is_missing_for_much_of_the_time() {
    // Of each second something is missing for so many ms.
    let fault_after = |missing: u64| {
        let mut machine = armed(Safe::Vent);
        (10..200_000).step_by(10).find(|ms| {
            let bits = if ms % 1_000 < missing { Reason::POSE_STALE } else { 0 };
            machine.look(&Seen { missing: bits, ..seen(*ms) });
            machine.state() == State::Fault
        })
    };
    assert_eq!((fault_after(100), fault_after(200)), (None, None));
    // A half less a quarter of the other half is 0.375 s each second.
    assert!(fault_after(500).is_some_and(|ms| (12_000..15_000).contains(&ms)), "{:?}", fault_after(500));
    assert!(fault_after(1_000).is_some_and(|ms| (4_990..5_020).contains(&ms)));
}

#[test]
fn numbers_that_are_none_and_pressure_are_faults_at_once() {
    let bits = [Reason::POSE_NOT_FINITE, Reason::COMMAND_NOT_FINITE, Reason::COMMAND_SHAPE, Reason::PRESSURE];
    for bit in bits {
        let mut machine = armed(Safe::Vent);
        assert_eq!(machine.look(&Seen { faults: bit, ..seen(10) }), Order::Hold);
        assert_eq!(state(&machine), (State::Fault, bit));
        // It stays, though its cause is gone.
        assert_eq!((machine.look(&seen(20)), machine.look(&seen(30))), (Order::Hold, Order::Vent));
        assert_eq!(machine.faults(), (1, bit));
    }
}

#[test]
fn an_idle_controller_shuts_the_valves_for_as_long_as_it_likes() {
    let mut machine = armed(Safe::Vent);
    for ms in 1..20_000 {
        assert_eq!(machine.look(&Seen { is_idle: true, ..seen(ms) }), Order::Hold);
    }
    assert_eq!(state(&machine), (State::Holding, Reason::IDLE));
    assert_eq!(machine.look(&seen(20_000)), Order::Follow);
    // Nothing was followed for long: what goes missing now vents at once.
    machine.look(&Seen { is_idle: true, ..seen(20_001) });
    let order = machine.look(&Seen { missing: Reason::NO_POSE, is_idle: true, ..seen(30_000) });
    assert_eq!(order, Order::Vent);
}

#[test]
fn a_person_vents_from_any_state_and_only_a_person_ends_it() {
    let mut machine = armed(Safe::Hold);
    machine.ask(Asked::Vent, &seen(10));
    assert_eq!((machine.look(&seen(10)), state(&machine)), (Order::Hold, (State::Venting, Reason::ASKED)));
    assert_eq!((machine.look(&seen(30)), machine.look(&seen(9_000))), (Order::Vent, Order::Vent));
    machine.ask(Asked::Arm, &seen(9_001));
    assert_eq!((machine.look(&seen(9_001)), machine.refused()), (Order::Vent, (1, Reason::ASKED)));
    machine.ask(Asked::Disarm, &seen(9_002));
    assert_eq!((machine.look(&seen(9_002)), machine.state()), (Order::Hold, State::Disarmed));
}

#[test]
fn another_reference_while_it_vents_is_a_fault_that_vents_on() {
    let mut machine = armed(Safe::Vent);
    for ms in [10, 30] {
        machine.look(&Seen { missing: Reason::POSE_STALE, ..seen(ms) });
    }
    assert_eq!(machine.state(), State::Venting);
    let other = |ms: u64| Seen { reference: Some((1, 1)), ..seen(ms) };
    for ms in 31..500 {
        assert_eq!(machine.look(&other(ms)), Order::Vent);
    }
    assert_eq!(
        (state(&machine), machine.faults()),
        ((State::Fault, Reason::REFERENCE), (1, Reason::REFERENCE))
    );
    machine.ask(Asked::Resume, &other(500));
    assert_eq!(machine.look(&other(500)), Order::Follow);
}

#[test]
fn another_reference_of_the_same_tracker_disarms() {
    let mut machine = armed(Safe::Vent);
    assert_eq!(machine.look(&Seen { reference: Some((2, 0)), ..seen(10) }), Order::Hold);
    assert_eq!((machine.state(), machine.refused().1), (State::Disarmed, Reason::REFERENCE));
}

#[test]
fn a_reference_that_died_with_its_tracker_is_a_fault_though_poses_come_again_in_time() {
    for other in [None, Some((1, 1)), Some((2, 1))] {
        let mut machine = armed(Safe::Vent);
        let look = |machine: &mut Machine, ms| machine.look(&Seen { reference: other, ..seen(ms) });
        assert_eq!((look(&mut machine, 10), look(&mut machine, 30)), (Order::Hold, Order::Vent));
        assert_eq!(state(&machine), (State::Fault, Reason::REFERENCE));
    }
}

/// Something that may happen.
fn happening() -> impl Strategy<Value = (Option<Asked>, u32, u32, u32, bool, u64)> {
    let asked = prop_oneof![
        10 => Just(None),
        2 => Just(Some(Asked::Arm)),
        1 => Just(Some(Asked::Disarm)),
        1 => Just(Some(Asked::Resume)),
        1 => Just(Some(Asked::Vent)),
    ];
    let rare = |bit: u32| prop_oneof![9 => Just(0), 1 => Just(bit)];
    let idle = prop::bool::weighted(0.1);
    (asked, rare(Reason::PRESSURE), rare(Reason::POSE_STALE), rare(Reason::REFERENCE), idle, 1..15u64)
}

proptest! {
    #[test]
    fn it_follows_only_what_is_whole_and_holds_before_it_vents(
        happenings in prop::collection::vec(happening(), 1..300),
        vents in any::<bool>(),
    ) {
        let safe = if vents { Safe::Vent } else { Safe::Hold };
        let mut machine = Machine::new(rules(safe));
        let (mut ms, mut followed_at, mut armed_by_person) = (0, None, false);
        for (asked, faults, missing, unready, is_idle, step) in happenings {
            ms += step;
            let seen = Seen { faults, missing, unready, is_idle, ..seen(ms) };
            if let Some(asked) = asked {
                machine.ask(asked, &seen);
                armed_by_person |= matches!(asked, Asked::Arm | Asked::Resume);
            }
            let order = machine.look(&seen);
            match order {
                Order::Follow => {
                    prop_assert!(armed_by_person && faults | missing == 0 && !is_idle);
                    prop_assert_eq!(state(&machine), (State::Armed, 0));
                    followed_at = Some(ms);
                }
                // Held for at least the lead since the last order to follow, under a state that says so.
                Order::Vent => prop_assert!(followed_at.is_none_or(|at| ms - at >= 20)),
                Order::Hold => {}
            }
            prop_assert_eq!(machine.state() == State::Armed, order == Order::Follow);
            prop_assert!(machine.state() == State::Armed || machine.reasons() != 0);
        }
    }
}

#[test]
fn a_face_that_moves_holds_the_valves_and_never_vents_nor_faults() {
    let mut machine = armed(Safe::Vent);
    let face = |ms: u64| Seen { is_face: true, ..seen(ms) };
    for ms in (10..3_000).step_by(10) {
        assert_eq!(machine.look(&face(ms)), Order::Hold, "{ms}");
        assert_eq!(state(&machine), (State::Holding, Reason::FACE_MOVES), "{ms}");
    }
    assert_eq!(machine.look(&seen(3_000)), Order::Follow);
    assert_eq!((machine.state(), machine.faults().0), (State::Armed, 0));
    // A pose that goes stale meanwhile is answered as ever.
    let stale = |ms: u64| Seen { missing: Reason::POSE_STALE, ..face(ms) };
    let orders: Vec<Order> = (3_010..3_400).step_by(10).map(|ms| machine.look(&stale(ms))).collect();
    assert_eq!(orders.last(), Some(&Order::Vent));
}
