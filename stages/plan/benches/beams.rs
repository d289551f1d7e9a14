//! Choosing beams of a pelvis from doses in the cache: how long, and how good.
//!
//! `cargo bench -p stillpoint-plan --bench beams -- [BUDGET]`. The doses of 90 beams (about 1 GB) are kept in
//! `target/doses`, so that a second run finds them; one row begins at the image, with nothing kept.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use rustix::time::{ClockId, clock_gettime};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, choose, class_solution, pelvis_solutions};
use stillpoint_plan::case::{NameTable, import_described};
use stillpoint_plan::dose::{CachedBeam, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::fluence::{Goals, Objective, Wanted, voxels_on};
use stillpoint_testing::reference;

const BEAMS: usize = 5;

fn main() {
    let budget = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(40);
    let Some(root) = reference::folder("planning") else { return };
    let described = root.join("pelvis_000/pelvis_000.json");
    let case = import_described(&described, &NameTable::shipped().unwrap()).unwrap().case;
    let params = DoseParams::over(case.grid(), 5.0);
    let goals = goals(&case, &params);
    let engine = DoseEngine::of_case(&case, Machine::shipped().unwrap(), params).unwrap();
    let ring = Ring::new(90, 5).unwrap();
    let angles: Vec<f64> = (0..90).map(|beam| ring.angle_deg(beam)).collect();
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or("target".into(), PathBuf::from);
    let cache = DoseCache::in_folder(&target.join("doses")).unwrap();
    let two = NonZeroUsize::new(2).unwrap();
    let doses = cache.beams(&engine, &angles, two).unwrap();
    let entries: usize = doses.iter().map(|beam| beam.beam.dose().value.len()).sum();
    println!("{} voxels, {entries} entries", goals.voxels().len());
    drop(doses);

    let opened = seconds(ClockId::Monotonic);
    drop(cache.beams(&engine, &angles, NonZeroUsize::MIN).unwrap());
    println!("90 beams opened and checked on one thread: {:.2} s", seconds(ClockId::Monotonic) - opened);
    println!("| method | threads | s | CPU s | cost | solves | prices | beams, deg |");
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    let methods = [
        ("greedy", Method::Greedy, NonZeroUsize::MIN),
        ("greedy", Method::Greedy, two),
        ("greedy, from the image", Method::Greedy, two),
        ("equidistant", Method::Equidistant, two),
        ("class solution", Method::Class(class_solution(BEAMS)), two),
        ("random", Method::Random, two),
        ("exchange", Method::Exchange(pelvis_solutions(BEAMS)), two),
        ("annealing", Method::Annealing, two),
        ("column generation", Method::ColumnGeneration, two),
    ];
    for (name, method, threads) in methods {
        let (wall, cpu) = (seconds(ClockId::Monotonic), seconds(ClockId::ProcessCPUTime));
        // From the files: mapping them is part of it.
        let empty = tempfile::tempdir().unwrap();
        let none = DoseCache::in_folder(empty.path()).unwrap();
        let cache = if name == "greedy, from the image" { &none } else { &cache };
        let doses: Vec<CachedBeam> = cache.beams(&engine, &angles, threads).unwrap();
        let evaluator = Evaluator::new(&doses[..], &goals, ring, BEAMS, Budget { solves: budget });
        let mut evaluator = evaluator.with_threads(threads);
        let best = choose(&method, &mut evaluator, None, 1).unwrap().best;
        let angles: Vec<String> = best.beams.beams().iter().map(|b| ring.angle_deg(*b).to_string()).collect();
        println!(
            "| {name} | {threads} | {:.2} | {:.2} | {:.2} | {} | {} | {} |",
            seconds(ClockId::Monotonic) - wall,
            seconds(ClockId::ProcessCPUTime) - cpu,
            best.cost,
            evaluator.solves(),
            evaluator.prices(),
            angles.join(" ")
        );
    }
}

/// The goals of the fluence problem of the same pelvis. A voxel counts for the first structure that has it.
fn goals(case: &stillpoint_plan::case::Case, params: &DoseParams) -> Goals {
    let over = |dose, weight| Objective::Overdose { dose, weight };
    let under = |dose, weight| Objective::Underdose { dose, weight };
    let wanted = [
        ("PTV", vec![over(78.0, 100.0), under(78.0, 200.0)]),
        ("Rectum", vec![over(35.0, 20.0)]),
        ("Bladder", vec![over(35.0, 15.0)]),
        ("FemoralHeadL", vec![over(25.0, 8.0)]),
        ("FemoralHeadR", vec![over(25.0, 8.0)]),
        ("Body", vec![over(20.0, 8.0)]),
    ];
    let mut taken = vec![false; params.grid.len()];
    let wanted = wanted.map(|(name, objectives)| {
        let mask = &case.structure(name).unwrap_or_else(|| panic!("no {name}")).mask;
        let mut voxels = voxels_on(&params.grid, case.grid(), mask);
        voxels.retain(|v| !std::mem::replace(&mut taken[*v as usize], true));
        Wanted { name: name.into(), voxels, volumes: Vec::new(), to_target_mm: Vec::new(), objectives }
    });
    Goals::new(wanted.to_vec(), params.grid.len()).unwrap()
}

fn seconds(clock: ClockId) -> f64 {
    let now = clock_gettime(clock);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}
