//! What a plan by pencil beams is worth in lung: its dose as it was planned, and by superposition.

use std::num::NonZeroUsize;
use std::time::Instant;

use stillpoint_patient::case::{Case, Role, lung, read};
use stillpoint_plan::dose::{DoseParams, EngineName};
use stillpoint_plan::evaluation::{OnGrid, StructureDose};
use stillpoint_plan::recipe::{PlanRequest, Planned, SetupSpec, plan};
use stillpoint_plan::recompute::{BeamFluence, Recompute};

const THREADS: NonZeroUsize = NonZeroUsize::MIN.saturating_add(1);

fn planned(case: Case, engine: EngineName, grid_mm: f64) -> Planned {
    let spec = SetupSpec { engine, grid_mm, ..SetupSpec::shipped().unwrap() };
    let request =
        PlanRequest { threads: THREADS, ..PlanRequest::of_angles(vec![0.0, 72.0, 144.0, 216.0, 288.0]) };
    plan(case, spec, &request).unwrap()
}

fn fluences(planned: &Planned) -> Vec<BeamFluence> {
    let best = planned.best();
    let fluence = |beam: &u16| BeamFluence {
        gantry_deg: planned.setup.spec.ring.angle_deg(*beam),
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
        for engine in EngineName::ALL {
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
    let plan = planned(lung(0).unwrap(), EngineName::Pencil, 12.0);
    let of = |engine| targets(&plan, engine, 5.0).into_iter().find(|f| f.name == "PTV").unwrap();
    let (believed, is) = (of(EngineName::Pencil), of(EngineName::Superposition));
    let lungs = plan.setup.objective_set.structures.iter().find(|of| of.name == "Lungs").unwrap();
    assert_eq!(lungs.objectives.len(), 2, "limits on both lungs are served");
    assert!(believed.d95_gy > 50.0, "{believed:?}");
    assert!(is.d95_gy < 0.97 * believed.d95_gy, "{} Gy, by superposition {} Gy", believed.d95_gy, is.d95_gy);
}
