//! Where a dose is compared with the reference, and how far it may be from it.

use serde::Serialize;

use super::computed::Computed;
use super::phantom::{DEPTHS, Phantom, Setting, VOXEL_MM};
use super::reference::Reference;

/// Largest sigma of a point that a bound judges, as a part of its dose.
const SIGMA: f64 = 0.01;
/// Part of the greatest dose above which points count for the rms.
const COUNTED: f64 = 0.1;

/// By what a deviation is divided.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Of {
    /// The dose of the reference there.
    Dose,
    /// The greatest dose of the reference.
    Greatest,
}

/// Depths on the axis.
struct Place {
    phantom: Phantom,
    name: &'static str,
    from_mm: f64,
    to_mm: f64,
    of: Of,
    /// Sides of fields, cm, with the largest deviation.
    bounds: &'static [(u32, f64)],
}

const fn place(
    phantom: Phantom,
    name: &'static str,
    [from_mm, to_mm]: [f64; 2],
    bounds: &'static [(u32, f64)],
) -> Place {
    Place { phantom, name, from_mm, to_mm, of: Of::Dose, bounds }
}

const PLACES: [Place; 16] = [
    place(Phantom::Water, "10 cm", [100.0, 102.5], &[]),
    Place {
        of: Of::Greatest,
        ..place(Phantom::Water, "0.5 to 25 cm, of the greatest dose", [5.0, 250.0], &[(2, 0.025), (5, 0.025)])
    },
    place(Phantom::Lung, "lung, 8 cm", [80.0, 82.5], &[]),
    place(Phantom::Lung, "lung, 3 to 13 cm", [30.0, 130.0], &[(2, 0.08), (5, 0.04)]),
    place(Phantom::Lung, "first voxel of water behind lung", [130.0, 132.5], &[]),
    place(Phantom::Lung, "water behind lung, 13 to 25 cm", [130.0, 250.0], &[(2, 0.05), (5, 0.04)]),
    place(Phantom::Bone, "bone, 6 cm", [60.0, 62.5], &[]),
    place(Phantom::Air, "first voxel behind air", [40.0, 42.5], &[(2, 0.06)]),
    place(Phantom::Air, "second voxel behind air", [42.5, 45.0], &[(2, 0.06)]),
    place(Phantom::Tumour, "lung before the tumour, 7.6 cm", [75.0, 77.5], &[]),
    place(Phantom::Tumour, "lung before the tumour, 3 to 9 cm", [30.0, 90.0], &[(2, 0.08), (5, 0.04)]),
    place(Phantom::Tumour, "first voxel of the tumour", [90.0, 92.5], &[]),
    place(Phantom::Tumour, "centre of the tumour", [100.0, 102.5], &[]),
    place(Phantom::Tumour, "tumour, 9 to 11 cm", [90.0, 110.0], &[(2, 0.05), (5, 0.04)]),
    place(Phantom::Tumour, "lung behind the tumour, first cm", [110.0, 120.0], &[(2, 0.10), (5, 0.04)]),
    place(Phantom::Tumour, "lung behind the tumour, 12 to 23 cm", [120.0, 230.0], &[(2, 0.08), (5, 0.04)]),
];

/// Largest rms over the axis and all profiles, by setting, as a part of the greatest dose.
const RMS: [(Phantom, u32, f64); 5] = [
    (Phantom::Water, 2, 0.011),
    (Phantom::Water, 5, 0.011),
    (Phantom::Air, 2, 0.012),
    (Phantom::Lung, 2, 0.026),
    (Phantom::Tumour, 2, 0.027),
];

/// A place with its deviations from the reference, as parts of its dose or of the greatest dose, too high above zero.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JudgedPlace {
    /// Depths on the axis, or `rms`.
    pub name: &'static str,
    /// The worst deviation by superposition.
    pub superposition: f64,
    /// The worst deviation by pencil beams.
    pub pencil: f64,
    /// Largest deviation that the superposition may have.
    pub bound: Option<f64>,
}

impl JudgedPlace {
    /// Whether the superposition is within the bound; `None` without one.
    pub fn is_met(&self) -> Option<bool> {
        Some(self.superposition.abs() <= self.bound?)
    }
}

/// The places of a setting. A bound judges points with a sigma of at most 1 %.
pub(super) fn judged(
    setting: Setting,
    reference: &Reference,
    superposition: &Computed,
    pencil: &Computed,
) -> Vec<JudgedPlace> {
    let mut places = Vec::new();
    for place in PLACES.iter().filter(|place| place.phantom == setting.phantom) {
        let bound =
            place.bounds.iter().find(|(field, _)| *field == setting.field_cm).map(|(_, bound)| *bound);
        let worst = |of: &Computed| worst(place, bound.is_some(), reference, of);
        if let (Some(superposition), Some(pencil)) = (worst(superposition), worst(pencil)) {
            places.push(JudgedPlace { name: place.name, superposition, pencil, bound });
        }
    }
    let rms = |of: &Computed| rms(setting.phantom, reference, of);
    let is_here = |(phantom, field_cm, _): &&(Phantom, u32, f64)| {
        *phantom == setting.phantom && *field_cm == setting.field_cm
    };
    let bound = RMS.iter().find(is_here).map(|(.., bound)| *bound);
    places.push(JudgedPlace { name: "rms", superposition: rms(superposition), pencil: rms(pencil), bound });
    places
}

/// The deviation of the greatest magnitude; `None` where no point is quiet enough.
fn worst(place: &Place, is_bounded: bool, reference: &Reference, ours: &Computed) -> Option<f64> {
    let greatest = greatest(reference);
    let is_judged = |y: &usize| {
        let is_quiet = reference.axis_sigma[*y] <= SIGMA * reference.axis[*y];
        (place.from_mm..place.to_mm).contains(&depth_mm(*y)) && (is_quiet || !is_bounded)
    };
    let deviation = |y: usize| {
        let by = if place.of == Of::Greatest { greatest } else { reference.axis[y] };
        (ours.axis[y] - reference.axis[y]) / by
    };
    (0..DEPTHS).filter(is_judged).map(deviation).max_by(|a, b| a.abs().total_cmp(&b.abs()))
}

/// Root of the mean square of the deviations on the axis and the profiles, without the noise of the reference, as a part of
/// the greatest dose. Air and the first voxel below the skin are left out.
fn rms(phantom: Phantom, reference: &Reference, ours: &Computed) -> f64 {
    let greatest = greatest(reference);
    let (mut sum, mut count) = (0.0, 0_u32);
    let mut add = |ours: f64, theirs: f64, sigma: f64| {
        if theirs > COUNTED * greatest {
            let (off, noise) = ((ours - theirs) / greatest, sigma / greatest);
            sum += off * off - noise * noise;
            count += 1;
        }
    };
    let is_left_out = |depth_mm: f64| depth_mm < VOXEL_MM || phantom.is_noisy(depth_mm);
    for y in (0..DEPTHS).filter(|y| !is_left_out(depth_mm(*y))) {
        add(ours.axis[y], reference.axis[y], reference.axis_sigma[y]);
    }
    for (profile, ours) in reference.profiles.iter().zip(&ours.profiles) {
        if !is_left_out(profile.depth_mm) {
            let points = profile.dose.iter().zip(&profile.sigma).zip(ours);
            points.for_each(|((dose, sigma), ours)| add(*ours, *dose, *sigma));
        }
    }
    libm::sqrt((sum / f64::from(count.max(1))).max(0.0))
}

fn greatest(reference: &Reference) -> f64 {
    reference.axis.iter().copied().fold(0.0, f64::max)
}

/// Middle of a voxel on the axis.
fn depth_mm(y: usize) -> f64 {
    (y as f64 + 0.5) * VOXEL_MM
}
