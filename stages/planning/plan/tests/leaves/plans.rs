//! Plans in segments: what the leaves cost.

use std::num::NonZeroUsize;

use stillpoint_patient::case::phantom;
use stillpoint_plan::beams::Influence;
use stillpoint_plan::dose::{BeamAngles, BixelSpec, Collimator, DoseEngine, DoseParams};
use stillpoint_plan::leaves::{FluenceBeam, LeafOptions, LeavesError, Sequenced, sequence};
use stillpoint_plan::recipe::{MethodName, PlanRequest, PlanSetup, Planned, SetupSpec, UnshapedError, plan};

const OPTIONS: LeafOptions = LeafOptions::PLAN;

fn planned(seed: u64, angles: &[f64], [grid_mm, bixel_mm]: [f64; 2]) -> Planned {
    let spec = SetupSpec { grid_mm, bixel_mm, ..SetupSpec::shipped().unwrap() };
    let threads = NonZeroUsize::new(2).unwrap();
    let request = PlanRequest { threads, ..PlanRequest::of_angles(angles.to_vec()) };
    plan(phantom(seed).unwrap(), spec, &request).unwrap()
}

fn sequenced(planned: &Planned, collimator: &Collimator, options: LeafOptions) -> Sequenced {
    let best = planned.best();
    let beam = |beam: &u16| FluenceBeam {
        doses: planned.doses.solved.beam(*beam),
        bixels_mm: planned.doses.solved.bixels_mm(*beam),
        weights: best.weights_of(*beam).unwrap(),
    };
    let beams: Vec<FluenceBeam<'_>> = best.beams.beams().iter().map(beam).collect();
    sequence(&planned.setup.goals, &beams, collimator, of_doses(planned), options).unwrap()
}

/// What the doses of the fluence cost: segments pay for no modulation.
fn of_doses(planned: &Planned) -> f64 {
    planned.setup.goals.cost_of(&planned.best().plan).unwrap()
}

fn segments(sequenced: &Sequenced) -> usize {
    sequenced.beams.iter().flatten().map(|beam| beam.segments.len()).sum()
}

#[test]
fn beams_that_leaves_cannot_shape_are_refused_before_their_doses() {
    let spec = SetupSpec { grid_mm: 10.0, bixel_mm: 10.0, ..SetupSpec::shipped().unwrap() };
    let setup = PlanSetup::new(phantom(1).unwrap(), spec).unwrap();
    let params = setup.engine().params();
    let params = DoseParams { bixels: BixelSpec { margin_mm: 0.0, ..params.bixels }, ..*params };
    let of_target = DoseEngine::of_case(&setup.case, setup.spec.machine.clone(), params).unwrap();
    let widest_of = |engine: &DoseEngine, angles: BeamAngles| {
        engine.bixels_mm(angles).unwrap().iter().map(|[x, _]| x.abs()).fold(0.0, f64::max)
    };
    let widest = |angles: BeamAngles| widest_of(&of_target, angles);
    let all = setup.directions.all(&(0..setup.directions.ring().count()).collect::<Vec<_>>());
    let (mut narrow, mut wide) = (all[0], all[0]);
    for angles in &all {
        narrow = if widest(*angles) < widest(narrow) { *angles } else { narrow };
        wide = if widest(*angles) > widest(wide) { *angles } else { wide };
    }
    // Leaves that shape all of the narrowest beam and not all of the widest.
    let collimator = Collimator { over_travel_mm: widest(narrow) + 5.0, ..Collimator::generic() };
    assert!(widest(wide) + 5.0 > collimator.over_travel_mm);
    let fitting = all.iter().filter(|angles| widest(**angles) <= widest(narrow)).count();
    assert!((1..all.len()).contains(&fitting), "{fitting}");
    let check = |request: PlanRequest| {
        setup.check_leaves(&request.check(&setup.case, setup.directions.clone()).unwrap(), &collimator)
    };
    // Beams that are given: each has to be shaped.
    let given = |angles: &[BeamAngles]| {
        check(PlanRequest::of_angles(angles.iter().map(|a| a.gantry_deg).collect::<Vec<_>>()))
    };
    given(&[narrow]).unwrap();
    // What lies in the margin alone may get no weight, and is refused after the solve if it has some.
    assert!(widest_of(setup.engine(), narrow) + 5.0 > collimator.over_travel_mm);
    let refused = given(&[narrow, wide]).unwrap_err();
    let UnshapedError::Beam { angles, why: LeavesError::Beyond { x_mm, x_most_mm, .. } } = &refused else {
        panic!("{refused}")
    };
    assert_eq!((*angles, *x_most_mm), (wide, collimator.over_travel_mm));
    assert!(x_mm.abs() + 5.0 > *x_most_mm);
    let text = refused.to_string();
    assert!(text.starts_with(&format!("the beam at {wide} degrees: the bixel at x = ")), "{text}");
    // A search is refused only where it finds too few beams that can be shaped.
    let searched =
        |beams| check(PlanRequest { beams, budget: 1, ..PlanRequest::of_method(MethodName::Greedy) });
    searched(1).unwrap();
    let closed = Collimator { over_travel_mm: 10.0, ..Collimator::generic() };
    let search = PlanRequest { beams: 1, budget: 1, ..PlanRequest::of_method(MethodName::Greedy) };
    let search = search.check(&setup.case, setup.directions.clone()).unwrap();
    assert!(setup.check_leaves(&search, &closed).is_err());
}

/// Prints what leaves cost on the pelves of `LEAVES_SEEDS`; without it, nothing is planned.
#[test]
fn leaves_of_seeds() {
    let seeds = std::env::var("LEAVES_SEEDS").unwrap_or_default();
    for seed in seeds.split(',').filter_map(|seed| seed.parse().ok()) {
        let planned = planned(seed, &FIVE_DEG, [5.0, 10.0]);
        let found = sequenced(&planned, &Collimator::generic(), OPTIONS);
        let [opaque, all] = [found.opaque, found.plan.certificate.objective]
            .map(|cost| 100.0 * (cost / of_doses(&planned) - 1.0));
        println!("seed {seed}: {} segments, {opaque:.2} %, {all:.2} %", segments(&found));
        assert!(opaque < 3.0, "seed {seed}: {opaque} %");
    }
}

/// Five beams of the class solution.
const FIVE_DEG: [f64; 5] = [44.0, 92.0, 120.0, 252.0, 336.0];

#[test]
fn leaves_cost_little_and_a_little_more_with_transmission() {
    let planned = planned(1, &FIVE_DEG, [10.0, 10.0]);
    let loss = |cost: f64| cost / of_doses(&planned) - 1.0;
    let collimator = Collimator::generic();
    let found = sequenced(&planned, &collimator, OPTIONS);
    // Segments may cost a little less than a fluence that pays for its modulation.
    assert!((-0.03..0.03).contains(&loss(found.opaque)), "{}", loss(found.opaque));
    let with_transmission = loss(found.plan.certificate.objective);
    assert!((loss(found.opaque)..0.06).contains(&with_transmission), "{with_transmission}");
    assert!((10..=150).contains(&segments(&found)), "{} segments", segments(&found));
    // Few levels lose more; segments by price bring it back.
    let coarse = sequenced(&planned, &collimator, LeafOptions { levels: 3, ..OPTIONS });
    assert!(loss(coarse.divided) > 0.05 && coarse.added > 0 && coarse.opaque < coarse.divided);
    for beam in found.beams.iter().chain(&coarse.beams).flatten() {
        for segment in &beam.segments {
            let tips = &segment.tips_mm;
            assert!(segment.weight > 0.0 && tips.iter().all(|[low, high]| low <= high && low.abs() <= 150.0));
        }
    }
    // A machine that cannot give short segments has fewer and loses more.
    let least = 0.2 * planned.best().plan.weights.iter().copied().fold(0.0, f64::max);
    let fewer = sequenced(&planned, &collimator, LeafOptions { least_weight: least, ..OPTIONS });
    assert!(segments(&fewer) < segments(&found));
    assert!(fewer.beams.iter().flatten().flat_map(|b| &b.segments).all(|s| s.weight >= least));
}

#[test]
fn the_dose_of_the_segments_is_that_of_what_passes_their_leaves() {
    let planned = planned(0, &FIVE_DEG, [12.0, 20.0]);
    let collimator = Collimator { transmission: 0.02, ..Collimator::generic() };
    let options = LeafOptions { width_mm: 20.0, loss: f64::INFINITY, ..OPTIONS };
    let found = sequenced(&planned, &collimator, options);
    let mut doses = vec![0.0; planned.setup.goals.voxels().len()];
    for (number, beam) in planned.best().beams.beams().iter().zip(&found.beams) {
        let (places, weights) = beam.as_ref().unwrap().fluence(&collimator, 20.0);
        let of_bixel =
            |bixel: &[f64; 2]| places.iter().position(|p| p == bixel).map_or(0.0, |at| weights[at]);
        let on_bixels: Vec<f64> = planned.doses.solved.bixels_mm(*number).iter().map(of_bixel).collect();
        let matrix = planned.doses.solved.beam(*number);
        for (dose, row) in doses.iter_mut().zip(planned.setup.goals.voxels()) {
            let (columns, values) = matrix.row(*row as usize);
            *dose += columns
                .iter()
                .zip(values)
                .map(|(c, v)| f64::from(*v) * on_bixels[usize::from(*c)])
                .sum::<f64>();
        }
    }
    for (reported, expected) in found.plan.dose.iter().zip(&doses) {
        assert!((reported - expected).abs() < 1e-4 * (1.0 + expected), "{reported} {expected}");
    }
}
