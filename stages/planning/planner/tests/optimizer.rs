//! `plan.optimizer` on a bench.

#![allow(clippy::unwrap_used, clippy::panic)]

mod small;

use small::{files, hash, request, stages};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::{
    BixelWeight, Command, ConsoleCommand, PlanRefusal, PlanRequest, PlanRequestElement, PlanStanding,
};
use stillpoint_samples::{PlanUpdate, PlanUpdateBody, Verb};
use stillpoint_testing::Bench;
use stillpoint_testing::bench::Left;

fn bench(params: &str) -> Bench {
    bench_with(params, &files())
}

fn bench_with(params: &str, files: &MemoryFiles) -> Bench {
    let text = format!(
        "
stillpoint: 1
name: planner
seed: 5
operators:
  requests: {{ use: test.requests }}
  plans:
    use: plan.optimizer
    every: 100 ms
    inputs: {{ request: requests.out, accept: requests.accept }}
    params: {{ case: small.case, angles: 10, grid: 8 mm, bixel: 14 mm{params} }}
"
    );
    Bench::new(&text, "plans", &stages(), files).unwrap()
}

type Update = (PlanUpdateBody, Vec<BixelWeight>);

fn updates(left: &Left) -> Vec<Update> {
    assert_eq!(left.fault, None);
    let view = |sample: &stillpoint_testing::pipeline::sample_store::OwnedSample| {
        let view = sample.pieces().view::<PlanUpdate>().unwrap();
        (*view.body, view.elements.to_vec())
    };
    left.outputs.iter().map(|(_, sample)| view(sample)).collect()
}

/// Ticks until the work on the request ends; at most 200 times.
fn to_the_end(bench: &mut Bench) -> Vec<Update> {
    let mut all: Vec<Update> = Vec::new();
    for _ in 0..200 {
        all.extend(updates(&bench.tick()));
        if all.last().is_some_and(|(body, _)| body.ended == 1) {
            return all;
        }
    }
    panic!("the search does not end: {all:?}");
}

fn ask(bench: &mut Bench, request: &PlanRequestElement) -> Vec<Update> {
    updates(&bench.feed::<PlanRequest>(0, &(), &[*request], 0))
}

#[test]
fn updates_get_better_until_the_budget_is_spent_and_two_runs_have_the_same_bytes() {
    let run = || {
        let mut bench = bench("");
        assert!(ask(&mut bench, &request([0.0; 3])).is_empty());
        let mut bytes = Vec::new();
        for _ in 0..6 {
            bytes.extend(bench.tick().bytes());
        }
        bytes
    };
    assert_eq!(run(), run());

    let mut bench = bench("");
    assert!(updates(&bench.tick()).is_empty(), "without a request there is nothing to do");
    ask(&mut bench, &PlanRequestElement { beams: 4, budget: 20, ..request([0.0; 3]) });
    let all = to_the_end(&mut bench);
    // Four of ten doses at each tick, then two solves.
    let solves: Vec<u32> = all.iter().map(|(body, _)| body.solves).collect();
    assert_eq!(solves, [0, 0, 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20]);
    assert!(
        all[..3]
            .iter()
            .all(|(body, fluence)| body.objective.is_nan() && body.beams == 0 && fluence.is_empty())
    );
    let objectives: Vec<f64> = all[3..].iter().map(|(body, _)| body.objective).collect();
    assert!(objectives.is_sorted_by(|a, b| a >= b), "{objectives:?}");
    assert!(objectives[objectives.len() - 1] < objectives[0], "{objectives:?}");
    let (last, fluence) = all.last().unwrap();
    assert!(last.target_d98 > 54.0 && last.target_d2 < 69.0, "{last:?}");
    assert_eq!((last.beams, last.case_hash, last.length as usize), (4, hash(), fluence.len()));
    assert!(
        last.angles[..4].iter().all(|a| (0.0..std::f64::consts::TAU).contains(a)) && last.angles[4].is_nan()
    );
    assert!(fluence.iter().all(|b| b.weight >= 0.0 && b.beam < 4 && b.centre.iter().all(|c| c.abs() < 0.1)));
    assert!((0..4).all(|beam| fluence.iter().any(|b| b.beam == beam && b.weight > 0.0)));
    assert_eq!(last.standing(), PlanStanding::Holds);
    assert_eq!((last.standing_d98, last.standing_d2), (last.target_d98, last.target_d2));
    assert!(updates(&bench.tick()).is_empty(), "the work has ended");
}

#[test]
fn a_search_in_parts_finds_what_it_finds_in_one_go() {
    let end = |solves: usize| {
        let mut bench = bench(&format!(", solves: {solves}"));
        ask(&mut bench, &request([0.0; 3]));
        to_the_end(&mut bench).pop().unwrap()
    };
    let (whole, fluence) = end(8);
    assert_eq!(whole.solves, 8);
    for solves in [1, 3] {
        let (parts, same) = end(solves);
        assert_eq!(
            (parts.objective, parts.angles[..5].to_vec()),
            (whole.objective, whole.angles[..5].to_vec())
        );
        assert_eq!(same, fluence);
    }
}

#[test]
fn a_shift_beyond_the_margin_makes_the_standing_plan_fail_and_a_new_plan_hold() {
    let mut bench = bench("");
    ask(&mut bench, &request([0.0; 3]));
    let (planned, _) = to_the_end(&mut bench).pop().unwrap();
    ask(&mut bench, &request([0.5, 0.0, 0.0]));
    let (near, _) = to_the_end(&mut bench).pop().unwrap();
    assert_eq!(near.standing(), PlanStanding::Holds, "{near:?}");
    assert!((near.standing_d98 - planned.target_d98).abs() < 2.0, "{near:?}");
    ask(&mut bench, &request([9.0, 0.0, 0.0]));
    let far = to_the_end(&mut bench);
    assert_eq!(far[0].0.standing(), PlanStanding::Unknown, "not all doses are there");
    let (far, _) = far.last().unwrap();
    assert_eq!(far.standing(), PlanStanding::Fails, "{far:?}");
    assert!(far.standing_d98 < 54.0, "{far:?}");
    assert!(far.target_d98 > 54.0 && far.target_d2 < 69.0, "{far:?}");
    // The patient is back: the standing plan is the first still.
    ask(&mut bench, &request([0.0; 3]));
    let (back, _) = to_the_end(&mut bench).pop().unwrap();
    assert_eq!((back.standing_d98, back.standing()), (planned.target_d98, PlanStanding::Holds));
}

/// What the optimiser answers to a person who accepts.
fn accept(bench: &mut Bench, verb: Verb, values: &[f64]) -> Vec<Update> {
    let mut command = Command { verb: verb as u32, given: values.len() as u32, ..Command::default() };
    command.values[..values.len()].copy_from_slice(values);
    updates(&bench.feed::<ConsoleCommand>(1, &(), &[command], 0))
}

#[test]
fn a_plan_stands_once_a_person_accepted_the_finished_offer_by_the_number_of_its_request() {
    let mut bench = bench("");
    ask(&mut bench, &request([0.0; 3]));
    to_the_end(&mut bench);
    ask(&mut bench, &request([9.0, 0.0, 0.0]));
    let (early, _) = updates(&bench.tick()).pop().unwrap();
    let number = early.request as f64;
    let refused = |bench: &mut Bench, values: &[f64]| {
        let (answer, _) = accept(bench, Verb::Accept, values).pop().unwrap();
        assert_eq!(answer.refusal(), Some(PlanRefusal::Accept), "{values:?}");
    };
    refused(&mut bench, &[number]);
    let (before, _) = to_the_end(&mut bench).pop().unwrap();
    assert_eq!(before.standing(), PlanStanding::Fails);
    for wrong in [&[][..], &[0.0], &[number + 1.0], &[number + 0.5], &[f64::NAN], &[-1.0]] {
        refused(&mut bench, wrong);
    }
    assert!(accept(&mut bench, Verb::Confirm, &[number]).is_empty(), "another verb");
    let (accepted, fluence) = accept(&mut bench, Verb::Accept, &[number]).pop().unwrap();
    assert_eq!(accepted.refusal(), Some(PlanRefusal::None));
    assert_eq!((accepted.request, accepted.standing()), (early.request, PlanStanding::Holds));
    assert_eq!((accepted.standing_d98, accepted.standing_d2), (before.target_d98, before.target_d2));
    assert_eq!(fluence.len(), accepted.length as usize);
    // The patient is back: the accepted plan is judged there, not the first.
    ask(&mut bench, &request([0.0; 3]));
    let (back, _) = to_the_end(&mut bench).pop().unwrap();
    assert_eq!(back.standing(), PlanStanding::Fails, "{back:?}");
}

#[test]
fn where_only_accepted_plans_stand_the_first_plan_waits_for_a_person() {
    let mut bench = bench(", standing: accepted");
    ask(&mut bench, &request([0.0; 3]));
    let (end, _) = to_the_end(&mut bench).pop().unwrap();
    assert_eq!(end.standing(), PlanStanding::Unknown);
    let (accepted, _) = accept(&mut bench, Verb::Accept, &[end.request as f64]).pop().unwrap();
    assert_eq!(accepted.standing(), PlanStanding::Holds);
}

#[test]
fn the_standing_plan_holds_only_if_it_keeps_its_limits() {
    let standing = |limits: &str| {
        let mut bench = bench(&format!(", limits: [{limits}]"));
        ask(&mut bench, &request([0.0; 3]));
        let (end, _) = to_the_end(&mut bench).pop().unwrap();
        end.standing()
    };
    let rod = |bound: f64| format!("{{ on: Rectum, limit: \"Mean[Gy] <= {bound}\" }}");
    assert_eq!(standing(&rod(60.0)), PlanStanding::Holds);
    assert_eq!(standing(&rod(0.5)), PlanStanding::Fails);
    assert_eq!(
        standing(&format!("{}, {{ on: plan, limit: \"D2cm[%] <= 1\" }}", rod(60.0))),
        PlanStanding::Fails
    );
    let refused = |limits: &str| {
        let text = format!(
            "
stillpoint: 1
name: planner
operators:
  requests: {{ use: test.requests }}
  plans:
    use: plan.optimizer
    every: 1 s
    inputs: {{ request: requests.out }}
    params: {{ case: small.case, grid: 8 mm, limits: [{limits}] }}
"
        );
        Bench::new(&text, "plans", &stages(), &files()).err().unwrap()
    };
    let missing = refused("{ on: Bladder, limit: \"Mean[Gy] <= 1\" }");
    assert!(missing.contains("`Mean[Gy] <= 1`") && missing.contains("Bladder"), "{missing}");
    assert!(refused("{ on: Rectum, limit: \"Mean <= 1\" }").contains("is not a quantity"));
}

#[test]
fn a_newer_request_takes_the_place_of_the_one_before_at_the_next_tick() {
    let mut bench = bench("");
    ask(&mut bench, &request([0.0; 3]));
    for _ in 0..5 {
        bench.tick();
    }
    let (before, _) = updates(&bench.tick()).pop().unwrap();
    assert!(before.request == 0 && before.solves > 0 && before.ended == 0, "{before:?}");
    let first = bench.feed::<PlanRequest>(0, &(), &[request([0.0, 4.0, 0.0])], 0);
    assert!(updates(&first).is_empty());
    let (after, _) = updates(&bench.tick()).pop().unwrap();
    assert!(after.request > before.request && after.solves == 0, "{after:?}");
    // What the request for the planned set-up found until then is the standing plan.
    let (end, _) = to_the_end(&mut bench).pop().unwrap();
    assert_ne!(end.standing(), PlanStanding::Unknown);

    // A plan of a set-up that is not the planned one never becomes the standing plan.
    let mut bench = self::bench("");
    ask(&mut bench, &request([3.0, 0.0, 0.0]));
    to_the_end(&mut bench);
    ask(&mut bench, &request([3.0, 0.0, 0.0]));
    assert_eq!(to_the_end(&mut bench).pop().unwrap().0.standing(), PlanStanding::Unknown);
}

#[test]
fn a_refused_request_is_answered_at_once_with_the_cause_and_changes_nothing_else() {
    let good = request([0.0; 3]);
    let turned = |rad: f64| [(rad / 2.0).cos(), 0.0, (rad / 2.0).sin(), 0.0];
    let mut other = hash();
    other[3] ^= 1;
    let mut bench = bench("");
    ask(&mut bench, &good);
    bench.tick();
    for (wrong, cause) in [
        (PlanRequestElement { case_hash: other, ..good }, PlanRefusal::Case),
        (PlanRequestElement { beams: 0, ..good }, PlanRefusal::Beams),
        (PlanRequestElement { beams: 13, ..good }, PlanRefusal::Beams),
        (PlanRequestElement { beams: u32::MAX, ..good }, PlanRefusal::Beams),
        (PlanRequestElement { budget: 0, ..good }, PlanRefusal::Budget),
        (PlanRequestElement { budget: 1001, ..good }, PlanRefusal::Budget),
        (PlanRequestElement { position: [f64::NAN, 0.0, 0.0], ..good }, PlanRefusal::Pose),
        (PlanRequestElement { position: [0.0, f64::INFINITY, 0.0], ..good }, PlanRefusal::Pose),
        (PlanRequestElement { orientation: [0.0; 4], ..good }, PlanRefusal::Pose),
        (PlanRequestElement { orientation: [f64::NAN; 4], ..good }, PlanRefusal::Pose),
        (PlanRequestElement { orientation: [f64::INFINITY, 0.0, 0.0, 0.0], ..good }, PlanRefusal::Pose),
        (PlanRequestElement { orientation: turned(0.02), ..good }, PlanRefusal::Turn),
        (request([0.0, 0.0, 10.1]), PlanRefusal::Shift),
        (request([1e300, 0.0, 0.0]), PlanRefusal::Shift),
    ] {
        let answers = ask(&mut bench, &wrong);
        let (answer, fluence) = answers.first().unwrap();
        assert_eq!(answer.refusal(), Some(cause), "{}", cause.words());
        assert!(answer.ended == 1 && answer.beams == 0 && answer.objective.is_nan() && fluence.is_empty());
        assert!(answer.request > 0 && answer.case_hash == hash());
    }
    // The request before is still in work, and a small rotation is no fault.
    let (body, _) = to_the_end(&mut bench).pop().unwrap();
    assert_eq!((body.request, body.solves, body.refusal()), (0, 8, Some(PlanRefusal::None)));
    let slightly = PlanRequestElement { orientation: turned(0.01).map(|q| -q), ..good };
    assert!(ask(&mut bench, &slightly).is_empty());

    // Too many bixels are known once the doses are there.
    let mut bench = self::bench(", max_bixels: 20");
    ask(&mut bench, &good);
    let (body, fluence) = to_the_end(&mut bench).pop().unwrap();
    assert_eq!((body.refusal(), fluence.len()), (Some(PlanRefusal::Bixels), 0));
    assert!(updates(&bench.tick()).is_empty());
}

#[test]
fn a_case_that_cannot_be_planned_is_refused_when_the_pipeline_starts() {
    let text = "
stillpoint: 1
name: planner
operators:
  requests: { use: test.requests }
  plans: { use: plan.optimizer, every: 1 s, inputs: { request: requests.out }, params: { case: broken.case } }
";
    let mut files = files();
    files.files.insert("broken.case".to_owned(), b"no case".to_vec());
    let fault = Bench::new(text, "plans", &stages(), &files).err().unwrap();
    assert!(fault.contains("broken.case"), "{fault}");
}

/// Doses that hang on the millimetre: the check is that of `stillpoint plan`.
#[test]
fn a_plan_that_the_check_refuses_is_not_offered_and_the_reason_is_in_the_update() {
    let mut files = files();
    // The organ is to get much, and a bound of the peaks that never counts lets single bixels give it.
    let table = r#"{ "modulation": { "neighbours": 0, "peaks": 0, "times_mean": 4 }, "objectives": [
        { "role": "target", "wanted": [{ "underdose": { "dose": "100 %", "weight": 1 } }] },
        { "match": ["Rectum"], "wanted": [{ "underdose": { "dose": "600 Gy", "weight": 1000 } }] },
        { "role": "external", "wanted": [{ "overdose": { "dose": "100 Gy", "weight": 1 } }] } ] }"#;
    files.files.insert("peaks.json".to_owned(), table.as_bytes().to_vec());
    let mut bench = bench_with(", objectives: peaks.json", &files);
    ask(&mut bench, &request([0.0; 3]));
    let (last, fluence) = to_the_end(&mut bench).pop().unwrap();
    let refusal = last.refusal().unwrap();
    assert!(refusal.words().starts_with("the plan check: "), "{refusal:?}");
    assert!(fluence.is_empty() && last.beams == 0, "{last:?}");
    // There is nothing that a person could accept, and no plan stands.
    let (answer, _) = accept(&mut bench, Verb::Accept, &[last.request as f64]).pop().unwrap();
    assert_eq!(answer.refusal(), Some(PlanRefusal::Accept));
    assert_eq!(answer.standing(), PlanStanding::Unknown);
}

/// Whether the standing plan holds is what the gate asks, also where there is no better one.
#[test]
fn a_refused_plan_does_not_hide_whether_the_standing_plan_holds() {
    let mut files = files();
    let table = r#"{ "modulation": { "neighbours": 0, "peaks": 0, "times_mean": 4 }, "objectives": [
        { "role": "target", "wanted": [{ "underdose": { "dose": "100 %", "weight": 1000 } },
            { "overdose": { "dose": "105 %", "weight": 100 } }] },
        { "match": ["Rectum"], "wanted": [{ "underdose": { "dose": "38 Gy", "weight": 100 } }] },
        { "role": "external", "wanted": [{ "overdose": { "dose": "100 Gy", "weight": 1 } }] } ] }"#;
    files.files.insert("uneven.json".to_owned(), table.as_bytes().to_vec());
    for (y, standing) in [(-9.0, PlanStanding::Fails), (6.0, PlanStanding::Holds)] {
        let mut bench = bench_with(", objectives: uneven.json", &files);
        ask(&mut bench, &request([0.0; 3]));
        let (planned, _) = to_the_end(&mut bench).pop().unwrap();
        assert_eq!(planned.refusal(), Some(PlanRefusal::None));
        ask(&mut bench, &request([0.0, y, 0.0]));
        let (moved, fluence) = to_the_end(&mut bench).pop().unwrap();
        assert_eq!((moved.refusal(), moved.standing()), (Some(PlanRefusal::CheckPeak), standing), "{y}");
        assert!(
            moved.standing_d98.is_finite() && moved.target_d98.is_nan() && fluence.is_empty(),
            "{moved:?}"
        );
    }
}
