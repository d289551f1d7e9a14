//! A head as a case: the skin is given, what lies beneath is the project's own and follows the proportions of an adult.
//!
//! Places beneath the skin are those of the rig's head: origin midway between the ear canals, x to the patient's left, y
//! to the crown, z out of the face; in the DICOM patient frame x, -z, y.

use super::shapes::{distance, ellipsoid, rod};
use super::texture::Texture;
use crate::Grid;
use crate::case::mask::Mask;
use crate::case::patient::{Case, CaseError, CaseParts, Prescription};
use crate::case::structure::{Role, Structure};

/// Distance of the voxels of a head, mm, if nothing else is asked for.
pub const HEAD_SPACING_MM: f64 = 2.0;
/// Distances of voxels that a head may have, mm: beyond, nothing of the cord is left.
pub const HEAD_SPACINGS_MM: core::ops::RangeInclusive<f64> = 1.0..=5.0;
/// Air around the head.
const AROUND_MM: f64 = 10.0;
const SKULL_MM: f64 = 7.0;
/// From the CTV to the PTV.
const MARGIN_MM: f64 = 3.0;

/// The skin of a head of the adult's size.
pub struct Skin<'a> {
    /// Depth of a place below the skin, mm, by its place in the axes of the head, mm; negative outside. It has to be
    /// right to a tenth of a millimetre within a voxel of the skin.
    pub depth_mm: &'a dyn Fn([f64; 3]) -> f64,
    /// Corners of a box that holds it, mm.
    pub extent_mm: [[f64; 3]; 2],
}

/// What is at a place, in the order in which places are looked up.
#[derive(Clone, Copy, PartialEq, Eq)]
enum BodyPart {
    Soft,
    Bone,
    Brain,
    Brainstem,
    Cord,
    EyeL,
    EyeR,
    Airway,
}

/// The case of a head, with voxels at a distance of [`HEAD_SPACINGS_MM`], mm. The seed draws the place of the target in the
/// brain and the noise of the scanner.
///
/// # Errors
/// A skin of which no case can be made.
pub fn head(skin: &Skin<'_>, seed: u64, spacing_mm: f64) -> Result<Case, CaseError> {
    let spacing_mm = spacing_mm.clamp(*HEAD_SPACINGS_MM.start(), *HEAD_SPACINGS_MM.end());
    let grid = grid(skin, spacing_mm);
    let len = grid.len();
    let place = |i: usize| in_head(grid.centre_mm(grid.voxel(i)));
    let depth: Vec<f64> = (0..len).map(|i| (skin.depth_mm)(place(i))).collect();
    let parts: Vec<BodyPart> = (0..len).map(|i| part(place(i), depth[i])).collect();
    let body = Mask::from_fn(len, |i| depth[i] > 0.0);
    let of = |part: BodyPart| Mask::from_fn(len, |i| depth[i] > 0.0 && parts[i] == part);
    let brain =
        Mask::from_fn(len, |i| matches!(parts[i], BodyPart::Brain | BodyPart::Brainstem) && depth[i] > 0.0);
    let (target, radius) = target(seed);
    let ball =
        |more: f64| Mask::from_fn(len, |i| distance(place(i), target) <= radius + more && body.contains(i));
    let (ctv, ptv) = (ball(0.0), ball(MARGIN_MM));
    let mut texture = Texture::of_seed(seed, &grid);
    let hu = (0..len).map(|i| {
        let (mean, spread) = match parts[i] {
            BodyPart::Soft => (40.0, 14.0),
            BodyPart::Bone => (800.0, 90.0),
            BodyPart::Brain | BodyPart::Brainstem | BodyPart::Cord => (36.0, 5.0),
            BodyPart::EyeL | BodyPart::EyeR => (12.0, 3.0),
            BodyPart::Airway => (-1000.0, 0.0),
        };
        // A voxel that the skin halves is half air.
        let within = (0.5 + depth[i] / spacing_mm).clamp(0.0, 1.0);
        texture.value(-1000.0 + within * (mean + 1000.0), within * spread, grid.voxel(i))
    });
    let hu = hu.collect();
    let structure = |name: &str, role, mask| Structure { name: name.to_owned(), role, mask };
    Case::new(CaseParts {
        name: format!("head-{seed}"),
        grid,
        hu,
        structures: vec![
            structure("Body", Role::External, body),
            structure("PTV", Role::Target, ptv),
            structure("Brain", Role::Organ, brain),
            structure("Brainstem", Role::Organ, of(BodyPart::Brainstem)),
            structure("SpinalCord", Role::Organ, of(BodyPart::Cord)),
            structure("EyeL", Role::Organ, of(BodyPart::EyeL)),
            structure("EyeR", Role::Organ, of(BodyPart::EyeR)),
            structure("CTV", Role::ClinicalTarget, ctv),
        ],
        isocentre_mm: Some(in_patient(target)),
        prescription: vec![Prescription { structure: "PTV".to_owned(), dose_gy: 54.0 }],
        fractions: Some(30),
        reference_dose_gy: None,
        uids: None,
        provenance: format!(
            "stillpoint's own model of a head, seed {seed}, with the skin of the simulated head; no patient"
        ),
    })
}

fn in_head([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, z, -y]
}

fn in_patient([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -z, y]
}

fn grid(skin: &Skin<'_>, spacing_mm: f64) -> Grid {
    let [a, b] = skin.extent_mm.map(in_patient);
    let low: [f64; 3] = std::array::from_fn(|i| a[i].min(b[i]) - AROUND_MM);
    let high: [f64; 3] = std::array::from_fn(|i| a[i].max(b[i]) + AROUND_MM);
    let counts = std::array::from_fn(|i| libm::ceil((high[i] - low[i]) / spacing_mm) as usize + 1);
    Grid { counts, spacing_mm: [spacing_mm; 3], origin_mm: low }
}

/// Place, mm in the head's axes, and radius of the target: in the upper half of the brain, on a side.
fn target(seed: u64) -> ([f64; 3], f64) {
    let part = |number: u64| {
        (seed.wrapping_mul(2_654_435_761).wrapping_add(number * 40_503) >> 7 & 0xff) as f64 / 255.0
    };
    let side = if seed.is_multiple_of(2) { 1.0 } else { -1.0 };
    ([side * (22.0 + 8.0 * part(1)), 48.0 + 8.0 * part(2), 10.0 + 16.0 * part(3)], 14.0 + 4.0 * part(4))
}

fn part(at: [f64; 3], depth: f64) -> BodyPart {
    // Brain and skull, open to the neck below.
    let brain = ellipsoid(at, [0.0, 40.0, 0.0], [64.0, 70.0, 80.0]);
    let stem = rod(at, [0.0, 6.0, -12.0], [0.0, -34.0, -22.0]) - 11.0;
    let cord = rod(at, [0.0, -34.0, -22.0], [0.0, -176.0, -34.0]) - 5.5;
    let vertebrae = rod(at, [0.0, -46.0, -20.0], [0.0, -160.0, -32.0]) - 16.0;
    let airway =
        rod(at, [0.0, -30.0, 40.0], [0.0, -40.0, 14.0]).min(rod(at, [0.0, -40.0, 14.0], [0.0, -150.0, 2.0]))
            - 6.5;
    let jaw = (ellipsoid(at, [0.0, -48.0, 40.0], [46.0, 30.0, 42.0]).abs() - 4.0).max(at[1] + 46.0);
    let eye = |side: f64| distance(at, [side * 31.0, 10.0, 66.0]) - 12.0;
    if stem <= 0.0 {
        BodyPart::Brainstem
    } else if cord <= 0.0 {
        BodyPart::Cord
    } else if brain <= 0.0 && at[1] > -22.0 {
        BodyPart::Brain
    } else if eye(1.0) <= 0.0 {
        BodyPart::EyeL
    } else if eye(-1.0) <= 0.0 {
        BodyPart::EyeR
    } else if airway <= 0.0 {
        BodyPart::Airway
    } else if depth > 3.0 && (brain <= SKULL_MM && at[1] > -30.0 || vertebrae <= 0.0 || jaw <= 0.0) {
        BodyPart::Bone
    } else {
        BodyPart::Soft
    }
}
