//! What a plan by pencil beams is worth in lung: its dose as it was planned, and by superposition.

use std::num::NonZeroUsize;
use std::time::Instant;

use stillpoint_patient::case::{Case, Role, lung, neck, phantom, read};
use stillpoint_plan::dose::{DoseParams, EngineName, LowDensity, Machine, PencilsOf};
use stillpoint_plan::evaluation::{OnGrid, StructureDose};
use stillpoint_plan::recipe::{PlanEngine, PlanRequest, PlanSetup, Planned, SetupSpec, plan};
use stillpoint_plan::recompute::{BeamFluence, Recompute};

const THREADS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1);

fn planned(case: Case, engine: PlanEngine, grid_mm: f64) -> Planned {
    let spec = SetupSpec { engine, grid_mm, ..SetupSpec::shipped().unwrap() };
    let request =
        PlanRequest { threads: THREADS, ..PlanRequest::of_angles(vec![0.0, 72.0, 144.0, 216.0, 288.0]) };
    plan(case, spec, &request).unwrap()
}

fn coarse(engine: PlanEngine) -> SetupSpec {
    SetupSpec { engine, grid_mm: 15.0, bixel_mm: 20.0, ..SetupSpec::shipped().unwrap() }
}

/// In a pelvis there is neither lung nor air.
#[test]
fn a_machine_whose_pencil_kernels_are_of_another_beam_is_planned_by_superposition_or_with_a_caution() {
    let of = |engine: PlanEngine, pencils_of: PencilsOf| {
        let mut file = Machine::shipped().unwrap().file().clone();
        file.pencils_of = pencils_of;
        // The mark is kept by a file.
        let machine = Machine::from_json(&file.to_json().unwrap()).unwrap();
        let setup = PlanSetup::new(phantom(0).unwrap(), SetupSpec { machine, ..coarse(engine) }).unwrap();
        (setup.engine_of_plan(&[0, 5]).unwrap(), setup.caution(&LowDensity::default()))
    };
    assert_eq!(of(PlanEngine::Auto, PencilsOf::Machine), (EngineName::Pencil, None));
    assert_eq!(of(PlanEngine::Auto, PencilsOf::Start).0, EngineName::Superposition);
    let (engine, caution) = of(PlanEngine::Pencil, PencilsOf::Start);
    assert_eq!(engine, EngineName::Pencil);
    assert!(caution.unwrap().contains("pencil beams of another machine"));
    assert_eq!(of(PlanEngine::Superposition, PencilsOf::Start), (EngineName::Superposition, None));
}

fn fluences(planned: &Planned) -> Vec<BeamFluence> {
    let best = planned.best();
    let fluence = |beam: &u16| BeamFluence {
        angles: planned.setup.directions.angles(*beam),
        bixels_mm: planned.doses.solved.bixels_mm(*beam).to_vec(),
        weights: best.weights_of(*beam).unwrap().to_vec(),
    };
    best.beams.beams().iter().map(fluence).collect()
}

/// The figures of the targets of a plan, by a dose engine on a grid of this spacing.
fn targets(planned: &Planned, engine: EngineName, grid_mm: f64) -> Vec<StructureDose> {
    let setup = &planned.setup;
    let params = DoseParams { engine, ..*setup.engine().params() };
    let machine = setup.spec.machine.clone();
    let recompute = Recompute::with_spacing(&setup.case, machine, &params, grid_mm).unwrap();
    let gray = recompute.dose(&BeamFluence::weighted(&fluences(planned)), [0.0; 3], THREADS).unwrap();
    let mut figures = OnGrid::new(&setup.case, recompute.grid()).evaluate(&gray).figures(&[]);
    figures.retain(|f| matches!(f.role, Role::Target | Role::ClinicalTarget));
    figures
}

/// `cargo test --workspace --release --test superposition after_optimisation -- --ignored --nocapture`
///
/// `STILLPOINT_CASES` names case files, separated by `:`, in place of the phantoms.
#[test]
#[ignore = "prints the table of docs/results/dose.md"]
fn after_optimisation() {
    let cases: Vec<Case> = match std::env::var("STILLPOINT_CASES") {
        Ok(paths) => paths.split(':').map(|path| read(path.as_ref()).unwrap()).collect(),
        Err(_) => (0..2).map(|seed| lung(seed).unwrap()).collect(),
    };
    for case in cases {
        for engine in [PlanEngine::Pencil, PlanEngine::Superposition] {
            let before = Instant::now();
            let plan = planned(case.clone(), engine, 5.0);
            let took_s = before.elapsed().as_secs_f64();
            println!("{} by {engine}: {took_s:.0} s", plan.setup.case.name());
            for by in EngineName::ALL {
                for f in targets(&plan, by, 3.0) {
                    println!(
                        "  {} by {by}: D98 {:.1}, D95 {:.1}, D50 {:.1}, D2 {:.1} Gy",
                        f.name, f.d98_gy, f.d95_gy, f.d50_gy, f.d2_gy
                    );
                }
            }
        }
    }
}

#[test]
fn a_plan_by_pencil_beams_promises_a_tumour_in_lung_more_than_it_gets() {
    let plan = planned(lung(0).unwrap(), PlanEngine::Pencil, 12.0);
    let of = |engine| targets(&plan, engine, 5.0).into_iter().find(|f| f.name == "PTV").unwrap();
    let (believed, is) = (of(EngineName::Pencil), of(EngineName::Superposition));
    let lungs = plan.setup.objective_set.structures.iter().find(|of| of.name == "Lungs").unwrap();
    assert_eq!(lungs.objectives.len(), 2, "limits on both lungs are served");
    assert!(believed.d95_gy > 50.0, "{believed:?}");
    assert!(is.d95_gy < 0.97 * believed.d95_gy, "{} Gy, by superposition {} Gy", believed.d95_gy, is.d95_gy);
}

#[test]
fn by_itself_a_plan_in_lung_is_searched_by_pencil_beams_and_made_by_superposition() {
    let searched = PlanRequest { beams: 2, budget: 3, threads: THREADS, ..PlanRequest::default() };
    let by = |engine, request: &PlanRequest| plan(lung(0).unwrap(), coarse(engine), request).unwrap();
    let [auto, pencil] = [PlanEngine::Auto, PlanEngine::Pencil].map(|engine| by(engine, &searched));
    assert_eq!(auto.setup.engine_name(), EngineName::Superposition);
    // The history is that of the search.
    let costs = |planned: &Planned| planned.run.history.iter().map(|p| p.cost.to_bits()).collect::<Vec<_>>();
    assert_eq!(costs(&auto), costs(&pencil));
    assert!(auto.best().cost > pencil.best().cost, "{} and {}", auto.best().cost, pencil.best().cost);
    // The plan is that of these angles, without a search.
    let given = PlanRequest { threads: THREADS, ..PlanRequest::of_angles(auto.angles_deg()) };
    for engine in [PlanEngine::Auto, PlanEngine::Superposition] {
        let by_hand = by(engine, &given);
        assert_eq!(auto.best().cost.to_bits(), by_hand.best().cost.to_bits());
        assert_eq!(fluences(&auto)[0].weights, fluences(&by_hand)[0].weights);
    }
}

#[test]
fn by_itself_a_pelvis_stays_with_pencil_beams_and_a_neck_does_not() {
    let request = PlanRequest::of_angles(vec![0.0, 120.0, 240.0]);
    let by = |case: Case| plan(case, coarse(PlanEngine::Auto), &request).unwrap().setup.engine_name();
    assert_eq!(by(phantom(0).unwrap()), EngineName::Pencil);
    assert_eq!(by(neck(0).unwrap()), EngineName::Superposition);
}

#[test]
fn by_itself_a_machine_without_kernels_stays_with_pencil_beams() {
    let mut file = Machine::shipped().unwrap().file().clone();
    file.superposition = None;
    let spec = SetupSpec { machine: Machine::new(file).unwrap(), ..coarse(PlanEngine::Auto) };
    let made = plan(lung(0).unwrap(), spec, &PlanRequest::of_angles(vec![0.0, 180.0])).unwrap();
    assert_eq!(made.setup.engine_name(), EngineName::Pencil);
    let crossed = made.setup.low_density(made.best(), &made.doses.solved).unwrap();
    assert!(crossed.caution().is_some(), "{crossed:?}");
}
