//! `plan.optimizer` and the one recipe of a plan, which `stillpoint plan` uses, too.

#![allow(clippy::unwrap_used, clippy::panic)]

mod small;

use small::{case, request, stages};
use stillpoint_operator::files::MemoryFiles;
use stillpoint_patient::case::to_bytes;
use stillpoint_plan::dose::Machine;
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_plan::recipe::{MethodName, PlanRequest, Planned, PriorName, SetupSpec, plan};
use stillpoint_samples::{BixelWeight, PlanRefusal, PlanRequest as Request, PlanStanding};
use stillpoint_samples::{PlanRequestElement, PlanUpdate, PlanUpdateBody};
use stillpoint_testing::Bench;

const OBJECTIVES: &str = r#"{ "objectives": [{ "match": ["rectum"], "wanted": [{ "overdose": { "dose": "1 Gy", "weight": 900 } }] }] }"#;
const PROTOCOL: &str = "name: own\nlimits:\n  - { structure: Bladder, limit: \"Mean[Gy] <= 1\" }\n  - { structure: Rectum, limit: \"Mean[Gy] <= BOUND\" }\n";

fn files() -> MemoryFiles {
    let file = |name: &str, bytes: Vec<u8>| (name.to_owned(), bytes);
    let protocol = |bound: &str| PROTOCOL.replace("BOUND", bound).into_bytes();
    let elsewhere = "name: other\nlimits:\n  - { structure: Bladder, limit: \"Mean[Gy] <= 1\" }\n";
    let machine = Machine::shipped().unwrap().file().to_json().unwrap();
    MemoryFiles {
        files: [
            file("small.case", to_bytes(&case()).unwrap().0),
            file("own.json", OBJECTIVES.into()),
            file("machine.json", machine.into()),
            file("kept.yaml", protocol("60")),
            file("broken.yaml", protocol("0.5")),
            file("elsewhere.yaml", elsewhere.into()),
        ]
        .into(),
    }
}

fn bench(params: &str) -> Result<Bench, String> {
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
    params: {{ case: small.case, angles: 10, grid: 8 mm, bixel: 14 mm, reach: 0 mm, doses: 10{params} }}
"
    );
    Bench::new(&text, "plans", &stages(), &files())
}

/// The last update of a request.
fn answer(params: &str, request: &PlanRequestElement) -> (PlanUpdateBody, Vec<BixelWeight>) {
    let mut bench = bench(params).unwrap();
    let fed = bench.feed::<Request>(0, &(), &[*request], 0);
    assert_eq!(fed.fault, None);
    for _ in 0..100 {
        let left = bench.tick();
        assert_eq!(left.fault, None);
        for (_, sample) in &left.outputs {
            let view = sample.pieces().view::<PlanUpdate>().unwrap();
            if view.body.ended == 1 {
                return (*view.body, view.elements.to_vec());
            }
        }
    }
    panic!("the search does not end");
}

fn planned(request: &PlanRequest, own: bool) -> Planned {
    let shipped = SetupSpec::shipped().unwrap();
    let objectives = match own {
        true => ObjectiveTable::parse(OBJECTIVES).unwrap().before(shipped.objectives.clone()),
        false => shipped.objectives.clone(),
    };
    let ring = SetupSpec::ring_of(10).unwrap();
    let spec = SetupSpec { objectives, grid_mm: 8.0, bixel_mm: 14.0, ring, ..shipped };
    plan(case(), spec, request).unwrap()
}

/// Angles, and centre, weight and beam of each bixel, as an update has them.
fn bits(planned: &Planned) -> (Vec<u64>, Vec<(Vec<u32>, u32)>) {
    let angles = planned.angles_deg().iter().map(|deg| deg.to_radians().to_bits()).collect();
    let best = planned.best();
    let mut bixels = Vec::new();
    for (number, beam) in best.beams.beams().iter().enumerate() {
        let places = planned.doses.solved.bixels_mm(*beam);
        for (mm, weight) in places.iter().zip(best.weights_of(*beam).unwrap()) {
            let numbers = [mm[0] * 1e-3, mm[1] * 1e-3, *weight].map(|number| (number as f32).to_bits());
            bixels.push((numbers.to_vec(), number as u32));
        }
    }
    (angles, bixels)
}

#[test]
fn operator_and_recipe_give_the_same_bytes_for_the_same_request() {
    let exchange = PlanRequest { budget: 8, seed: 5, ..PlanRequest::default() };
    let of = |method, priors| PlanRequest { method, priors, ..exchange.clone() };
    let searches = [
        ("", exchange.clone(), false),
        (", objectives: own.json, machine: machine.json", exchange.clone(), true),
        (", method: greedy", of(MethodName::Greedy, vec![PriorName::Price]), false),
        (
            ", method: search, prior: [price, geometry]",
            of(MethodName::Search, vec![PriorName::Price, PriorName::Geometry]),
            false,
        ),
    ];
    let mut answers = Vec::new();
    for (params, request, own) in searches {
        let (body, fluence) = answer(params, &small::request([0.0; 3]));
        let planned = planned(&request, own);
        let (angles, bixels) = bits(&planned);
        let same: Vec<u64> = body.angles[..body.beams as usize].iter().map(|a| a.to_bits()).collect();
        assert_eq!(same, angles, "{params}");
        assert_eq!(body.objective.to_bits(), planned.best().cost.to_bits(), "{params}");
        let of = |b: &BixelWeight| {
            (vec![b.centre[0].to_bits(), b.centre[1].to_bits(), b.weight.to_bits()], b.beam)
        };
        assert_eq!(fluence.iter().map(of).collect::<Vec<_>>(), bixels, "{params}");
        answers.push(body.objective);
    }
    assert_ne!(answers[0], answers[1], "the objectives of the file are used");
}

#[test]
fn the_standing_plan_keeps_the_limits_of_a_protocol_that_the_case_has() {
    let standing =
        |protocol: &str| answer(&format!(", protocol: {protocol}"), &request([0.0; 3])).0.standing();
    assert_eq!(standing("kept.yaml"), PlanStanding::Holds);
    assert_eq!(standing("broken.yaml"), PlanStanding::Fails);
    let refused = bench(", protocol: elsewhere.yaml").err().unwrap();
    assert!(refused.contains("no limit of the protocol other"), "{refused}");
}

#[test]
fn methods_and_priors_that_contradict_each_other_are_refused_before_the_run() {
    let refused = |params: &str| bench(params).err().unwrap();
    let takes_none = refused(", method: annealing, prior: [geometry]");
    assert!(takes_none.contains("annealing takes no prior"), "{takes_none}");
    assert!(refused(", method: prior").contains("needs a prior without solves"));
    assert!(refused(", network: own.json").contains("give one of them, too"));
    assert!(refused(", objectives: machine.json").contains("machine.json"));
}

#[test]
fn a_budget_that_is_too_small_for_the_method_is_refused_and_not_left_without_a_plan() {
    let few = PlanRequestElement { budget: 3, ..request([0.0; 3]) };
    let (body, fluence) = answer(", method: greedy", &few);
    assert_eq!((body.refusal(), fluence.len()), (Some(PlanRefusal::Budget), 0));
}
