//! Policies and accounts of the intake, on heads alone.

use std::collections::VecDeque;

use super::*;
use crate::graph::{Edge, InputNode, OperatorNode};
use crate::operator::{FrameRule, Kind, Operator, Role, SetupError, Stage, StepError, Timer};
use crate::params::CheckedParams;
use stillpoint_operator::{Activation, Outputs, Setup};

struct Nothing;

impl Operator for Nothing {
    type Params = ();
    const KIND: Kind = Kind {
        name: "test.nothing",
        about: "Does nothing.",
        role: Role::Operator,
        inputs: &[],
        outputs: &[],
        timer: Timer::Optional,
    };
    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        let _ = FrameRule::None;
        Ok(Self)
    }
    fn step(&mut self, _: &Activation<'_>, _: &mut Outputs<'_>) -> Result<(), StepError> {
        Ok(())
    }
}

fn node(inputs: &[(Policy, Option<usize>, u64)], every: Option<u64>) -> OperatorNode {
    let edge = |delay| Some(Edge { operator: 0, output: 0, delay });
    OperatorNode {
        name: "n".into(),
        stage: Stage::of::<Nothing>(),
        params: CheckedParams {
            value: std::sync::Arc::new(()),
            resolved: serde_json::Value::Null,
            given: [].into(),
        },
        far_end: None,
        wire_form: None,
        subscriptions: Vec::new(),
        listens: None,
        files: Vec::new(),
        every,
        latency: 0,
        deadline: None,
        start_within: None,
        inputs: inputs
            .iter()
            .map(|(policy, sync_leader, delay)| InputNode {
                edge: edge(*delay),
                policy: *policy,
                sync_leader: *sync_leader,
                frame: None,
                max_age: None,
            })
            .collect(),
        outputs: Vec::new(),
        process: 0,
    }
}

fn header(incarnation: u32, sequence: u64, stamp: u64) -> Header {
    Header { stamp, origin: stamp, sequence, incarnation, count: 1 }
}

/// What waits on each input.
struct Waiting(Vec<VecDeque<Header>>);

impl Waiting {
    fn ready(&mut self, intake: &mut Intake<Header>, now: u64) -> Option<Trigger> {
        intake.ready(now, &mut |port| self.0[port].pop_front())
    }
}

#[test]
fn a_queue_gives_each_sample_once_and_counts_the_gap() {
    let mut intake = Intake::new(&node(&[(Policy::Queue(4), None, 0)], None));
    let mut waiting = Waiting(vec![VecDeque::from([header(0, 0, 10), header(0, 3, 20)])]);
    let mut seen = Vec::new();
    while let Some(t) = waiting.ready(&mut intake, 100) {
        let refs = intake.begin(t.cause, t.port);
        seen.push((refs[0].first, refs[0].total, refs[0].lost));
        intake.end();
    }
    assert_eq!(seen, [(0, 1, 0), (3, 2, 2)]);
}

#[test]
fn latest_is_held_and_passed_over_samples_are_counted() {
    let mut intake = Intake::new(&node(&[(Policy::Latest, None, 0)], Some(10)));
    let mut waiting = Waiting(vec![VecDeque::from([header(0, 0, 1), header(0, 1, 2), header(0, 2, 3)])]);
    assert_eq!(waiting.ready(&mut intake, 5), None, "with a timer a latest input causes nothing");
    let first = intake.begin(Cause::Timer, 0);
    intake.end();
    let second = intake.begin(Cause::Timer, 0);
    assert_eq!((first[0].first, first[0].kind, first[0].passed), (2, RefKind::Fresh as u32, 2));
    assert_eq!((second[0].first, second[0].kind), (2, RefKind::Held as u32));
}

#[test]
fn latest_alone_causes_activations() {
    let mut intake = Intake::new(&node(&[(Policy::Latest, None, 0)], None));
    let mut waiting = Waiting(vec![VecDeque::from([header(0, 0, 1)])]);
    assert_eq!(waiting.ready(&mut intake, 5).map(|t| t.cause), Some(Cause::Input));
    intake.begin(Cause::Input, 0);
    assert_eq!(waiting.ready(&mut intake, 6), None);
}

#[test]
fn sync_pairs_by_origin_and_passes_over_what_has_no_partner() {
    let sync = Policy::Sync { within: 2 };
    let mut intake = Intake::new(&node(&[(sync, Some(0), 0), (sync, Some(0), 0)], None));
    let mut waiting = Waiting(vec![
        VecDeque::from([header(0, 0, 10), header(0, 1, 20), header(0, 2, 30)]),
        VecDeque::from([header(0, 0, 19), header(0, 1, 31)]),
    ]);
    let mut pairs = Vec::new();
    while let Some(t) = waiting.ready(&mut intake, 100) {
        let refs = intake.begin(t.cause, t.port);
        pairs.push((refs[0].first, refs[1].first, refs[0].passed));
        intake.end();
    }
    assert_eq!(pairs, [(1, 0, 1), (2, 1, 1)]);
}

#[test]
fn a_delayed_sample_is_seen_when_its_delay_is_over() {
    let mut intake = Intake::new(&node(&[(Policy::Queue(4), None, 50)], None));
    let mut waiting = Waiting(vec![VecDeque::from([header(0, 0, 10)])]);
    assert_eq!(waiting.ready(&mut intake, 59), None);
    assert_eq!(intake.next_visible(), Some(60));
    assert_eq!(waiting.ready(&mut intake, 60).map(|t| t.since), Some(60));
}

#[test]
fn the_account_starts_anew_with_each_incarnation_of_the_producer() {
    let mut intake = Intake::new(&node(&[(Policy::Queue(4), None, 0)], None));
    let mut waiting =
        Waiting(vec![VecDeque::from([header(0, 0, 1), header(0, 5, 2), header(1, 2, 3), header(1, 4, 4)])]);
    let mut last = Vec::new();
    while let Some(t) = waiting.ready(&mut intake, 100) {
        last = intake.begin(t.cause, t.port);
        intake.end();
    }
    let r = last[0];
    assert_eq!((r.incarnation, r.first, r.total, r.lost), (1, 4, 2, 1));
    assert_eq!(intake.account()[0].total, 2);
}

#[test]
fn the_earlier_of_two_queues_goes_first() {
    let queue = (Policy::Queue(4), None, 0);
    let mut intake = Intake::new(&node(&[queue, queue], None));
    let mut waiting = Waiting(vec![VecDeque::from([header(0, 0, 7)]), VecDeque::from([header(0, 0, 5)])]);
    assert_eq!(waiting.ready(&mut intake, 100).map(|t| t.port), Some(1));
}
