//! What every reader asks of images and structures: outlines, the scale of Hounsfield units, structures that leave the patient.

use proptest::prelude::*;
use stillpoint_patient::Grid;
use stillpoint_patient::case::intake::{Scale, settle};
use stillpoint_patient::case::{Mask, Role, Structure};

/// A cylinder of water with a rod of bone and a lung, in air; 40 x 30 x 4 voxels.
const GRID: Grid = Grid { counts: [40, 30, 4], spacing_mm: [5.0, 5.0, 5.0], origin_mm: [-97.5, -72.5, 0.0] };

fn within([cx, cy]: [f64; 2], radius: f64) -> Mask {
    Mask::from_fn(GRID.len(), |i| {
        let [x, y, _] = GRID.centre_mm(GRID.voxel(i));
        (x - cx).hypot(y - cy) <= radius
    })
}

fn hu() -> Vec<i16> {
    let (body, bone, lung) =
        (within([0.0, 0.0], 60.0), within([20.0, 20.0], 12.0), within([-20.0, 0.0], 15.0));
    (0..GRID.len())
        .map(|i| match (bone.contains(i), lung.contains(i), body.contains(i)) {
            (true, ..) => 900,
            (_, true, _) => -750,
            (.., true) => 30,
            _ => -1000,
        })
        .collect()
}

fn structure(name: &str, role: Role, mask: Mask) -> Structure {
    Structure { name: name.to_owned(), role, mask }
}

fn settled(hu: &[i16], mut structures: Vec<Structure>) -> Result<(Vec<Structure>, String), String> {
    let mut notes = Vec::new();
    let settled = settle(&GRID, hu, &mut structures, Scale::OfPatients, &mut notes);
    settled.map(|()| (structures, notes.join("\n"))).map_err(|error| error.to_string())
}

fn body() -> Structure {
    structure("Body", Role::External, within([0.0, 0.0], 60.0))
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_scale_that_is_off_is_refused_with_or_without_an_outline(
        off in prop_oneof![400..3000_i16, -3000..-400_i16], is_drawn in any::<bool>(),
    ) {
        let shifted: Vec<i16> = hu().iter().map(|h| h + off).collect();
        let structures = if is_drawn { vec![body()] } else { Vec::new() };
        let stated = settled(&shifted, structures).unwrap_err();
        prop_assert!(stated.contains("implausible Hounsfield units") || stated.contains("hold no body"), "{}", stated);
    }

    #[test]
    fn scanners_that_are_a_little_off_and_pad_with_anything_low_are_taken(
        off in -80..80_i16, padding in -3024..-1000_i16,
    ) {
        let padded = |h: i16| if h == -1000 { padding } else { h + off };
        let shifted: Vec<i16> = hu().iter().map(|&h| padded(h)).collect();
        prop_assert!(settled(&shifted, vec![body()]).is_ok());
    }

    #[test]
    fn what_leaves_the_outline_is_told_with_its_volume(x in 0.0..90.0_f64) {
        let target = structure("PTV", Role::Target, within([x, 0.0], 20.0));
        let outline = body();
        let outside = target.mask.indices().filter(|&i| !outline.mask.contains(i)).count();
        let (_, notes) = settled(&hu(), vec![outline, target]).unwrap();
        let volume = format!("{:.2} of its", outside as f64 * GRID.voxel_cm3());
        prop_assert_eq!(notes.contains("\"PTV\" leaves the outline"), outside > 0);
        prop_assert!(outside == 0 || notes.contains(&volume), "{} in {}", volume, notes);
    }

    #[test]
    fn a_shell_becomes_the_patient_whatever_its_thickness(inner in 30.0..55.0_f64) {
        let (outer, core) = (body(), within([0.0, 0.0], inner));
        let shell = Mask::from_fn(GRID.len(), |i| outer.mask.contains(i) && !core.contains(i));
        let (structures, notes) = settled(&hu(), vec![structure("Skin", Role::External, shell)]).unwrap();
        let hollow = core.count() as f64;
        let is_shell = hollow > 0.2 * (outer.mask.count() as f64 - hollow);
        prop_assert_eq!(structures[0].mask == outer.mask, is_shell, "{}", notes);
        prop_assert!(notes.contains("shell") || notes.contains("holes"));
    }
}

#[test]
fn an_outline_is_made_from_the_images_without_the_couch() {
    let mut with_couch = hu();
    for (i, hu) in with_couch.iter_mut().enumerate() {
        // A couch top of one voxel that touches nothing.
        if GRID.voxel(i)[1] == 28 {
            *hu = 200;
        }
    }
    let (structures, notes) = settled(&with_couch, Vec::new()).unwrap();
    assert_eq!(structures[0].name, "Body");
    let due = body().mask;
    let off = (0..GRID.len()).filter(|&i| structures[0].mask.contains(i) != due.contains(i)).count();
    assert!(off < due.count() / 50, "{off} of {}", due.count());
    assert!(notes.contains("is made from the images"), "{notes}");
    let stated = settled(&vec![-1000; GRID.len()], Vec::new()).unwrap_err();
    assert!(stated.contains("implausible") || stated.contains("hold no body"), "{stated}");
}

#[test]
fn of_two_outlines_the_larger_is_taken_and_the_other_told() {
    let small = structure("Clean", Role::External, within([0.0, 0.0], 55.0));
    let (structures, notes) = settled(&hu(), vec![small, body()]).unwrap();
    let roles: Vec<_> = structures.iter().map(|s| s.role).collect();
    assert_eq!(roles, [Role::Other, Role::External]);
    assert!(
        notes.contains(r#""Body""#) && notes.contains(r#""Clean""#) && notes.contains("--names"),
        "{notes}"
    );
}

#[test]
fn metal_beyond_the_density_table_is_told_with_its_volume() {
    let mut metal = hu();
    let inside = within([0.0, 30.0], 6.0);
    inside.indices().for_each(|i| metal[i] = 8000);
    let (_, notes) = settled(&metal, vec![body()]).unwrap();
    let volume = format!(
        "{:.2} cm3 of the patient have more than 3000 HU, up to 8000",
        inside.count() as f64 * GRID.voxel_cm3()
    );
    assert!(notes.contains(&volume), "{notes}");
}
