//! Orders that get lost between sender and far end: the sender knows it from the acknowledgements.

use proptest::prelude::*;
use stillpoint_actuate::acknowledgement::{Acknowledgement, LONGEST};
use stillpoint_actuate::far_watch::{FarWatch, FarWatchParams};
use stillpoint_actuate::{DatagramRefusal, Session};
use stillpoint_operator::{Activation, Operator, Outputs, Params, Registry, Setup};
use stillpoint_operator::{
    FrameRule, Input, Kind, Output, Policy, Role, SetupError, Stage, StepError, Timer,
};
use stillpoint_samples::{
    ActuationReason as Reason, ActuationState as State, Datagram, Diagnostics, FarEndDoing, Sample,
};
use stillpoint_testing::run::{Run, START};

use super::sent::{key, session};
use super::whole::{Said, actuation, files, text};

const MS: u64 = 1_000_000;

fn description(number: u64, sequence: u64, accepted: u64) -> Acknowledgement {
    Acknowledgement {
        doing: FarEndDoing::Following,
        beam: true,
        session: session(1),
        sequence,
        order_stamp: sequence * 10 * MS,
        accepted,
        refused: 0,
        far: Session { started: 5, nonce: 9 },
        number,
        stamp: 77,
        bladders: 3,
        pressure: [1e3, 2e3, 3.5e3, 0.0, 0.0, 0.0, 0.0, 0.0],
    }
}

fn bytes(description: &Acknowledgement) -> Vec<u8> {
    let mut room = [0; LONGEST];
    let length = description.encode(&key(), &mut room);
    room[..length].to_vec()
}

fn watch() -> FarWatch {
    FarWatch::new(key(), FarWatchParams { silence: 80 * MS })
}

proptest! {
    #[test]
    fn an_acknowledgement_is_read_as_it_was_written_and_no_changed_byte_passes(
        numbers in prop::array::uniform5(0..u64::MAX / 20_000_000),
        bladders in 0..=8usize,
        place in 0..200usize,
        bit in 0..8u32,
    ) {
        let mut description = description(numbers[0], numbers[1], numbers[1].min(numbers[2]));
        (description.refused, description.order_stamp, description.bladders) = (numbers[3], numbers[4], bladders);
        for (j, pressure) in description.pressure.iter_mut().enumerate() {
            *pressure = if j < bladders { 100.0 * j as f32 } else { 0.0 };
        }
        let mut bytes = bytes(&description);
        prop_assert_eq!(Acknowledgement::decode(&bytes, &key()), Ok(description));
        let place = place % bytes.len();
        bytes[place] ^= 1 << bit;
        prop_assert!(Acknowledgement::decode(&bytes, &key()).is_err());
    }
}

#[test]
fn nothing_that_was_recorded_makes_an_order_newer_than_it_is() {
    let (own, sent) = (session(1), 100);
    let mut watch = watch();
    assert_eq!(watch.missing(0), Reason::NO_ANSWER);
    let (first, second) = (bytes(&description(3, 10, 11)), bytes(&description(4, 12, 13)));
    watch.take(&first, own, sent, 110 * MS).unwrap();
    watch.take(&second, own, sent, 130 * MS).unwrap();
    assert_eq!((watch.age(190 * MS), watch.missing(200 * MS)), (Some(70 * MS), 0));
    // Played back, reordered, of another session, of a far end that is gone, of orders that nobody sent, of another key.
    let mut other = description(5, 13, 14);
    other.session = session(2);
    let mut gone = description(9, 13, 14);
    gone.far.started = 4;
    let mut backwards = description(6, 11, 12);
    backwards.order_stamp = 900 * MS;
    let mut forged = bytes(&description(7, 13, 14));
    *forged.last_mut().unwrap() ^= 1;
    for (bytes, why) in [
        (second, DatagramRefusal::Repeated),
        (first, DatagramRefusal::Old),
        (bytes(&other), DatagramRefusal::Recipient),
        (bytes(&gone), DatagramRefusal::OldSession),
        (bytes(&backwards), DatagramRefusal::Malformed),
        (bytes(&description(8, 100, 101)), DatagramRefusal::Malformed),
        (forged, DatagramRefusal::Forged),
    ] {
        assert_eq!(watch.take(&bytes, own, sent, 140 * MS), Err(why));
    }
    assert_eq!((watch.refused(), watch.lost()), (7, 0));
    assert_eq!(watch.missing(201 * MS), Reason::NO_ANSWER);
    // The far end says it has no order yet: nobody is refused, and nothing is known.
    let mut none = description(10, 0, 0);
    (none.session, none.order_stamp) = (Session::default(), 0);
    assert_eq!(watch.take(&bytes(&none), own, sent, 210 * MS), Ok(()));
    assert_eq!(watch.missing(210 * MS), Reason::NO_ANSWER);
}

#[test]
fn lost_orders_are_counted_over_a_far_end_that_starts_again() {
    let (own, sent) = (session(1), 100);
    let mut watch = watch();
    watch.take(&bytes(&description(0, 9, 8)), own, sent, 0).unwrap();
    assert_eq!((watch.lost(), watch.warnings(0)), (2, Reason::ORDERS_LOST));
    assert_eq!(watch.warnings(1000 * MS), 0);
    let mut repeated = description(0, 29, 15);
    repeated.far.started = 6;
    watch.take(&bytes(&repeated), own, sent, 2000 * MS).unwrap();
    // 30 were sent, 8 and 15 arrived.
    assert_eq!((watch.lost(), watch.warnings(2000 * MS)), (7, Reason::ORDERS_LOST));
}

/// What a wire loses.
#[derive(Clone, Params)]
struct WireParams {
    /// From when on datagrams are lost, since the start.
    #[param(unit = "ns", default = "1 h")]
    from: u64,
    /// Until when.
    #[param(unit = "ns", default = "1 h")]
    to: u64,
    /// Of this many in a row one gets through; 0 for none.
    #[param(default = 0)]
    passes: u64,
}

/// A wire that loses datagrams.
struct Wire {
    params: WireParams,
    count: u64,
}

impl Operator for Wire {
    type Params = WireParams;
    const KIND: Kind = Kind {
        name: "test.wire",
        about: "Loses datagrams.",
        role: Role::Operator,
        inputs: &[Input {
            name: "datagram",
            sample: Datagram::KIND,
            policy: Policy::Queue(64),
            required: true,
            about: "Datagrams.",
        }],
        outputs: &[Output {
            name: "datagram",
            sample: Datagram::KIND,
            frame: FrameRule::None,
            about: "Those that get through.",
        }],
        timer: Timer::No,
    };

    fn new(params: WireParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self { params, count: 0 })
    }

    fn capacities(_: &WireParams) -> Vec<usize> {
        vec![1024]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let Some(view) = activation.fresh::<Datagram>(0) else { return Ok(()) };
        self.count += 1;
        let WireParams { from, to, passes } = self.params;
        let is_bad = (from..to).contains(&(activation.time - START));
        if is_bad && (passes == 0 || !self.count.is_multiple_of(passes)) {
            return Ok(());
        }
        outputs.send_slice::<Datagram>(0, &(), view.elements)
    }
}

const WIRE: &[Stage] = &[Stage::of::<Wire>()];

/// Valves and far end, with wires of these parameters between them, there and back.
fn run(there: &str, back: &str, ms: u64) -> Run {
    let wires = format!(
        "  there: {{ use: test.wire, inputs: {{ datagram: {{ from: valves.datagram, delay: 2 ms }} }}, params: {{ {there} }} }}
  back: {{ use: test.wire, inputs: {{ datagram: {{ from: far.acknowledgement, delay: 2 ms }} }}, params: {{ {back} }} }}
  far: {{ use: actuate.far_end, every: 2 ms, params: {{ key: rig.key, acknowledge_every: 20 ms }}, inputs: {{ valves: there.datagram }} }}
"
    );
    let text = text(&Said::default())
        .replace("vent: person.vent }", "vent: person.vent, acknowledgement: back.datagram }");
    assert!(text.contains("back.datagram"));
    let registry: Registry = Registry::new(&[super::script::STAGES, stillpoint_actuate::STAGES, WIRE]);
    let run = stillpoint_testing::run(&(text + &wires), &registry, &files(), ms).unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    run
}

fn metric(run: &Run, name: &str) -> f64 {
    let reported = run.samples::<Diagnostics>("valves.diagnostics");
    reported.last().unwrap().elements.iter().find(|m| m.name() == name).unwrap().value
}

#[test]
fn a_wire_that_loses_nothing_is_acknowledged_in_time() {
    let run = run("", "", 2_000);
    let states = actuation(&run);
    assert!(
        states.iter().all(|(ms, a)| (*ms >= 500) == (a.state() == State::Armed)),
        "armed as without answers"
    );
    assert!(states.iter().skip(5).all(|(_, a)| a.reasons & (Reason::NO_ANSWER | Reason::ORDERS_LOST) == 0));
    assert_eq!((metric(&run, "orders_lost"), metric(&run, "acknowledgements_refused")), (0.0, 0.0));
    // A period of acknowledgements, one of orders and the way there and back, at most.
    assert!(metric(&run, "acknowledged_age_s") < 0.040, "{}", metric(&run, "acknowledged_age_s"));
    // One order a tick, and one at the command of the person: acknowledgements send none.
    let sent = run.samples::<Datagram>("valves.datagram").len();
    assert!((200..=202).contains(&sent), "{sent}");
}

#[test]
fn without_a_far_end_nothing_is_armed() {
    let run = run("from: 0 s", "", 1_000);
    let states = actuation(&run);
    assert!(states.iter().all(|(_, a)| a.state() == State::Disarmed && a.reasons & Reason::NO_ANSWER != 0));
    let last = states.last().unwrap().1;
    assert_eq!((last.refused, last.lacking), (1, Reason::NO_ANSWER));
}

#[test]
fn lost_orders_and_lost_answers_are_known_within_100_ms_and_end_in_the_safe_state_and_a_fault() {
    for (there, back) in [("from: 1 s", ""), ("", "from: 1 s")] {
        let run = run(there, back, 7_500);
        let states = actuation(&run);
        let first = |holds: &dyn Fn(&State, u32) -> bool| {
            states.iter().find(|(ms, a)| *ms > 600 && holds(&a.state(), a.reasons)).map(|(ms, _)| *ms)
        };
        let known = first(&|_, reasons| reasons & Reason::NO_ANSWER != 0).unwrap();
        assert!((1_000..=1_100).contains(&known), "{there} {back}: {known}");
        // It holds at once, and vents when the beam is off.
        assert_eq!(first(&|state, _| *state != State::Armed), Some(known));
        assert_eq!(first(&|state, _| *state == State::Venting), Some(known + 40));
        // A fault after the patience of 5 s, with its reason.
        let (at, fault) = states.iter().find(|(_, a)| a.state() == State::Fault).unwrap();
        assert!((known + 4_900..known + 5_100).contains(at), "{at}");
        assert_eq!(fault.fault, Reason::NO_ANSWER | Reason::TOO_LONG);
    }
}

#[test]
fn a_wire_that_comes_back_is_followed_again_and_what_it_lost_is_counted() {
    let run = run("from: 1 s, to: 1500 ms", "", 2_500);
    let states = actuation(&run);
    assert_eq!(states.last().unwrap().1.state(), State::Armed);
    assert_eq!(metric(&run, "orders_lost"), 50.0);
}

#[test]
fn a_few_orders_that_get_lost_are_a_warning_within_100_ms() {
    // Every second one arrives: the lives of orders bridge that, and the sender says so.
    let run = run("from: 1 s, to: 1100 ms, passes: 2", "", 2_500);
    let states = actuation(&run);
    assert!(states.iter().filter(|(ms, _)| *ms > 500).all(|(_, a)| a.state() == State::Armed));
    let warned: Vec<u64> =
        states.iter().filter(|(_, a)| a.reasons & Reason::ORDERS_LOST != 0).map(|(ms, _)| *ms).collect();
    assert!((1_000..1_060).contains(&warned[0]), "{}", warned[0]);
    let end = *warned.last().unwrap();
    assert!((2_050..2_160).contains(&end), "{end}");
    assert_eq!(metric(&run, "orders_lost"), 5.0);
}
