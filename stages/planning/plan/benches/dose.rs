//! Time of a beam's dose: all 90 beams of a pelvis where the planning data is, else one of a water box.
//!
//! `cargo bench -p stillpoint-plan --bench dose`

#![allow(clippy::unwrap_used, clippy::print_stdout, missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::num::NonZeroUsize;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Mask, NameTable, import_described};
use stillpoint_plan::dose::{Anatomy, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_testing::reference;

fn water_box() -> DoseEngine {
    let grid = Grid { counts: [100, 60, 60], spacing_mm: [3.0; 3], origin_mm: [-148.5, -88.5, -88.5] };
    let all = Mask::from_fn(grid.len(), |_| true);
    let target =
        Mask::from_fn(grid.len(), |i| grid.centre_mm(grid.voxel(i)).iter().all(|mm| mm.abs() < 30.0));
    let anatomy =
        Anatomy { grid, hu: &vec![0; grid.len()], external: &all, target: &target, isocentre_mm: [0.0; 3] };
    DoseEngine::new(&anatomy, Machine::shipped().unwrap(), DoseParams::over(&grid, 5.0)).unwrap()
}

fn pelvis() -> Option<DoseEngine> {
    let described = reference::folder("planning")?.join("pelvis_000/pelvis_000.json");
    let case = import_described(&described, &NameTable::shipped().unwrap()).unwrap().case;
    Some(DoseEngine::of_case(&case, Machine::shipped().unwrap(), DoseParams::over(case.grid(), 5.0)).unwrap())
}

fn dose(bench: &mut Criterion) {
    let mut group = bench.benchmark_group("dose");
    group.sample_size(10);
    let engine = water_box();
    group.bench_function("one beam, water box", |b| b.iter(|| black_box(engine.beam(30.0)).unwrap()));
    let Some(engine) = pelvis() else { return };
    let angles: Vec<f64> = (0..90).map(|step| 4.0 * f64::from(step)).collect();
    let (mut bixels, mut entries) = (0, 0);
    for &deg in &angles {
        let beam = engine.beam(deg).unwrap();
        bixels += beam.bixels_mm.len();
        entries += beam.dose.view().value.len();
    }
    println!("pelvis: {bixels} bixels, {entries} entries");
    group.bench_function("90 beams, pelvis", |b| {
        b.iter(|| angles.iter().map(|&deg| engine.beam(deg).unwrap().bixels_mm.len()).sum::<usize>())
    });
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let five = &angles[..5];
    let beams = cache.beams(&engine, five, NonZeroUsize::MIN).unwrap();
    println!("pelvis: {} bytes for 5 beams in the cache", beams.iter().map(|b| b.beam.size()).sum::<usize>());
    group.bench_function("5 beams from the cache, pelvis", |b| {
        b.iter(|| black_box(cache.beams(&engine, five, NonZeroUsize::MIN)).unwrap())
    });
}

criterion_group!(benches, dose);
criterion_main!(benches);
