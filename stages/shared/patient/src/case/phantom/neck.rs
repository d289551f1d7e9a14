//! A head and neck as a case: throat, salivary glands, jaw, cord and shoulders, and targets as such patients have them.
//!
//! Millimetres in the DICOM patient frame; the origin lies in the throat at the height of the larynx' upper border. It is no
//! patient and no mean of patients: sizes, the site and the side of the tumour, and the lymph nodes that are treated are
//! drawn from the seed, so that the best beams differ from neck to neck.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

use super::shapes::{ellipsoid, rod};
use super::texture::Texture;
use crate::Grid;
use crate::case::mask::Mask;
use crate::case::patient::{Case, CaseError, CaseParts, Prescription};
use crate::case::structure::{Role, Structure};

const SPACING_MM: f64 = 4.0;
/// Air around the body.
const AROUND_MM: f64 = 12.0;
/// Lower and upper end of the images.
const ENDS_MM: [f64; 2] = [-168.0, 132.0];
/// From the tumour to the PTV.
const MARGIN_MM: f64 = 7.0;
/// Targets end below the skin.
const SKIN_MM: f64 = 3.0;
/// Doses of the targets, Gy, and fractions.
const DOSES: [(&str, f64); 3] = [("PTV70", 70.0), ("PTV63", 63.0), ("PTV56", 56.0)];
const FRACTIONS: u32 = 35;
/// A stream of its own.
const STREAM: u64 = 3;

/// Where the tumour is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Site {
    Nasopharynx,
    Oropharynx,
    OralCavity,
    Larynx,
    Parotid,
}

impl Site {
    fn word(self) -> &'static str {
        match self {
            Self::Nasopharynx => "nasopharynx",
            Self::Oropharynx => "oropharynx",
            Self::OralCavity => "oral cavity",
            Self::Larynx => "larynx",
            Self::Parotid => "parotid gland",
        }
    }

    /// Middle of the tumour on the left.
    fn at_mm(self) -> [f64; 3] {
        match self {
            Self::Nasopharynx => [5.0, 0.0, 68.0],
            Self::Oropharynx => [13.0, -8.0, 34.0],
            Self::OralCavity => [12.0, -46.0, 30.0],
            Self::Larynx => [4.0, -14.0, -26.0],
            Self::Parotid => [54.0, 2.0, 40.0],
        }
    }
}

/// A ball or an egg: middle and radii.
type Egg = ([f64; 3], [f64; 3]);

/// One person.
struct Person {
    /// Scale of the head.
    head: f64,
    /// Radii of the neck, across and from front to back.
    neck_mm: [f64; 2],
    /// Where the shoulders begin, how fast they widen, and how wide and deep they become.
    shoulders: [f64; 4],
    fat_mm: f64,
    /// Middle and radii of the left parotid gland.
    parotid: Egg,
    larynx_mm: f64,
    site: Site,
    /// Tumour and swollen nodes.
    gross: Vec<Egg>,
    /// Sides of which the nodes are treated, to the elective and to the middle dose.
    elective: Vec<f64>,
    middle: Vec<f64>,
    /// Upper and lower end, and radius of the treated nodes.
    chain_mm: [f64; 3],
}

/// What is at a place.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Tissue {
    Air,
    Fat,
    Muscle,
    Bone,
    Nerve,
}

/// The head and neck of this seed.
///
/// # Errors
/// None for any seed that was tried; a case without targets would be one.
pub fn neck(seed: u64) -> Result<Case, CaseError> {
    let person = Person::of_seed(seed);
    let grid = person.grid();
    let len = grid.len();
    let places: Vec<[f64; 3]> = (0..len).map(|i| grid.centre_mm(grid.voxel(i))).collect();
    let depth: Vec<f64> = places.iter().map(|at| person.depth_mm(*at)).collect();
    let of = |inside: &dyn Fn([f64; 3]) -> bool| Mask::from_fn(len, |i| depth[i] > 0.0 && inside(places[i]));
    let within =
        |inside: &dyn Fn([f64; 3]) -> bool| Mask::from_fn(len, |i| depth[i] > SKIN_MM && inside(places[i]));
    let high = within(&|at| person.gross_mm(at) <= MARGIN_MM);
    let middle = within(&|at| person.chains_mm(&person.middle, at) <= 0.0);
    let low =
        within(&|at| person.chains_mm(&person.elective, at) <= 0.0 || person.gross_mm(at) <= 2.0 * MARGIN_MM);
    let middle = Mask::from_fn(len, |i| middle.contains(i) && !high.contains(i));
    let low = Mask::from_fn(len, |i| low.contains(i) && !high.contains(i) && !middle.contains(i));
    let mut texture = Texture::of_seed(seed, &grid);
    let hu = (0..len).map(|i| {
        let (mean, spread) = match person.tissue(places[i], depth[i]) {
            Tissue::Air => (-1000.0, 0.0),
            Tissue::Fat => (-90.0, 12.0),
            Tissue::Muscle => (50.0, 14.0),
            Tissue::Bone => (650.0, 110.0),
            Tissue::Nerve => (34.0, 5.0),
        };
        texture.value(mean, spread, grid.voxel(i))
    });
    let hu = hu.collect();
    let structure = |name: &str, role, mask| Structure { name: name.to_owned(), role, mask };
    let organ = |name: &str, inside: &dyn Fn([f64; 3]) -> bool| structure(name, Role::Organ, of(inside));
    let mut structures = vec![
        structure("Body", Role::External, of(&|_| true)),
        structure("PTV70", Role::Target, high),
        structure("PTV63", Role::Target, middle),
        structure("PTV56", Role::Target, low),
        organ("SpinalCord", &|at| cord_mm(at) <= 0.0),
        organ("Brainstem", &|at| brainstem_mm(at) <= 0.0),
        organ("LeftParotid", &|at| person.parotid_mm(1.0, at) <= 0.0),
        organ("RightParotid", &|at| person.parotid_mm(-1.0, at) <= 0.0),
        organ("Larynx", &|at| person.larynx_mm(at) <= 0.0),
        organ("Mandible", &|at| jaw_mm(at) <= 0.0),
    ];
    structures.retain(|s| !s.mask.is_empty());
    let prescribed = DOSES.iter().filter(|(name, _)| structures.iter().any(|s| s.name == *name));
    let prescription =
        prescribed.map(|(name, dose_gy)| Prescription { structure: (*name).to_owned(), dose_gy: *dose_gy });
    Case::new(CaseParts {
        name: format!("neck-{seed}"),
        grid,
        hu,
        prescription: prescription.collect(),
        structures,
        isocentre_mm: None,
        fractions: Some(FRACTIONS),
        reference_dose_gy: None,
        uids: None,
        provenance: format!(
            "stillpoint's own model of a head and neck, seed {seed} (tumour: {}); no patient",
            person.site.word()
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
        let head = between(0.92, 1.08);
        let neck_mm = [between(50.0, 70.0), between(54.0, 72.0)];
        let shoulders =
            [between(-105.0, -60.0), between(1.4, 3.2), between(185.0, 235.0), between(84.0, 112.0)];
        let fat_mm = between(3.0, 14.0);
        let mut parotid = (
            [between(52.0, 62.0), between(-4.0, 10.0), between(34.0, 48.0)],
            [between(9.0, 15.0), between(15.0, 22.0), between(16.0, 26.0)],
        );
        // The gland of a narrow neck lies nearer to the middle.
        parotid.0[0] = f64::min(parotid.0[0], neck_mm[0] - 0.7 * parotid.1[0]);
        let larynx_mm = between(13.0, 18.0);
        let site = match between(0.0, 1.0) {
            u if u < 0.2 => Site::Nasopharynx,
            u if u < 0.5 => Site::Oropharynx,
            u if u < 0.67 => Site::OralCavity,
            u if u < 0.88 => Site::Larynx,
            _ => Site::Parotid,
        };
        let side = if between(0.0, 1.0) < 0.5 { 1.0 } else { -1.0 };
        let at = site.at_mm();
        let middle_mm =
            [side * (at[0] + between(-4.0, 8.0)), at[1] + between(-6.0, 6.0), at[2] + between(-9.0, 9.0)];
        let mut gross = vec![(middle_mm, [between(11.0, 28.0), between(11.0, 26.0), between(12.0, 32.0)])];
        let node_side = if between(0.0, 1.0) < 0.8 { side } else { -side };
        let node = (
            [node_side * between(32.0, 46.0), between(2.0, 20.0), between(-40.0, 40.0)],
            [between(9.0, 20.0), between(9.0, 20.0), between(10.0, 26.0)],
        );
        if between(0.0, 1.0) < 0.55 {
            gross.push(node);
        }
        let (u, v) = (between(0.0, 1.0), between(0.0, 1.0));
        let elective = match site {
            Site::Parotid => vec![side],
            _ if u < 0.2 => vec![side],
            _ if u < 0.88 => vec![1.0, -1.0],
            _ => Vec::new(),
        };
        let middle = match v {
            v if v < 0.35 && elective.contains(&side) => vec![side],
            v if v < 0.45 && elective.len() == 2 => vec![1.0, -1.0],
            _ => Vec::new(),
        };
        let chain_mm = [between(30.0, 66.0), between(-105.0, -45.0), between(11.0, 19.0)];
        Self { head, neck_mm, shoulders, fat_mm, parotid, larynx_mm, site, gross, elective, middle, chain_mm }
    }

    /// A grid with the person in its middle.
    fn grid(&self) -> Grid {
        let half = self.shoulders[2] + AROUND_MM;
        let low = [-half, -118.0 * self.head - AROUND_MM, ENDS_MM[0]];
        let high = [half, (128.0 + self.shoulders[3] - 84.0).max(124.0) + AROUND_MM, ENDS_MM[1]];
        let count = |axis: usize| libm::ceil((high[axis] - low[axis]) / SPACING_MM) as usize + 1;
        Grid { counts: [count(0), count(1), count(2)], spacing_mm: [SPACING_MM; 3], origin_mm: low }
    }

    /// Depth below the skin, about; negative outside.
    fn depth_mm(&self, at: [f64; 3]) -> f64 {
        let s = self.head;
        let skull = ellipsoid(at, [0.0, 18.0 * s, 130.0], [74.0 * s, 94.0 * s, 92.0 * s]);
        let face = ellipsoid(at, [0.0, -34.0 * s, 60.0], [60.0 * s, 76.0 * s, 80.0 * s]);
        let [begin, widening, width, depth] = self.shoulders;
        let below = (begin - at[2]).max(0.0);
        let radii =
            [(self.neck_mm[0] + widening * below).min(width), (self.neck_mm[1] + 0.5 * below).min(depth)];
        let trunk =
            if at[2] > 62.0 { f64::INFINITY } else { oval_mm([at[0], at[1] - middle_y_mm(at[2])], radii) };
        -skull.min(face).min(trunk)
    }

    fn tissue(&self, at: [f64; 3], depth: f64) -> Tissue {
        if depth <= 0.0 || airway_mm(at) <= 0.0 && self.gross_mm(at) > 0.0 {
            return Tissue::Air;
        }
        if cord_mm(at) <= 0.0 || brainstem_mm(at) <= 0.0 {
            return Tissue::Nerve;
        }
        let skull = ellipsoid(at, [0.0, 18.0, 130.0], [66.0, 84.0, 84.0]);
        let spine =
            rod(at, [0.0, -18.0 + cord_y_mm(50.0), 50.0], [0.0, -18.0 + cord_y_mm(-170.0), -170.0]) - 13.0;
        let arch = (cord_mm(at) - 4.0).max(-cord_mm(at)) - 3.0;
        let bone = spine.min(arch.max(at[2] - 50.0)).min(skull.abs() - 4.0).min(jaw_mm(at));
        match bone <= 0.0 && depth > 2.0 {
            true => Tissue::Bone,
            false if skull < 0.0 => Tissue::Nerve,
            false if depth < self.fat_mm => Tissue::Fat,
            false => Tissue::Muscle,
        }
    }

    /// Distance from the tumour and the swollen nodes.
    fn gross_mm(&self, at: [f64; 3]) -> f64 {
        self.gross.iter().map(|(middle, radii)| ellipsoid(at, *middle, *radii)).fold(f64::INFINITY, f64::min)
    }

    /// Distance from the lymph nodes along the vessels of these sides.
    fn chains_mm(&self, sides: &[f64], at: [f64; 3]) -> f64 {
        let [high, low, radius] = self.chain_mm;
        let chain = |side: &f64| {
            let (top, bottom) = ([side * 40.0, 6.0, high], [side * 34.0, middle_y_mm(low) - 6.0, low]);
            rod(at, top, bottom) - radius
        };
        sides.iter().map(chain).fold(f64::INFINITY, f64::min)
    }

    fn parotid_mm(&self, side: f64, [x, y, z]: [f64; 3]) -> f64 {
        ellipsoid([side * x, y, z], self.parotid.0, self.parotid.1)
    }

    fn larynx_mm(&self, at: [f64; 3]) -> f64 {
        rod(at, [0.0, -14.0, -12.0], [0.0, -10.0, -44.0]) - self.larynx_mm
    }
}

/// The middle of the neck, from front to back: it leans to the back below.
fn middle_y_mm(z: f64) -> f64 {
    26.0 - 0.2 * z
}

fn cord_y_mm(z: f64) -> f64 {
    28.0 - 0.26 * (z - 20.0).min(60.0)
}

fn cord_mm(at: [f64; 3]) -> f64 {
    rod(at, [0.0, cord_y_mm(56.0), 56.0], [0.0, cord_y_mm(-180.0), -180.0]) - 5.5
}

fn brainstem_mm(at: [f64; 3]) -> f64 {
    ellipsoid(at, [0.0, 16.0, 82.0], [14.0, 12.0, 27.0])
}

fn airway_mm(at: [f64; 3]) -> f64 {
    rod(at, [0.0, -36.0, 78.0], [0.0, -14.0, 62.0])
        .min(rod(at, [0.0, -14.0, 62.0], [0.0, -12.0, -40.0]))
        .min(rod(at, [0.0, -12.0, -40.0], [0.0, 20.0, -180.0]))
        - 7.0
}

/// The jaw: a bow in front, and a branch upwards on each side.
fn jaw_mm([x, y, z]: [f64; 3]) -> f64 {
    let bow = oval_mm([x, y + 24.0], [46.0, 66.0]).abs() - 5.0;
    let bow = bow.max((z - 18.0).abs() - 13.0).max(y - 4.0);
    let branch = rod([x.abs(), y, z], [46.0, -6.0, 12.0], [48.0, -10.0, 66.0]) - 7.0;
    bow.min(branch)
}

/// Distance from an oval in a plane, to the first order; negative inside.
fn oval_mm([x, y]: [f64; 2], [a, b]: [f64; 2]) -> f64 {
    ellipsoid([x, y, 0.0], [0.0; 3], [a, b, 1e6])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn necks_differ_in_site_side_and_nodes_and_are_valid() {
        let mut seen = std::collections::BTreeMap::new();
        for seed in 0..80 {
            let person = Person::of_seed(seed);
            let nodes = format!("{} elective, {} middle", person.elective.len(), person.middle.len());
            let side = if person.gross[0].0[0] > 0.0 { "left" } else { "right" };
            for what in [person.site.word().to_owned(), side.to_owned(), nodes] {
                *seen.entry(what).or_insert(0) += 1;
            }
        }
        // Five sites, two sides, six combinations of treated nodes.
        assert!(seen.len() == 13 && seen.values().all(|times| (2..70).contains(times)), "{seen:?}");
        for seed in 0..8 {
            let case = neck(seed).unwrap();
            assert!(!case.is_pelvis());
            let volume = |name: &str| case.structure(name).map_or(0.0, |s| case.volume_cm3(s));
            assert!((30.0..420.0).contains(&volume("PTV70")), "seed {seed}: {}", volume("PTV70"));
            assert!((4_000.0..16_000.0).contains(&volume("Body")), "seed {seed}: {}", volume("Body"));
            for (name, low, high) in [
                ("SpinalCord", 10.0, 40.0),
                ("Brainstem", 10.0, 45.0),
                ("LeftParotid", 8.0, 50.0),
                ("Mandible", 30.0, 120.0),
            ] {
                assert!((low..high).contains(&volume(name)), "seed {seed}: {name} has {} cm3", volume(name));
            }
            let body = &case.external().unwrap().mask;
            let targets: Vec<&Structure> = case.targets().collect();
            assert!(targets.iter().all(|t| t.mask.indices().all(|i| body.contains(i))), "seed {seed}");
            assert_eq!(targets.len(), case.prescription().len(), "seed {seed}");
            let both = |a: &Mask, b: &Mask| a.indices().filter(|i| b.contains(*i)).count();
            assert!(targets.windows(2).all(|t| both(&t[0].mask, &t[1].mask) == 0), "seed {seed}");
            let left = &case.structure("LeftParotid").unwrap().mask;
            assert!(
                left.indices().all(|i| case.grid().centre_mm(case.grid().voxel(i))[0] > 0.0),
                "left is +x"
            );
        }
        let hash = |seed| crate::case::content_hash(&neck(seed).unwrap()).unwrap().to_string();
        assert_eq!(
            hash(0),
            "69572e9160e563466b3f1ee347b3b3d48cf87c2f9c964e3f8d4bdf127547a3df",
            "the neck of seed 0 has changed: raise the version of games, which name their patients by seed"
        );
    }
}
