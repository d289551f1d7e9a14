//! The project's own male pelvis: a case for everyone, made from a seed.
//!
//! It has the six structures of the dissertation (5.2: body, bladder, rectum, both femoral heads, PTV) and the CTV within
//! the PTV. It is no patient and no mean of patients: sizes are drawn from ranges of ordinary adult anatomy so that plans
//! have the conflicts of the real ones (rectum and bladder beside the target, hips in the lateral beams).
//!
//! - `head`: a head under a given skin
//! - `neck`: a head and neck with tumours of the throat
//! - `lung`: a chest with a tumour in one lung; `shapes`: of which these three are made
//! - `anatomy`: sizes drawn from the seed, and which tissue is where
//! - `texture`: noise of tissue and scanner
//! - `variety`: pelves that differ in what decides the beams

mod anatomy;
mod head;
mod lung;
mod neck;
mod shapes;
mod texture;
mod variety;

use anatomy::{Anatomy, BodyPart};
pub use head::{HEAD_SPACING_MM, HEAD_SPACINGS_MM, Skin, head};
pub use lung::lung;
pub use neck::neck;
use texture::Texture;
use variety::{Site, Variety};

use super::mask::Mask;
use super::patient::{Case, CaseError, CaseParts, Prescription};
use super::structure::{Role, Structure};
use crate::Grid;

const SPACING_MM: f64 = 3.0;
const SLICES: usize = 64;
/// Air around the body.
const AROUND_MM: f64 = 15.0;
/// From CTV to PTV, and less towards the rectum.
const MARGIN_MM: f64 = 8.0;
const MARGIN_TO_RECTUM_MM: f64 = 5.0;

/// The pelvis of this seed; every seed is another man, and the same one on every machine.
pub fn phantom(seed: u64) -> Result<Case, CaseError> {
    let provenance = format!("stillpoint's own model of a male pelvis, seed {seed}; no patient");
    case(seed, &Anatomy::of_seed(seed), Course::of(78.0, 39), format!("pelvis-{seed}"), provenance)
}

/// The varied pelvis of this seed: besides the sizes, the seed draws the site, the side and the shape of the target, a
/// loop of bowel, and hip implants. So the best beams differ from pelvis to pelvis.
pub fn varied_phantom(seed: u64) -> Result<Case, CaseError> {
    let variety = Variety::of_seed(seed);
    let course = match variety.site {
        Site::Prostate | Site::Vesicles => Course::of(78.0, 39),
        _ => Course::of(66.0, 33),
    };
    let anatomy = Anatomy::varied(seed, &variety);
    let provenance = format!(
        "stillpoint's own model of a male pelvis, varied, seed {seed} (target: {}); no patient",
        variety.site.word()
    );
    case(seed, &anatomy, course, format!("pelvis-varied-{seed}"), provenance)
}

/// Dose to the target and number of fractions.
struct Course {
    dose_gy: f64,
    fractions: u32,
}

impl Course {
    fn of(dose_gy: f64, fractions: u32) -> Self {
        Self { dose_gy, fractions }
    }
}

fn case(
    seed: u64,
    anatomy: &Anatomy,
    course: Course,
    name: String,
    provenance: String,
) -> Result<Case, CaseError> {
    let grid = grid(anatomy);
    let len = grid.len();
    let parts: Vec<BodyPart> = (0..len).map(|i| anatomy.part(grid.centre_mm(grid.voxel(i)))).collect();
    let of = |part: BodyPart| Mask::from_fn(len, |i| parts[i] == part);
    let ctv = Mask::from_fn(len, |i| anatomy.is_target(parts[i]));
    let body = Mask::from_fn(len, |i| parts[i] != BodyPart::Air);
    let around = widened(&grid, &ctv);
    let ptv = Mask::from_fn(len, |i| around.contains(i) && body.contains(i));
    let rectum =
        Mask::from_fn(len, |i| matches!(parts[i], BodyPart::RectumWall | BodyPart::Stool | BodyPart::Gas));
    let head = |side: f64| Mask::from_fn(len, |i| anatomy.femoral_head(side, grid.centre_mm(grid.voxel(i))));
    let metal = |side: f64| {
        Mask::from_fn(len, |i| {
            parts[i] == BodyPart::Metal && anatomy.implant(side, grid.centre_mm(grid.voxel(i)))
        })
    };
    let mut texture = Texture::of_seed(seed, &grid);
    let hu = parts.iter().enumerate().map(|(i, part)| texture.hu(*part, grid.voxel(i))).collect();
    let structure = |name: &str, role, mask| Structure { name: name.to_owned(), role, mask };
    let hip = |side: f64, head_name: &str, implant_name: &str| match anatomy.implants().contains(&side) {
        false => structure(head_name, Role::Organ, head(side)),
        true => structure(implant_name, Role::Organ, metal(side)),
    };
    let mut structures = vec![
        structure("Body", Role::External, body),
        structure("PTV", Role::Target, ptv),
        structure("Rectum", Role::Organ, rectum),
        structure("Bladder", Role::Organ, of(BodyPart::Bladder)),
        hip(1.0, "FemoralHeadL", "HipImplantL"),
        hip(-1.0, "FemoralHeadR", "HipImplantR"),
        structure("CTV", Role::ClinicalTarget, ctv),
    ];
    let bowel = of(BodyPart::Bowel);
    if !bowel.is_empty() {
        structures.push(structure("Bowel", Role::Organ, bowel));
    }
    Case::new(CaseParts {
        name,
        grid,
        hu,
        structures,
        isocentre_mm: None,
        prescription: vec![Prescription { structure: "PTV".to_owned(), dose_gy: course.dose_gy }],
        fractions: Some(course.fractions),
        reference_dose_gy: None,
        uids: None,
        provenance,
    })
}

/// A grid with the body in its middle.
fn grid(anatomy: &Anatomy) -> Grid {
    let [width, depth] = anatomy.half_widths_mm();
    let count = |half: f64| 2 * libm::ceil((half + AROUND_MM) / SPACING_MM) as usize;
    let counts = [count(width), count(depth), SLICES];
    Grid {
        counts,
        spacing_mm: [SPACING_MM; 3],
        origin_mm: counts.map(|n| -0.5 * SPACING_MM * (n as f64 - 1.0)),
    }
}

/// The voxels within the margin of a mask's.
fn widened(grid: &Grid, mask: &Mask) -> Mask {
    let reach = libm::floor(MARGIN_MM / SPACING_MM) as isize;
    let mut offsets = Vec::new();
    for dz in -reach..=reach {
        for dy in -reach..=reach {
            for dx in -reach..=reach {
                let back = if dy > 0 { MARGIN_TO_RECTUM_MM } else { MARGIN_MM };
                let part = |steps: isize, margin: f64| steps as f64 * SPACING_MM / margin;
                let [x, y, z] = [part(dx, MARGIN_MM), part(dy, back), part(dz, MARGIN_MM)];
                if x * x + y * y + z * z <= 1.0 {
                    offsets.push([dx, dy, dz]);
                }
            }
        }
    }
    let mut inside = vec![false; grid.len()];
    for index in mask.indices() {
        let voxel = grid.voxel(index);
        for offset in &offsets {
            let at = [0, 1, 2].map(|axis| voxel[axis].wrapping_add_signed(offset[axis]));
            if (0..3).all(|axis| at[axis] < grid.counts[axis]) {
                inside[grid.index(at)] = true;
            }
        }
    }
    Mask::from_fn(grid.len(), |i| inside[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_seed_is_a_man_with_ordinary_volumes_and_the_conflicts_of_a_plan() {
        for seed in 0..12 {
            let case = phantom(seed).unwrap();
            let structure = |name| case.structure(name).unwrap();
            for (name, low, high) in [
                ("Body", 9_000.0, 22_000.0),
                ("PTV", 70.0, 200.0),
                ("CTV", 25.0, 90.0),
                ("Rectum", 30.0, 140.0),
                ("Bladder", 60.0, 350.0),
                ("FemoralHeadL", 35.0, 85.0),
                ("FemoralHeadR", 35.0, 85.0),
            ] {
                let volume = case.volume_cm3(structure(name));
                assert!((low..high).contains(&volume), "seed {seed}: {name} has {volume} cm3");
            }
            let shared =
                |a, b| structure(a).mask.indices().filter(|&i| structure(b).mask.contains(i)).count();
            assert_eq!(shared("CTV", "PTV"), structure("CTV").mask.count(), "seed {seed}");
            assert!(shared("PTV", "Rectum") > 0 && shared("PTV", "Bladder") > 0, "seed {seed}");
            assert_eq!(
                shared("CTV", "Rectum") + shared("CTV", "Bladder") + shared("Rectum", "Bladder"),
                0,
                "seed {seed}"
            );
            for name in ["PTV", "Rectum", "Bladder", "FemoralHeadL", "FemoralHeadR"] {
                assert_eq!(shared(name, "Body"), structure(name).mask.count(), "seed {seed}: {name}");
            }
            let mean = |name| {
                let mask = &structure(name).mask;
                mask.indices().map(|i| f64::from(case.hu()[i])).sum::<f64>() / mask.count() as f64
            };
            assert!((0.0..20.0).contains(&mean("Bladder")) && mean("FemoralHeadL") > 200.0, "seed {seed}");
            let left = structure("FemoralHeadL")
                .mask
                .indices()
                .all(|i| case.grid().centre_mm(case.grid().voxel(i))[0] > 0.0);
            assert!(left, "seed {seed}: left is +x");
        }
    }

    #[test]
    fn a_seed_is_one_man_everywhere() {
        let hash = |seed| crate::case::content_hash(&phantom(seed).unwrap()).unwrap().to_string();
        assert_eq!(hash(0), hash(0));
        assert_ne!(hash(0), hash(1));
        assert_eq!(
            hash(0),
            "bb2cd07ccd8cd65aa3a67c6dc9a98b79a67dcf5406dea889b15c1b936571c85a",
            "the phantom of seed 0 has changed: plans and caches made for it are void"
        );
    }

    #[test]
    fn varied_pelves_differ_in_site_side_implants_and_organs_and_are_valid() {
        let mut seen = std::collections::BTreeMap::new();
        for seed in 0..64 {
            let variety = Variety::of_seed(seed);
            let implants = variety.implants.iter().map(|side| format!("implant at side {side}"));
            let bowel = variety.bowel.iter().map(|_| "bowel".to_owned());
            let place = [variety.site.word().to_owned(), format!("side {}", variety.side)];
            for what in place.into_iter().chain(implants).chain(bowel) {
                *seen.entry(what).or_insert(0) += 1;
            }
        }
        // Five sites, two sides, implants at both, bowel.
        assert!(seen.len() == 10 && seen.values().all(|times| (2..60).contains(times)), "{seen:?}");
        for seed in 0..10 {
            let case = varied_phantom(seed).unwrap();
            assert!(case.is_pelvis());
            let variety = Variety::of_seed(seed);
            let site = case.provenance().split("target: ").nth(1).unwrap();
            assert!(site.starts_with(variety.site.word()), "seed {seed}: {site}");
            if variety.site == Site::Nodes {
                assert!(case.isocentre_mm()[0] * variety.side > 20.0, "seed {seed}");
            }
            assert_eq!(case.structure("Bowel").is_some(), variety.bowel.is_some(), "seed {seed}");
            let target = case.structure("PTV").unwrap();
            let body = case.structure("Body").unwrap();
            assert!(target.mask.indices().all(|i| body.mask.contains(i)), "seed {seed}");
            let volume = case.volume_cm3(target);
            assert!((30.0..450.0).contains(&volume), "seed {seed}: {volume} cm3");
            assert!(case.structures().iter().all(|s| !s.mask.is_empty()), "seed {seed}");
            let dense = case.structures().iter().filter(|s| s.name.starts_with("HipImplant"));
            assert_eq!(dense.clone().count(), variety.implants.len(), "seed {seed}");
            for implant in dense {
                assert!(implant.mask.indices().all(|i| case.hu()[i] > 2500), "seed {seed}");
            }
        }
        let hash = |seed| crate::case::content_hash(&varied_phantom(seed).unwrap()).unwrap();
        assert_eq!(hash(3), hash(3));
    }
}
