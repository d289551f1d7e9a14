//! The fluence of nine given beams for scans and patients: how large, how long, how good.
//!
//! `cargo bench -p stillpoint-plan --bench patients -- [NAME|WIDTH_MM|grid=MM|tolerance=PART|threads=N|points]...`. Bixels
//! are 10 mm wide where no width is given, and all cases are solved where none is named. Rows are all voxels of a grid of
//! 5 mm; with `points`, they are the points of `stillpoint plan`. The doses are kept in `target/doses`; seconds are of the
//! solve alone, from the kept doses on.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};
use stillpoint_patient::case::{NameTable, import_described};
use stillpoint_plan::beams::{Budget, Evaluator};
use stillpoint_plan::dose::DoseCache;
use stillpoint_plan::recipe::{PlanDoses, PlanSetup, PointScheme, SetupSpec};
use stillpoint_testing::reference;

const NAMES: [&str; 5] = ["tg119", "openkbp_1", "openkbp_2", "openkbp_3", "openkbp_4"];

fn main() {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let of = |name: &str, default: f64| {
        let value = given.iter().find_map(|a| a.strip_prefix(name)?.strip_prefix('='));
        value.map_or(default, |value| value.parse().unwrap())
    };
    let mut widths_mm: Vec<f64> = given.iter().filter_map(|a| a.parse().ok()).collect();
    if widths_mm.is_empty() {
        widths_mm.push(10.0);
    }
    let grid_mm = of("grid", 5.0);
    let threads = NonZeroUsize::new(of("threads", 1.0) as usize).unwrap();
    let Some(root) = reference::folder("planning") else { return };
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or("target".into(), PathBuf::from);
    let cache = DoseCache::in_folder(&target.join("doses")).unwrap();
    let ring = SetupSpec::shipped().unwrap().ring;
    let beams: Vec<u16> = (0..9).map(|i| 10 * i).collect();
    println!(
        "| patient | bixel, mm | voxels | bixels | CPU s | wall s | Newton steps | cost | proved excess |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for width_mm in widths_mm {
        let asked = |name: &&str| {
            given.iter().any(|g| g == name) || !given.iter().any(|g| NAMES.contains(&g.as_str()))
        };
        for name in NAMES.into_iter().filter(asked) {
            let folder = name.split('_').next().unwrap();
            let described = root.join(folder).join(format!("{name}.json"));
            let case = import_described(&described, &NameTable::shipped().unwrap()).unwrap().case;
            let points = match given.iter().any(|g| g == "points") {
                true => PointScheme::Borders,
                false => PointScheme::EveryVoxel,
            };
            let spec = SetupSpec { grid_mm, bixel_mm: width_mm, points, ..SetupSpec::shipped().unwrap() };
            let setup = PlanSetup::new(case, spec).unwrap();
            let goals = &setup.goals;
            let two = NonZeroUsize::new(2).unwrap();
            let doses = PlanDoses::load(&setup, &cache, &beams, two, || ()).unwrap().solved;
            let (began, clock) = (cpu_seconds(), Instant::now());
            let evaluator = Evaluator::new(&doses, goals, ring, 9, Budget { solves: 1 });
            let mut evaluator =
                evaluator.with_threads(threads).with_tolerance(of("tolerance", 1e-6)).unwrap();
            let best = evaluator.evaluate(&ring.set(&beams).unwrap(), None).unwrap();
            println!(
                "| {name} | {width_mm} | {} | {} | {:.2} | {:.2} | {} | {:.6} | {:.1e} |",
                goals.voxels().len(),
                best.plan.weights.len(),
                cpu_seconds() - began,
                clock.elapsed().as_secs_f64(),
                best.plan.steps,
                best.cost,
                best.plan.certificate.relative_excess()
            );
        }
    }
}

fn cpu_seconds() -> f64 {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}
