//! Plans of scans and patients, beside what is published of them.

use std::num::NonZeroUsize;

use stillpoint_plan::beams::{Budget, Evaluator, Method, Ring, RingDoses, choose};
use stillpoint_plan::case::{Case, NameTable, import_described, phantom};
use stillpoint_plan::dose::{BixelSpec, DoseCache, DoseEngine, DoseParams, Machine};
use stillpoint_plan::evaluation::{OnGrid, StructureDose, brought_to};
use stillpoint_plan::objectives::ObjectiveTable;
use stillpoint_testing::reference;

const NINE_DEG: [f64; 9] = [0.0, 40.0, 80.0, 120.0, 160.0, 200.0, 240.0, 280.0, 320.0];
const TG119: &str = include_str!("../../../../examples/tg119-c-shape.json");
const TG119_HARDER: &str = include_str!("../../../../examples/tg119-c-shape-harder.json");

/// Figures of a plan of nine beams, and of the dose that came with the case.
fn nine_beams(
    case: &Case,
    table: &ObjectiveTable,
    [bixel_mm, grid_mm]: [f64; 2],
) -> (Vec<StructureDose>, Option<Vec<StructureDose>>) {
    let bixels = BixelSpec::of_width(bixel_mm);
    let params = DoseParams { bixels, ..DoseParams::over(case.grid(), grid_mm) };
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
    let on_grid = OnGrid::new(case, &params.grid);
    let reference = case.reference_dose_gy().map(|gray| brought_to(&params.grid, case.grid(), gray));
    let figures = |gray: &[f32]| on_grid.figures(gray, &[10.0]);
    (figures(&doses.dose(&best, 0)), reference.as_deref().map(figures))
}

fn of<'a>(figures: &'a [StructureDose], name: &str) -> &'a StructureDose {
    figures.iter().find(|f| f.name == name).unwrap_or_else(|| panic!("no {name}"))
}

/// PTV and core of TG-119's C-shape, planned with nine beams; `None` where there is no data.
fn c_shape(objectives: &str, widths_mm: [f64; 2]) -> Option<(StructureDose, StructureDose)> {
    let described = reference::folder("planning")?.join("tg119/tg119.json");
    let case = import_described(&described, &NameTable::shipped().unwrap()).unwrap().case;
    let table = ObjectiveTable::parse(objectives).unwrap().before(ObjectiveTable::shipped().unwrap());
    let (figures, _) = nine_beams(&case, &table, widths_mm);
    Some((of(&figures, "PTV").clone(), of(&figures, "Core").clone()))
}

/// Ezzell et al., Med. Phys. 36 (2009) 5359, C-shape, the easier goals: of the PTV 95 % get 50 Gy at least and 10 % at
/// most 55 Gy; of the core 10 % get at most 25 Gy.
#[test]
fn the_c_shape_of_tg_119_meets_its_published_goals() {
    let Some((ptv, core)) = c_shape(TG119, [10.0, 5.0]) else { return };
    println!("PTV D95 {:.2} Gy, D10 {:.2} Gy; core D10 {:.2} Gy", ptv.d95_gy, ptv.d10_gy, core.d10_gy);
    assert!(ptv.d95_gy >= 50.0 && ptv.d10_gy <= 55.0 && core.d10_gy <= 25.0, "{ptv:?} {core:?}");
}

/// The same, the harder goal: at most 5 % of the core get 10 Gy. It takes bixels of the width of a collimator's leaves.
#[test]
fn the_c_shape_of_tg_119_meets_its_harder_goals_too() {
    let Some((ptv, core)) = c_shape(TG119_HARDER, [5.0, 3.0]) else { return };
    let gets_ten = core.volumes[0].fraction;
    println!("PTV D95 {:.2} Gy, D10 {:.2} Gy; core V10 {gets_ten:.3}", ptv.d95_gy, ptv.d10_gy);
    assert!(ptv.d95_gy >= 50.0 && ptv.d10_gy <= 55.0 && gets_ten <= 0.05, "{ptv:?} {core:?}");
}

/// What planners call acceptable: the target covered, and nothing in the patient above 107 % of the prescription.
#[test]
fn the_shipped_objectives_leave_no_hot_spot_in_or_beside_the_target() {
    let table = ObjectiveTable::shipped().unwrap();
    let (figures, _) = nine_beams(&phantom(0).unwrap(), &table, [10.0, 5.0]);
    let (body, ptv) = (of(&figures, "Body"), of(&figures, "PTV"));
    println!("largest {:.1} Gy; PTV D2 {:.1} Gy, D95 {:.1} Gy", body.max_gy, ptv.d2_gy, ptv.d95_gy);
    assert!(body.max_gy <= 1.07 * 78.0 && ptv.covered.unwrap() > 0.98, "{body:?} {ptv:?}");
}

/// Wide bixels: without optimisation by the compiler narrow ones take minutes.
#[test]
fn real_patients_get_their_dose_and_keep_their_spinal_cord() {
    let Some(root) = reference::folder("planning") else { return };
    let table = ObjectiveTable::shipped().unwrap();
    for patient in 1..=4 {
        let file = root.join(format!("openkbp/openkbp_{patient}.json"));
        let case = import_described(&file, &NameTable::shipped().unwrap()).unwrap().case;
        let (ours, reference) = nine_beams(&case, &table, [15.0, 5.0]);
        let reference = reference.unwrap();
        for target in case.targets() {
            let (ours, theirs) = (of(&ours, &target.name), of(&reference, &target.name));
            let [a, b] = [ours, theirs].map(|t| 100.0 * t.covered.unwrap());
            println!(
                "{patient} {}: D95 {:.1} Gy, {a:.1} % covered; reference {:.1} Gy, {b:.1} %",
                target.name, ours.d95_gy, theirs.d95_gy
            );
            assert!(ours.covered.unwrap() > 0.85, "patient {patient}: {ours:?}");
        }
        let largest = ours.iter().map(|f| f.max_gy).fold(0.0, f64::max);
        println!("{patient}: largest dose {largest:.1} Gy");
        assert!(largest < 1.15 * 70.0, "patient {patient}: {largest}");
        let (ours, theirs) = (of(&ours, "SpinalCord"), of(&reference, "SpinalCord"));
        println!(
            "{patient} SpinalCord: D2 {:.1} Gy, largest {:.1} Gy; reference {:.1} Gy, {:.1} Gy",
            ours.d2_gy, ours.max_gy, theirs.d2_gy, theirs.max_gy
        );
        assert!(ours.max_gy < 45.0, "patient {patient}: {ours:?}");
    }
}
