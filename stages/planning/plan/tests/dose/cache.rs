//! Doses kept on disk.

use super::phantom::{Phantom, cube};
use std::num::NonZeroUsize;
use std::path::Path;
use stillpoint_plan::Rows;
use stillpoint_plan::dose::{BeamFileError, DoseCache, DoseEngine, DoseParams, Machine, Origin};

fn engine() -> DoseEngine {
    let phantom = Phantom::water(cube(15, 5.0));
    phantom.engine(Machine::shipped().unwrap(), phantom.params())
}

fn files(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_beam_is_computed_once_and_then_found_with_the_same_dose() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(&folder.path().join("made/on/demand")).unwrap();
    let engine = engine();
    let direct = engine.beam(40.0).unwrap();
    let first = cache.beam(&engine, 40.0).unwrap();
    let second = cache.beam(&engine, 40.0).unwrap();
    assert!(matches!((&first.origin, &second.origin), (Origin::Computed, Origin::Found)));
    let rows = Rows::from_columns(direct.dose.view()).unwrap();
    for cached in [&first.beam, &second.beam] {
        assert_eq!((cached.angles().gantry_deg, cached.bixels_mm()), (40.0, direct.bixels_mm.as_slice()));
        assert_eq!(cached.dose(), rows.view());
    }
    let entries = direct.dose.view().value.len();
    let voxels = direct.dose.view().rows;
    assert_eq!(first.beam.size(), 80 + 16 * direct.bixels_mm.len() + 4 * (voxels + 1) + 6 * entries);
}

#[test]
fn anything_that_dose_depends_on_makes_another_file() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let phantom = Phantom::water(cube(15, 5.0));
    let machine = || Machine::shipped().unwrap();
    let mut other = machine().file().clone();
    other.kernels_per_mm2[1][16][5] *= 1.0 + 1e-12;
    let mut denser = Phantom::water(phantom.grid);
    denser.hu[1000] = 1;
    let engines = [
        engine(),
        phantom.engine(machine(), DoseParams { cutoff_mm: 49.0, ..phantom.params() }),
        phantom.engine(Machine::new(other).unwrap(), phantom.params()),
        denser.engine(machine(), phantom.params()),
        Phantom { target_half_mm: 20.0, ..Phantom::water(phantom.grid) }.engine(machine(), phantom.params()),
        Phantom { isocentre_mm: [0.0, 0.0, 1e-9], ..Phantom::water(phantom.grid) }
            .engine(machine(), phantom.params()),
    ];
    for (before, engine) in engines.iter().enumerate() {
        assert!(matches!(cache.beam(engine, 0.0).unwrap().origin, Origin::Computed), "{before}");
    }
    cache.beam(&engines[0], 1.0).unwrap();
    // An engine keeps its key once it was asked for; what is made from it has a key of its own.
    let from = &engines[0];
    let wide = stillpoint_plan::dose::BixelSpec { width_mm: 12.0, ..from.params().bixels };
    let made = [
        from.shifted([1.0, 0.0, 0.0]).unwrap(),
        from.within(&[1500, 1600]),
        from.sampled(vec![1500, 1600]),
        from.with_bixels(wide),
    ];
    for (number, engine) in made.iter().enumerate() {
        assert!(matches!(cache.beam(engine, 0.0).unwrap().origin, Origin::Computed), "made {number}");
    }
    assert_eq!(files(folder.path()).len(), engines.len() + 1 + made.len());
}

#[test]
fn a_file_that_changed_is_replaced_and_said_so() {
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let engine = engine();
    drop(cache.beam(&engine, 0.0).unwrap());
    let path = files(folder.path()).remove(0);
    let whole = std::fs::read(&path).unwrap();
    let mut changed = whole.clone();
    *changed.last_mut().unwrap() ^= 1;
    std::fs::write(&path, changed).unwrap();
    assert!(matches!(
        cache.beam(&engine, 0.0).unwrap().origin,
        Origin::Replaced(BeamFileError::Checksum { .. })
    ));
    std::fs::write(&path, &whole[..whole.len() - 8]).unwrap();
    assert!(matches!(cache.beam(&engine, 0.0).unwrap().origin, Origin::Replaced(BeamFileError::Size { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), whole);
}

#[test]
fn any_number_of_threads_fills_the_cache_with_the_same_bytes() {
    let angles = [0.0, 30.0, 60.0, 90.0, 120.0];
    let bytes = [1, 2, 7].map(|threads| {
        let folder = tempfile::tempdir().unwrap();
        let cache = DoseCache::in_folder(folder.path()).unwrap();
        let beams = cache.beams(&engine(), &angles, NonZeroUsize::new(threads).unwrap()).unwrap();
        assert!(beams.iter().map(|cached| cached.beam.angles().gantry_deg).eq(angles));
        files(folder.path())
            .iter()
            .map(|f| (f.file_name().unwrap().to_owned(), std::fs::read(f).unwrap()))
            .collect::<Vec<_>>()
    });
    assert!(bytes[0] == bytes[1] && bytes[0] == bytes[2]);
}

#[test]
fn a_folder_that_cannot_be_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let fault = DoseCache::in_folder(&file.join("cache")).unwrap_err().to_string();
    assert!(
        fault.starts_with("the dose cache cannot write") && fault.contains("give another folder"),
        "{fault}"
    );
}

#[test]
fn doses_of_others_are_apart_until_they_are_adopted_and_go_with_the_cache_that_took_them() {
    let folder = tempfile::tempdir().unwrap();
    let engine = engine();
    let dose = engine.beam_file(40.0).unwrap();
    let plain = DoseCache::in_folder(folder.path()).unwrap();
    let is_missing = |cache: &DoseCache| !cache.missing(&engine, &[40.0]).is_empty();
    for is_adopted in [false, true] {
        let apart = DoseCache::with_pending(folder.path()).unwrap();
        apart.put(&engine, 40.0, &dose).unwrap();
        assert!(apart.file(&engine, 40.0).exists());
        assert_eq!((is_missing(&apart), is_missing(&plain)), (false, true));
        assert!(matches!(apart.beam(&engine, 40.0).unwrap().origin, Origin::Found));
        // Another process at the same time has a folder of its own.
        let second = DoseCache::with_pending(folder.path()).unwrap();
        assert!(is_missing(&second));
        if is_adopted {
            apart.adopt().unwrap();
        }
        drop((apart, second));
        assert_eq!(is_missing(&plain), !is_adopted);
    }
    assert!(matches!(plain.beam(&engine, 40.0).unwrap().origin, Origin::Found));
}

#[test]
fn doses_of_a_process_that_was_killed_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let engine = engine();
    let killed = DoseCache::with_pending(folder.path()).unwrap();
    killed.put(&engine, 40.0, &engine.beam_file(40.0).unwrap()).unwrap();
    let left = killed.file(&engine, 40.0);
    let bytes = std::fs::read(&left).unwrap();
    drop(killed);
    std::fs::write(&left, bytes).unwrap();
    assert!(!DoseCache::in_folder(folder.path()).unwrap().missing(&engine, &[40.0]).is_empty());
    let next = DoseCache::with_pending(folder.path()).unwrap();
    assert!(!left.exists());
    assert!(!next.missing(&engine, &[40.0]).is_empty());
}
