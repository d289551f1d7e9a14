//! Plans of scans and patients, beside what is published of them.
//!
//! The data is looked for in `$STILLPOINT_DATA`, else in `../shared/data` beside the workspace.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, RingDoses, choose};
use stillpoint_plan::case::{Case, NameTable, import_described};
use stillpoint_plan::dose::{DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::evaluation::{OnGrid, StructureDose};
use stillpoint_plan::objectives::ObjectiveTable;

const NINE_DEG: [f64; 9] = [0.0, 40.0, 80.0, 120.0, 160.0, 200.0, 240.0, 280.0, 320.0];
const TG119: &str = include_str!("../../../../examples/tg119-c-shape.json");

/// The planning data, or `None` with a message where it is not there.
fn planning() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let root = std::env::var_os("STILLPOINT_DATA").map_or(beside, PathBuf::from).join("planning");
    if root.is_dir() {
        return Some(root);
    }
    eprintln!("skipped: no planning data; STILLPOINT_DATA names the folder that holds `planning`");
    None
}

/// Figures of a plan of nine beams.
fn nine_beams(case: &Case, table: &ObjectiveTable) -> Vec<StructureDose> {
    let params = DoseParams::over(case.grid(), 5.0);
    let engine = DoseEngine::of_case(case, Machine::shipped().unwrap(), params).unwrap();
    let ring = Ring::new(90, 5).unwrap();
    let beams = NINE_DEG.map(|angle| ring.nearest(angle));
    let folder = tempfile::tempdir().unwrap();
    let cache = DoseCache::in_folder(folder.path()).unwrap();
    let two = NonZeroUsize::new(2).unwrap();
    let doses = RingDoses::load(&cache, std::slice::from_ref(&engine), ring, &beams, two, || ()).unwrap();
    let goals = table.for_case(case, &params.grid).unwrap().goals(1).unwrap();
    let mut evaluator = Evaluator::new(&doses, &goals, ring, 9, Budget { solves: 1 });
    let best = choose(&Method::Class(NINE_DEG.to_vec()), &mut evaluator, 0).unwrap().best;
    assert!(best.plan.certificate.relative_excess() < 1e-3, "{:?}", best.plan.certificate);
    OnGrid::new(case, &params.grid).figures(&doses.dose(&best, 0), &[])
}

fn of<'a>(figures: &'a [StructureDose], name: &str) -> &'a StructureDose {
    figures.iter().find(|f| f.name == name).unwrap_or_else(|| panic!("no {name}"))
}

/// Ezzell et al., Med. Phys. 36 (2009) 5359, C-shape, the easier goals: of the PTV 95 % get 50 Gy at least and 10 % at
/// most 55 Gy; of the core 10 % get at most 25 Gy.
#[test]
fn the_c_shape_of_tg_119_meets_its_published_goals() {
    let Some(root) = planning() else { return };
    let case = import_described(&root.join("tg119/tg119.json"), &NameTable::shipped().unwrap()).unwrap().case;
    let table = ObjectiveTable::parse(TG119).unwrap().before(ObjectiveTable::shipped().unwrap());
    let figures = nine_beams(&case, &table);
    let (ptv, core) = (of(&figures, "PTV"), of(&figures, "Core"));
    println!("PTV D95 {:.2} Gy, D10 {:.2} Gy; core D10 {:.2} Gy", ptv.d95_gy, ptv.d10_gy, core.d10_gy);
    assert!(ptv.d95_gy >= 50.0 && ptv.d10_gy <= 55.0 && core.d10_gy <= 25.0, "{ptv:?} {core:?}");
}
