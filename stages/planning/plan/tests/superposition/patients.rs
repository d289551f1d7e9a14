//! What an optimiser sees by the columns of bixels against the superposition of the same fluence, on patients.

use std::num::NonZeroUsize;

use super::columns::cpu_s;
use stillpoint_patient::case::{Case, lung, neck, read};
use stillpoint_plan::beams::Evaluated;
use stillpoint_plan::fluence::StructureObjectives;
use stillpoint_plan::recipe::{PlanDoses, PlanEngine, PlanRequest, PlanSetup, SetupSpec, plan};
use stillpoint_plan::recompute::BeamFluence;

const ANGLES: [f64; 5] = [0.0, 72.0, 144.0, 216.0, 288.0];
const THREADS: NonZeroUsize = NonZeroUsize::MIN;

fn spec(grid_mm: f64, bixel_mm: f64) -> SetupSpec {
    SetupSpec { engine: PlanEngine::Superposition, grid_mm, bixel_mm, ..SetupSpec::shipped().unwrap() }
}

/// Each beam with its weights.
fn fluences(setup: &PlanSetup, doses: &PlanDoses, plan: &Evaluated) -> Vec<BeamFluence> {
    let fluence = |beam: &u16| BeamFluence {
        angles: setup.directions.angles(*beam),
        bixels_mm: doses.solved.bixels_mm(*beam).to_vec(),
        weights: plan.weights_of(*beam).unwrap().to_vec(),
    };
    plan.beams.beams().iter().map(fluence).collect()
}

/// The superposition of a fluence at the points of a plan.
fn at_points(setup: &PlanSetup, fluences: &[BeamFluence]) -> Vec<f64> {
    let mut sum = vec![0.0; setup.engine().rows()];
    for of in fluences {
        let dose = setup.engine().weighted_bixels(of.angles, &of.bixels_mm, &of.weights).unwrap();
        sum.iter_mut().zip(&dose).for_each(|(sum, dose)| *sum += f64::from(*dose));
    }
    sum
}

/// Of the greatest prescribed dose: how far the dose of the columns is from these doses over the points of the targets, in the
/// mean and root mean square.
fn off_in_targets(setup: &PlanSetup, columns: &[f32], whole: &[f64]) -> [f64; 2] {
    let targets: Vec<&str> = setup.case.targets().map(|target| target.name.as_str()).collect();
    let (mut sum, mut squares, mut volume) = (0.0, 0.0, 0.0);
    for of in setup.objective_set.structures.iter().filter(|of| targets.contains(&of.name.as_str())) {
        for (row, part) in of.voxels.iter().zip(&of.volumes) {
            let off = f64::from(columns[*row as usize]) - whole[*row as usize];
            (sum, squares, volume) = (sum + part * off, squares + part * off * off, volume + part);
        }
    }
    let prescribed_gy = setup.prescribed_gy();
    [sum / volume / prescribed_gy, (squares / volume).sqrt() / prescribed_gy]
}

#[test]
fn the_columns_of_a_plan_give_the_superposition_of_its_fluence() {
    let request = PlanRequest { threads: THREADS, ..PlanRequest::of_angles(ANGLES.to_vec()) };
    let plan = plan(lung(0).unwrap(), spec(12.0, 20.0), &request).unwrap();
    let setup = &plan.setup;
    let whole = at_points(setup, &fluences(setup, &plan.doses, plan.best()));
    let [mean, rms] = off_in_targets(setup, &plan.doses.solved.dose(plan.best(), 0), &whole);
    assert!(mean.abs() < 1e-3 && rms < 2e-3, "{mean} {rms}");

    // Without the correction they have the scatter of an open field.
    let beams = plan.best().beams.beams();
    let open = PlanDoses::compute(setup, beams, THREADS).unwrap();
    let [mean, rms] = off_in_targets(setup, &open.solved.dose(plan.best(), 0), &whole);
    assert!(mean.abs() > 4e-3 && rms > 4e-3, "{mean} {rms}");
}

/// `cargo test --workspace --release --test superposition columns_on_patients -- --ignored --nocapture`
///
/// `STILLPOINT_CASES` names case files, separated by `:`, in place of the phantoms; `STILLPOINT_SIZES` the spacing of the
/// points and the width of the bixels, mm, such as `5,10`.
#[test]
#[ignore = "prints the table of docs/results/dose.md"]
fn columns_on_patients() {
    let cases: Vec<Case> = match std::env::var("STILLPOINT_CASES") {
        Ok(paths) => paths.split(':').map(|path| read(path.as_ref()).unwrap()).collect(),
        Err(_) => vec![lung(0).unwrap(), neck(0).unwrap()],
    };
    let sizes = std::env::var("STILLPOINT_SIZES").unwrap_or("10,15".to_owned());
    let (grid_mm, bixel_mm) = sizes.split_once(',').unwrap();
    let (grid_mm, bixel_mm) = (grid_mm.parse().unwrap(), bixel_mm.parse().unwrap());
    for case in cases {
        let request = PlanRequest { threads: THREADS, ..PlanRequest::of_angles(ANGLES.to_vec()) };
        let spec = spec(grid_mm, bixel_mm);
        let search = request.check(&case, spec.ring).unwrap();
        let setup = PlanSetup::new(case, spec).unwrap();
        println!("{} ({grid_mm}, {bixel_mm}), {} points", setup.case.name(), setup.engine().rows());
        let began = cpu_s();
        let doses = PlanDoses::compute(&setup, &search.needed_beams(), THREADS).unwrap();
        println!("  columns: {:.1} CPU s", cpu_s() - began);
        let began = cpu_s();
        let run = search.run(search.evaluator(&setup, &doses, None)).unwrap();
        println!("  fluence: {:.1} CPU s", cpu_s() - began);
        println!("{}", means(&setup, "open", &doses, &run.choice.best));
        let began = cpu_s();
        let (doses, run) = search.settle(&setup, doses, run).unwrap();
        println!("  correction and second fluence: {:.1} CPU s", cpu_s() - began);
        println!("{}", means(&setup, "corrected", &doses, &run.choice.best));
    }
}

/// Mean doses of the structures, a line each.
fn means(setup: &PlanSetup, name: &str, doses: &PlanDoses, plan: &Evaluated) -> String {
    let columns = doses.solved.dose(plan, 0);
    let whole = at_points(setup, &fluences(setup, doses, plan));
    let line = |of: &StructureObjectives| {
        let volume: f64 = of.volumes.iter().sum();
        let mean = |dose: &dyn Fn(usize) -> f64| {
            of.voxels.iter().zip(&of.volumes).map(|(v, volume)| volume * dose(*v as usize)).sum::<f64>()
                / volume
        };
        let (seen, is) = (mean(&|v| f64::from(columns[v])), mean(&|v| whole[v]));
        let rms = mean(&|v| (f64::from(columns[v]) - whole[v]).powi(2)).sqrt();
        format!(
            "  {name}: {}: {seen:.2} Gy, superposition {is:.2} Gy ({:+.2} %), rms {rms:.2} Gy",
            of.name,
            100.0 * (seen / is - 1.0)
        )
    };
    let whole_structures = setup.objective_set.structures.iter().filter(|of| !of.name.contains('('));
    whole_structures.map(line).collect::<Vec<_>>().join("\n")
}
