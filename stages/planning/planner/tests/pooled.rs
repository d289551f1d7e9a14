//! `plan.optimizer` with a pool of workers, in the simulated executor: workers and network are those of the tests of the
//! pool, in session time.

#![allow(clippy::unwrap_used, clippy::panic)]

#[allow(dead_code)]
#[path = "../../pool/tests/simulated.rs"]
mod simulated;
mod small;

use simulated::{CALM, MS, Part, Simulated, Weather};
use small::{files, request};
use stillpoint_operator::{Activation, Choice, Operator, Outputs, Params, Registry, Setup};
use stillpoint_operator::{
    FrameRule, Input, Kind, Output, Policy, Role, SetupError, Stage, StepError, Timer,
};
use stillpoint_pool::{Build, Courier, Message, To, topic};
use stillpoint_samples::{
    Diagnostics, PlanRefusal, PlanRequest, PlanRequestElement, PlanStanding, PlanUpdate, PoolMessage,
    PoolMessageBody, PoolWord, Sample,
};
use stillpoint_testing::{Run, run};
use zerocopy::IntoBytes;

fn asked(mm: f64) -> PlanRequestElement {
    PlanRequestElement { beams: 4, budget: 7, ..request([mm, 0.0, 0.0]) }
}

/// Requests for the planned set-up at once, and for another one after a while.
struct Asks;

impl Operator for Asks {
    type Params = ();
    const KIND: Kind = Kind {
        name: "test.asks",
        about: "Two requests.",
        role: Role::Source,
        inputs: &[],
        outputs: &[Output {
            name: "out",
            sample: PlanRequest::KIND,
            frame: FrameRule::None,
            about: "Requests.",
        }],
        timer: Timer::Required,
    };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        match activation.tick {
            0 => outputs.send::<PlanRequest>(0, &asked(0.0)),
            20 => outputs.send::<PlanRequest>(0, &asked(9.0)),
            _ => Ok(()),
        }
    }
}

/// What is the matter with the workers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Choice)]
enum Fault {
    /// Nothing.
    None,
    /// Messages are lost, late and doubled.
    Storm,
    /// The first dies after every second call.
    Dies,
    /// The answers of the second are wrong.
    Wrong,
    /// The answers of the second are wrong from the `turn`-th on.
    Turns,
    /// The network carries nothing.
    Cut,
}

#[derive(Clone, Params)]
struct CrewParams {
    /// Workers.
    #[param(default = 2)]
    workers: u64,
    /// Their fault.
    #[param(default = "none")]
    fault: Fault,
    /// The number of the first wrong answer.
    #[param(default = 10)]
    turn: u64,
    /// When the first worker comes.
    #[param(unit = "ns", default = "0 s")]
    from: u64,
    /// When all messages are lost from.
    #[param(unit = "ns", default = "10 min")]
    until: u64,
}

/// Workers in session time.
struct Crew {
    params: CrewParams,
    simulated: Simulated,
    begun: Option<u64>,
}

impl Operator for Crew {
    type Params = CrewParams;
    const KIND: Kind = Kind {
        name: "test.crew",
        about: "Workers of a planning pool in session time.",
        role: Role::Source,
        inputs: &[Input {
            name: "calls",
            sample: PoolMessage::KIND,
            policy: Policy::Queue(256),
            required: true,
            about: "Messages to them.",
        }],
        outputs: &[Output {
            name: "messages",
            sample: PoolMessage::KIND,
            frame: FrameRule::None,
            about: "Messages from them.",
        }],
        timer: Timer::Required,
    };

    fn new(params: CrewParams, _: &Setup<'_>) -> Result<Self, SetupError> {
        let build = Build::here().map_err(|e| SetupError(e.to_string()))?;
        let mut parts = vec![Part { build, ..Part::default() }; params.workers as usize];
        let weather = match params.fault {
            Fault::Storm => Weather { delay: (5 * MS, 60 * MS), lost: 20, doubled: 60 },
            Fault::Cut => Weather { lost: 1000, ..CALM },
            _ => CALM,
        };
        match params.fault {
            Fault::Dies => parts[0].dies_after = 2,
            Fault::Wrong => parts[1].wrong_from = 0,
            Fault::Turns => parts[1].wrong_from = params.turn as usize,
            _ => {}
        }
        Ok(Self { params, simulated: Simulated::new(3, weather, &parts), begun: None })
    }

    fn capacities(_: &CrewParams) -> Vec<usize> {
        vec![1 << 18]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let now = activation.time - *self.begun.get_or_insert(activation.time);
        let is_open = (self.params.from..self.params.until).contains(&now);
        if let Some(message) = activation.fresh::<PoolMessage>(0).filter(|_| is_open) {
            let (to, bytes) = topic::split(message.elements).unwrap();
            let to = if to.is_empty() { To::All } else { To::one(to) };
            self.simulated.send(&to, bytes.to_vec());
        }
        while let Some(arrival) = self.simulated.receive(now).map_err(|e| StepError(e.to_string()))? {
            let message = Message::from_bytes(&arrival.bytes).unwrap();
            let (body, elements) = topic::sample(&To::One(arrival.from), &message);
            if is_open {
                outputs.send_slice::<PoolMessage>(0, &body, &elements)?;
            }
        }
        Ok(())
    }
}

/// What stands behind `pool.client` in a run without a network.
struct NoNetwork;

impl Operator for NoNetwork {
    type Params = ();
    const KIND: Kind = Kind { name: "test.no_network", ..Crew::KIND };

    fn new((): (), _: &Setup<'_>) -> Result<Self, SetupError> {
        Ok(Self)
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let body = PoolMessageBody { word: PoolWord::NoNetwork as u32, ..PoolMessageBody::default() };
        if activation.tick.is_multiple_of(100) {
            outputs.send_slice::<PoolMessage>(0, &body, &[])
        } else {
            Ok(())
        }
    }
}

/// Runs both requests over this pool (without one: none) for some seconds.
fn play(pool: Option<&str>, params: &str, s: u64) -> Run {
    let (answers, operator) = match pool {
        Some(pool) => (
            ", answers: { from: pool.messages, delay: 1 ms }",
            format!("  pool: {{ {pool}, every: 10 ms, inputs: {{ calls: plans.calls }} }}\n"),
        ),
        None => ("", String::new()),
    };
    let text = format!(
        "stillpoint: 1
name: pooled
operators:
  asks: {{ use: test.asks, every: 1 s }}
  plans:
    use: plan.optimizer
    every: 100 ms
    inputs: {{ request: asks.out{answers} }}
    params: {{ case: small.case, angles: 9, grid: 10 mm, bixel: 18 mm{params} }}
{operator}"
    );
    let own = [Stage::of::<Asks>(), Stage::of::<Crew>(), Stage::of::<NoNetwork>()];
    let registry = Registry::new(&[stillpoint_planner::STAGES, &own]);
    let run = run(&text, &registry, &files(), 1000 * s).unwrap();
    assert!(run.failed().is_empty(), "{:?}", run.failed());
    run
}

/// Bodies and elements of all updates, without their stamps.
fn updates(run: &Run) -> Vec<Vec<u8>> {
    let updates = run.samples::<PlanUpdate>("plans.plan");
    updates.iter().map(|u| [u.body.as_bytes(), u.elements.as_bytes()].concat()).collect()
}

/// Request, solves, refusal and time of each update.
fn reported(run: &Run) -> Vec<(u64, u32, u32, u64)> {
    let updates = run.samples::<PlanUpdate>("plans.plan");
    let at =
        |u: &stillpoint_samples::View<'_, PlanUpdate>| (u.header.stamp - stillpoint_testing::run::START) / MS;
    updates.iter().map(|u| (u.body.request, u.body.solves, u.body.refusal, at(u))).collect()
}

/// When the updates were sent, ns.
fn stamps(run: &Run) -> Vec<u64> {
    run.samples::<PlanUpdate>("plans.plan").iter().map(|update| update.header.stamp).collect()
}

/// The last value of a metric.
fn metric(run: &Run, name: &str) -> f64 {
    let all = run.samples::<Diagnostics>("plans.diagnostics");
    all.last().and_then(|last| last.elements.iter().find(|m| m.name() == name)).unwrap().value
}

#[test]
fn updates_over_a_pool_are_those_without_one_whatever_happens_to_workers_and_messages() {
    let expected = updates(&play(None, "", 40));
    assert!(expected.len() > 10);
    for pool in ["workers: 1, from: 4 s", "workers: 3, fault: storm", "fault: dies"] {
        let run = play(Some(&format!("use: test.crew, params: {{ {pool} }}")), "", 40);
        assert!(updates(&run) == expected, "{pool}: {:?}", reported(&run));
        assert!(metric(&run, "calls_by_workers") > 10.0, "{pool}");
        assert_eq!(metric(&run, "degraded"), 0.0, "{pool}");
    }
}

#[test]
fn updates_over_a_pool_are_those_without_one_with_several_leaves_in_progress() {
    let wide = ", method: search, leaves: 4";
    let expected = updates(&play(None, wide, 40));
    assert!(expected.len() > 10 && expected != updates(&play(None, ", method: search", 40)));
    let run = play(Some("use: test.crew, params: { workers: 3, fault: storm }"), wide, 40);
    assert!(updates(&run) == expected, "{:?}", reported(&run));
    assert!(metric(&run, "calls_by_workers") > 10.0);
}

#[test]
fn without_a_network_all_is_computed_here_at_the_same_ticks() {
    let (without, alone) = (play(None, "", 40), play(Some("use: test.no_network"), "", 40));
    assert!(updates(&alone) == updates(&without));
    // What is asked before `pool` has said that there is no network waits for it.
    assert_eq!(stamps(&alone)[7..], stamps(&without)[7..]);
    assert_eq!((metric(&alone, "no_network"), metric(&alone, "calls_by_workers")), (1.0, 0.0));
}

#[test]
fn nobody_at_all_begins_the_degraded_mode_after_the_patience_and_not_before() {
    let expected = updates(&play(None, "", 40));
    let pool = "use: test.crew, params: { fault: cut }";
    let local = play(Some(pool), ", pool: { patience: 5 s, degraded: local, solves: 4 }", 40);
    let found = updates(&local);
    let first = stamps(&local)[0] - stillpoint_testing::run::START;
    assert!(first >= 5_000_000_000, "{first}");
    let views = local.samples::<PlanUpdate>("plans.plan");
    let ends: Vec<(u64, u32)> =
        views.iter().filter(|u| u.body.ended == 1).map(|u| (u.body.request, u.body.solves)).collect();
    assert_eq!(ends, [(0, 4), (1, 4)]);
    // It is the same search, cut short.
    assert!(found[..4] == expected[..4]);
    assert_eq!(metric(&local, "degraded"), 1.0);

    let retained = play(Some(pool), ", pool: { patience: 5 s, degraded: keep }", 40);
    let views = retained.samples::<PlanUpdate>("plans.plan");
    let refusals: Vec<_> = views.iter().map(|u| (u.body.request, u.body.refusal(), u.body.ended)).collect();
    assert_eq!(refusals, [(0, Some(PlanRefusal::Pool), 1), (1, Some(PlanRefusal::Pool), 1)]);
    // The patience is over when the second request comes: it is answered at once.
    let ask = retained.samples::<PlanRequest>("asks.out")[1].header.stamp;
    assert!(stamps(&retained)[1] - ask < 200_000_000);
}

#[test]
fn a_pool_that_goes_in_the_middle_leaves_what_it_has_computed() {
    // It goes in the middle of the second request.
    let pool = "use: test.crew, params: { workers: 1, until: 20400 ms }";
    let run = play(Some(pool), ", pool: { patience: 5 s, solves: 1000 }", 40);
    assert!(updates(&run) == updates(&play(None, "", 40)));
    let by_workers = metric(&run, "calls_by_workers");
    assert!(by_workers > 10.0, "{by_workers}");
    assert_eq!(metric(&run, "degraded"), 1.0);
    let late = stamps(&run).windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    assert!(late >= 5_000_000_000, "{late}");
}

#[test]
fn a_worker_with_wrong_answers_is_shut_out_and_no_plan_stands_on_them() {
    let expected = updates(&play(None, "", 40));
    let pool = "use: test.crew, params: { workers: 3, fault: wrong }";
    for checked in ["1", "0"] {
        let run = play(Some(pool), &format!(", pool: {{ checked: {checked} }}"), 40);
        let found = updates(&run);
        assert_eq!(metric(&run, "workers_shut_out"), 1.0, "{checked}");
        assert!(found.last() == expected.last(), "{checked}");
        let ended = |run: &Run| {
            let updates = run.samples::<PlanUpdate>("plans.plan");
            updates.iter().filter(|u| u.body.ended == 1).map(|u| u.body.standing()).collect::<Vec<_>>()
        };
        assert_eq!(ended(&run).last(), Some(&PlanStanding::Fails), "{checked}: {:?}", ended(&run));
    }
}

#[test]
fn a_plan_that_stands_on_answers_of_a_worker_that_is_shut_out_later_stands_no_longer() {
    let expected = updates(&play(None, ", standing: accepted", 40));
    // Its answers to the first request are taken; it is found out while it works on the second. Which call that is depends
    // on whom the client asks what.
    let play = |turn: u64| {
        let pool = format!("use: test.crew, params: {{ workers: 3, fault: turns, turn: {turn} }}");
        play(Some(&pool), ", pool: { checked: 0 }", 40)
    };
    let is_doubted = |run: &Run| reported(run).iter().any(|(.., refusal, _)| *refusal != 0);
    let run = (5..12).map(play).find(is_doubted).unwrap();
    let doubts: Vec<_> = reported(&run).into_iter().filter(|(.., refusal, _)| *refusal != 0).collect();
    assert_eq!(doubts.len(), 1, "{:?}", reported(&run));
    assert_eq!((doubts[0].0, doubts[0].2), (0, PlanRefusal::Doubt as u32));
    // What follows is what a run without a standing plan finds.
    assert!(updates(&run).last() == expected.last(), "{:?}", reported(&run));
    let views = run.samples::<PlanUpdate>("plans.plan");
    let standing: Vec<PlanStanding> =
        views.iter().filter(|u| u.body.ended == 1).map(|u| u.body.standing()).collect();
    assert_eq!(standing, [PlanStanding::Holds, PlanStanding::Unknown, PlanStanding::Unknown]);
}
