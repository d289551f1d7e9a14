//! A chest as a case: lungs, heart, oesophagus, cord and ribs, and a tumour in one lung.
//!
//! Millimetres in the DICOM patient frame; the origin lies in the middle of the chest below the carina. It is no patient and
//! no mean of patients: sizes, and the side, place and size of the tumour are drawn from the seed. Here dose depends on how a
//! method treats lung: beams cross up to 20 cm of it, and the tumour is an island in it.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

use super::shapes::{ellipsoid, rod};
use super::texture::Texture;
use crate::Grid;
use crate::case::mask::Mask;
use crate::case::patient::{Case, CaseError, CaseParts, Prescription};
use crate::case::structure::{Role, Structure};

const SPACING_MM: f64 = 3.0;
/// Air around the body.
const AROUND_MM: f64 = 12.0;
/// Lower and upper end of the images.
const ENDS_MM: [f64; 2] = [-114.0, 102.0];
/// From the tumour to the PTV.
const MARGIN_MM: f64 = 6.0;
/// Lung around the tumour at least.
const LUNG_AROUND_MM: f64 = 3.0;
/// Places that are tried for a tumour.
const PLACES: usize = 400;
const DOSE_GY: f64 = 60.0;
const FRACTIONS: u32 = 30;
const CORD_RADIUS_MM: f64 = 5.5;
const VERTEBRA_RADIUS_MM: f64 = 16.0;
/// From the cord to the middle of the vertebra before it.
const CORD_TO_VERTEBRA_MM: f64 = 24.0;
/// Distance of ribs along the body, and their height.
const RIBS_MM: [f64; 2] = [27.0, 10.0];
/// A stream of its own.
const STREAM: u64 = 4;

/// An egg: middle and radii.
type Egg = ([f64; 3], [f64; 3]);

/// One person.
struct Person {
    /// Half of the body's width and depth.
    body_mm: [f64; 2],
    fat_mm: f64,
    /// What is within the ribs.
    cavity: Egg,
    /// Half of the width of what is between the lungs.
    mediastinum_mm: f64,
    /// Top of the diaphragm on the left and on the right.
    diaphragm_mm: [f64; 2],
    heart: Egg,
    /// Middle of the oesophagus, and its radius.
    oesophagus_mm: [f64; 3],
    cord_y_mm: f64,
    /// Hounsfield units of lung.
    lung_hu: f64,
    tumour: Egg,
}

/// What is at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Tissue {
    Air,
    Fat,
    Muscle,
    Bone,
    Nerve,
    Lung,
    Airway,
    Tumour,
}

/// The chest of this seed.
///
/// # Errors
/// None for any seed that was tried; a case without a target would be one.
pub fn lung(seed: u64) -> Result<Case, CaseError> {
    let person = Person::of_seed(seed);
    let grid = person.grid();
    let len = grid.len();
    let places: Vec<[f64; 3]> = (0..len).map(|i| grid.centre_mm(grid.voxel(i))).collect();
    let tissues: Vec<Tissue> = places.iter().map(|at| person.tissue(*at)).collect();
    let mut texture = Texture::of_seed(seed, &grid);
    let hu = (0..len).map(|i| {
        let (mean, spread) = match tissues[i] {
            Tissue::Air => (-1000.0, 0.0),
            Tissue::Fat => (-95.0, 12.0),
            Tissue::Muscle => (48.0, 14.0),
            Tissue::Bone => (520.0, 110.0),
            Tissue::Nerve => (34.0, 5.0),
            Tissue::Lung => (person.lung_hu, 40.0),
            Tissue::Airway => (-960.0, 20.0),
            Tissue::Tumour => (40.0, 10.0),
        };
        texture.value(mean, spread, grid.voxel(i))
    });
    let hu = hu.collect();
    let of = |inside: &dyn Fn(usize) -> bool| Mask::from_fn(len, |i| tissues[i] != Tissue::Air && inside(i));
    let is_lung = |i: usize, side: f64| tissues[i] == Tissue::Lung && side * places[i][0] > 0.0;
    let structure = |name: &str, role, mask| Structure { name: name.to_owned(), role, mask };
    let organ = |name: &str, inside: &dyn Fn(usize) -> bool| structure(name, Role::Organ, of(inside));
    let structures = vec![
        structure("Body", Role::External, of(&|_| true)),
        structure("PTV", Role::Target, of(&|i| person.tumour_mm(places[i]) <= MARGIN_MM)),
        structure("GTV", Role::ClinicalTarget, of(&|i| tissues[i] == Tissue::Tumour)),
        // Before its parts: limits are on both lungs, and a point counts for the first organ that has it.
        organ("Lungs", &|i| tissues[i] == Tissue::Lung),
        organ("Lung_L", &|i| is_lung(i, 1.0)),
        organ("Lung_R", &|i| is_lung(i, -1.0)),
        organ("Heart", &|i| person.heart_mm(places[i]) <= 0.0),
        organ("Esophagus", &|i| person.oesophagus_mm(places[i]) <= 0.0),
        organ("SpinalCord", &|i| person.cord_mm(places[i]) <= 0.0),
    ];
    let [x, _, z] = person.tumour.0;
    let side = if x > 0.0 { "left" } else { "right" };
    let lobe = if z > 0.0 { "upper" } else { "lower" };
    Case::new(CaseParts {
        name: format!("lung-{seed}"),
        grid,
        hu,
        prescription: vec![Prescription { structure: "PTV".to_owned(), dose_gy: DOSE_GY }],
        structures,
        isocentre_mm: None,
        fractions: Some(FRACTIONS),
        reference_dose_gy: None,
        uids: None,
        provenance: format!(
            "stillpoint's own model of a chest, seed {seed} (tumour: {side} lung, {lobe} half); no patient"
        ),
    })
}

impl Person {
    fn of_seed(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(STREAM);
        let mut between = |low: f64, high: f64| {
            let unit = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
            low + (high - low) * unit
        };
        let body_mm = [between(152.0, 184.0), between(102.0, 124.0)];
        let fat_mm = between(6.0, 18.0);
        // Fat, muscle and ribs.
        let wall_mm = fat_mm + between(17.0, 22.0);
        let cavity = (
            [0.0, -1.0, between(-46.0, -34.0)],
            [body_mm[0] - wall_mm, body_mm[1] - 0.85 * wall_mm, between(146.0, 160.0)],
        );
        let mediastinum_mm = between(27.0, 36.0);
        let diaphragm_mm = [between(-74.0, -56.0), between(-62.0, -44.0)];
        let cord_y_mm = body_mm[1] - between(46.0, 52.0);
        let radius_mm = between(7.5, 9.5);
        let front_mm = cord_y_mm - CORD_TO_VERTEBRA_MM - VERTEBRA_RADIUS_MM;
        let oesophagus_mm = [between(-2.0, 8.0), front_mm - radius_mm - 1.0, radius_mm];
        let radii_mm = [between(46.0, 56.0), between(36.0, 43.0), between(44.0, 54.0)];
        // The heart lies before the oesophagus.
        let heart_y_mm = oesophagus_mm[1] - radius_mm - radii_mm[1] - 1.0;
        let heart = ([between(14.0, 26.0), heart_y_mm, between(-48.0, -34.0)], radii_mm);
        let lung_hu = between(-790.0, -690.0);
        let size_mm = between(7.0, 22.0);
        let tumour_mm = [0; 3].map(|_| size_mm * between(0.85, 1.15));
        let side = if between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
        let mut person = Self {
            body_mm,
            fat_mm,
            cavity,
            mediastinum_mm,
            diaphragm_mm,
            heart,
            oesophagus_mm,
            cord_y_mm,
            lung_hu,
            tumour: ([0.0; 3], tumour_mm),
        };
        // The first place that has lung all around, or the best one.
        let radius_mm = tumour_mm.into_iter().fold(0.0, f64::max) + LUNG_AROUND_MM;
        let mut best = (f64::INFINITY, [0.0; 3]);
        for _ in 0..PLACES {
            let at = [side * between(30.0, 130.0), between(-80.0, 80.0), between(ENDS_MM[0] + 50.0, 80.0)];
            let outside_mm = person.outside_lung_mm(at);
            if outside_mm < best.0 {
                best = (outside_mm, at);
            }
            if outside_mm <= -radius_mm {
                break;
            }
        }
        person.tumour.0 = best.1;
        person
    }

    /// A grid with the person in its middle.
    fn grid(&self) -> Grid {
        let low = [-self.body_mm[0] - AROUND_MM, -self.body_mm[1] - AROUND_MM, ENDS_MM[0]];
        let high = [-low[0], -low[1], ENDS_MM[1]];
        let count = |axis: usize| libm::ceil((high[axis] - low[axis]) / SPACING_MM) as usize + 1;
        Grid { counts: [count(0), count(1), count(2)], spacing_mm: [SPACING_MM; 3], origin_mm: low }
    }

    fn tissue(&self, at: [f64; 3]) -> Tissue {
        let depth = self.depth_mm(at);
        if depth <= 0.0 {
            Tissue::Air
        } else if self.tumour_mm(at) <= 0.0 {
            Tissue::Tumour
        } else if self.cord_mm(at) <= 0.0 {
            Tissue::Nerve
        } else if self.is_bone(at) && depth > 3.0 {
            Tissue::Bone
        } else if self.airway_mm(at) <= 0.0 {
            Tissue::Airway
        } else if self.outside_lung_mm(at) <= 0.0 {
            Tissue::Lung
        } else if depth < self.fat_mm {
            Tissue::Fat
        } else {
            Tissue::Muscle
        }
    }

    /// Depth below the skin, about; negative outside.
    fn depth_mm(&self, [x, y, z]: [f64; 3]) -> f64 {
        // The chest is narrower at the armpits.
        let narrowing = 1.0 - 0.0008 * (z - 20.0).max(0.0);
        -oval_mm([x, y], self.body_mm.map(|half| half * narrowing))
    }

    fn cavity_mm(&self, at: [f64; 3]) -> f64 {
        ellipsoid(at, self.cavity.0, self.cavity.1)
    }

    /// Distance from the lungs, about; negative inside of one.
    fn outside_lung_mm(&self, at: [f64; 3]) -> f64 {
        let [x, y, z] = at;
        let between_lungs = oval_mm([x, y], [self.mediastinum_mm, self.body_mm[1]]);
        let spine = self.vertebra_mm(at) - 2.0;
        let heart = self.heart_mm(at) - 2.0;
        let oesophagus = self.oesophagus_mm(at) - 2.0;
        let airway = self.airway_mm(at) - 1.0;
        let diaphragm = self.below_diaphragm_mm(at);
        let walls = [between_lungs, spine, heart, oesophagus, airway, diaphragm];
        walls.into_iter().map(|wall| -wall).fold(self.cavity_mm(at), f64::max).max(ENDS_MM[0] - z)
    }

    /// Distance from what is below the domes of the diaphragm; negative there.
    fn below_diaphragm_mm(&self, [x, y, z]: [f64; 3]) -> f64 {
        let (_, [width, depth, _]) = self.cavity;
        let [left, right] = self.diaphragm_mm;
        let (side, top) = if x > 0.0 { (1.0, left) } else { (-1.0, right) };
        let height = 56.0;
        // Below the middle of the dome it goes straight down.
        let z = z.max(top - height);
        ellipsoid([x, y, z], [side * 0.5 * width, 6.0, top - height], [0.56 * width, 0.98 * depth, height])
    }

    fn vertebra_mm(&self, at: [f64; 3]) -> f64 {
        self.along_body_mm(at, [0.0, self.cord_y_mm - CORD_TO_VERTEBRA_MM]) - VERTEBRA_RADIUS_MM
    }

    fn cord_mm(&self, at: [f64; 3]) -> f64 {
        self.along_body_mm(at, [0.0, self.cord_y_mm]) - CORD_RADIUS_MM
    }

    fn oesophagus_mm(&self, at: [f64; 3]) -> f64 {
        let [x, y, radius] = self.oesophagus_mm;
        self.along_body_mm(at, [x, y]) - radius
    }

    fn heart_mm(&self, at: [f64; 3]) -> f64 {
        ellipsoid(at, self.heart.0, self.heart.1)
    }

    fn tumour_mm(&self, at: [f64; 3]) -> f64 {
        ellipsoid(at, self.tumour.0, self.tumour.1)
    }

    /// Distance from a line along the whole body.
    fn along_body_mm(&self, [x, y, _]: [f64; 3], [at_x, at_y]: [f64; 2]) -> f64 {
        libm::hypot(x - at_x, y - at_y)
    }

    /// The windpipe and the two branches that leave it.
    fn airway_mm(&self, at: [f64; 3]) -> f64 {
        let [x, y, radius] = self.oesophagus_mm;
        let y = y - radius - 11.0;
        let (top, fork) = ([x, y, ENDS_MM[1] + 20.0], [0.0, y, 24.0]);
        let branch = |side: f64| rod(at, fork, [side * (self.mediastinum_mm + 12.0), y, 4.0]) - 5.5;
        (rod(at, top, fork) - 8.5).min(branch(1.0)).min(branch(-1.0))
    }

    /// Vertebrae with their arches, ribs around the chest, and the breastbone.
    fn is_bone(&self, at: [f64; 3]) -> bool {
        let [x, y, z] = at;
        let cord = self.cord_mm(at);
        let arch = cord > 2.0 && cord < 7.0;
        let cavity = self.cavity_mm(at);
        let in_wall = (2.0..10.0).contains(&cavity);
        // Ribs fall from the spine to the front.
        let [every, height] = RIBS_MM;
        let along = z - 0.35 * y;
        let rib = in_wall && along - every * libm::floor(along / every) < height;
        let breastbone = in_wall && y < 0.0 && x.abs() < 18.0 && z > self.heart.0[2] - 20.0;
        self.vertebra_mm(at) <= 0.0 || arch || rib || breastbone
    }
}

/// Distance from an oval in a plane, to the first order; negative inside.
fn oval_mm([x, y]: [f64; 2], [a, b]: [f64; 2]) -> f64 {
    ellipsoid([x, y, 0.0], [0.0; 3], [a, b, 1e6])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn chests_have_ordinary_volumes_and_a_tumour_that_lung_surrounds() {
        let mut seen = BTreeMap::new();
        for seed in 0..12 {
            let case = lung(seed).unwrap();
            let grid = case.grid();
            let mask = |name: &str| &case.structure(name).unwrap().mask;
            for (name, low, high) in [
                ("Body", 8_000.0, 16_500.0),
                ("GTV", 1.0, 60.0),
                ("PTV", 6.0, 130.0),
                ("Lung_L", 600.0, 2_400.0),
                ("Lung_R", 600.0, 2_400.0),
                ("Heart", 250.0, 560.0),
                ("Esophagus", 30.0, 70.0),
                ("SpinalCord", 15.0, 26.0),
            ] {
                let volume = case.volume_cm3(case.structure(name).unwrap());
                assert!((low..high).contains(&volume), "seed {seed}: {name} has {volume} cm3");
            }
            let shared = |a: &str, b: &str| mask(a).indices().filter(|i| mask(b).contains(*i)).count();
            for name in ["GTV", "PTV", "Lungs", "Heart", "Esophagus", "SpinalCord"] {
                assert_eq!(shared(name, "Body"), mask(name).count(), "seed {seed}: {name}");
            }
            assert_eq!(shared("GTV", "PTV"), mask("GTV").count(), "seed {seed}");
            assert_eq!(mask("Lungs").count(), mask("Lung_L").count() + mask("Lung_R").count());
            let apart = ["GTV", "Lung_L", "Lung_R", "Heart", "Esophagus", "SpinalCord"];
            for (place, a) in apart.iter().enumerate() {
                for b in &apart[place + 1..] {
                    assert_eq!(shared(a, b), 0, "seed {seed}: {a} and {b}");
                }
            }
            // Every neighbour of a voxel of the tumour is tumour or lung of its side.
            let tumour = mask("GTV");
            let is_left = case.isocentre_mm()[0] > 0.0;
            let lung = mask(if is_left { "Lung_L" } else { "Lung_R" });
            for voxel in tumour.indices() {
                let place = grid.voxel(voxel);
                for axis in 0..3 {
                    for step in [-1, 1] {
                        let mut next = place;
                        next[axis] = next[axis].checked_add_signed(step).unwrap();
                        let next = grid.index(next);
                        assert!(tumour.contains(next) || lung.contains(next), "seed {seed} at {place:?}");
                    }
                }
            }
            let mean = |name: &str| {
                let hu: f64 = mask(name).indices().map(|i| f64::from(case.hu()[i])).sum();
                hu / mask(name).count() as f64
            };
            assert!((-800.0..-680.0).contains(&mean("Lungs")), "seed {seed}: {}", mean("Lungs"));
            assert!((20.0..60.0).contains(&mean("GTV")) && mean("Heart") > 0.0, "seed {seed}");
            *seen.entry(is_left).or_insert(0) += 1;
        }
        assert!(seen.len() == 2, "both sides: {seen:?}");
    }

    #[test]
    fn a_seed_is_one_chest_everywhere() {
        let hash = |seed| crate::case::content_hash(&lung(seed).unwrap()).unwrap().to_string();
        assert_eq!(hash(3), hash(3));
        assert_ne!(hash(3), hash(4));
    }
}
