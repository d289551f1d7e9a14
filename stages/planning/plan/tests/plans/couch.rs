//! The search with couch angles.

use std::num::NonZeroUsize;

use stillpoint_patient::case::neck;
use stillpoint_plan::beams::BeamSet;
use stillpoint_plan::dose::DoseCache;
use stillpoint_plan::recipe::{
    CouchError, CouchRun, MethodName, PlanDoses, PlanEngine, PlanRequest, PlanRun, PlanSearch, PlanSetup,
    RobustBy, SetupSpec, set_up_errors,
};

/// A neck on coarse points with few directions, so that the test is fast.
fn spec() -> SetupSpec {
    let engine = PlanEngine::Pencil;
    let ring = SetupSpec::ring_of(18).unwrap();
    SetupSpec { grid_mm: 12.0, bixel_mm: 20.0, engine, ring, ..SetupSpec::shipped().unwrap() }
}

fn coplanar(setup: &PlanSetup, cache: &DoseCache, threads: usize) -> (PlanSearch, PlanRun) {
    let threads = NonZeroUsize::new(threads).unwrap();
    let request =
        PlanRequest { beams: 3, budget: 6, threads, ..PlanRequest::of_method(MethodName::Exchange) };
    let search = request.check(&setup.case, setup.spec.directions()).unwrap();
    let doses = PlanDoses::load(setup, cache, &search.needed_beams(), threads, || ()).unwrap();
    let run = search.run(search.evaluator(setup, &doses, None)).unwrap();
    (search, run)
}

#[test]
fn couch_angles_are_never_worse_and_few_candidates_get_a_dose() {
    let setup = PlanSetup::new(neck(0).unwrap(), spec()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let of = |threads: usize, most_deg: f64| -> (PlanRun, CouchRun) {
        let (search, run) = coplanar(&setup, &cache, threads);
        let found = search.with_couch(&setup, &cache, &run, most_deg).unwrap();
        (run, found)
    };
    let (before, found) = of(1, 180.0);
    let cost = |run: &PlanRun| run.choice.best.cost;
    println!(
        "{} without, {} with couch angles, {} of {} doses, {:?}",
        cost(&before),
        cost(&found.run),
        found.doses,
        found.candidates,
        found.run.directions.all(found.run.choice.best.beams.beams())
    );
    assert!(cost(&found.run) < cost(&before) && found.run.solves() <= 6);
    // It begins where the search without couch angles ended.
    assert!((found.run.history[0].cost / cost(&before) - 1.0).abs() < 1e-5);
    assert!(
        found.candidates > 40 && 2 * found.doses < found.candidates,
        "{} {}",
        found.doses,
        found.candidates
    );
    let angles = found.run.directions.all(found.run.choice.best.beams.beams());
    // Sets with couch angles were solved. On this neck the best ones enter by the end of the images, so they are no candidates.
    let all_of = |beams: &BeamSet| found.run.directions.all(beams.beams());
    let is_turned = |beams: &BeamSet| all_of(beams).iter().any(|angles| !angles.is_coplanar());
    assert!(found.run.history.iter().any(|solve| is_turned(&solve.beams)));
    let free = setup.spec.machine.free_angles();
    assert!(
        angles.iter().all(|angles| angles.is_coplanar() || free.iter().any(|range| range.holds(*angles)))
    );
    // Any number of threads finds the same.
    let (_, again) = of(3, 180.0);
    assert_eq!(found.run.history, again.run.history);
    assert_eq!(found.doses, again.doses);
    // A narrower couch has fewer candidates, and a couch that does not turn has coplanar ones alone.
    let (_, narrow) = of(1, 30.0);
    assert!(narrow.candidates < found.candidates && cost(&narrow.run) <= cost(&before));
    assert!(
        narrow
            .run
            .directions
            .all(narrow.run.choice.best.beams.beams())
            .iter()
            .all(|a| a.couch_deg.abs() <= 30.0)
    );
}

#[test]
fn the_robust_game_has_no_couch_angles() {
    let errors_mm = set_up_errors(3.0).unwrap();
    let game = SetupSpec { errors_mm, robust_by: RobustBy::Worst, ..spec() };
    let setup = PlanSetup::new(neck(0).unwrap(), game).unwrap();
    let plain = PlanSetup::new(neck(0).unwrap(), spec()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let (search, run) = coplanar(&plain, &cache, 1);
    assert!(matches!(search.with_couch(&setup, &cache, &run, 90.0), Err(CouchError::Game)));
}
