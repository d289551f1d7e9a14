//! What a gantry angle sees of a patient: features of each angle of a ring, and of each pair. No dose is computed.
//!
//! All features are even under a mirror of the patient, and turn with the patient, so that a network over them can treat a
//! mirrored or turned patient no otherwise than beams and tissue do.

use stillpoint_patient::case::{Case, Mask, Role};
use stillpoint_plan::dose::Machine;
use stillpoint_plan::fluence::StructureObjectives;
use thiserror::Error;

use crate::lattice::Lattice;
use crate::view::{Aperture, BeamView, dot};
use crate::volume::{MOST_STRUCTURES, Volume};

/// Version of the features: another one where the same numbers mean something else.
pub const FEATURES_VERSION: u32 = 2;
/// Features of an angle that concern the target.
pub const TARGET: usize = 15;
/// Features of an angle that concern one structure at risk.
pub const STRUCTURE: usize = 16;
/// Features of a pair of angles.
pub const PAIR: usize = 9;

/// Distance of the points at which targets and organs are seen, mm; and of those of the outline.
const POINTS_MM: f64 = 9.0;
const OUTLINE_POINTS_MM: f64 = 18.0;
/// Voxels of an organ that are looked up in the bixels, about.
const MOST_VOXELS: usize = 2000;
/// Points of a structure beyond which a coarser lattice is taken.
const MOST_POINTS: usize = 4000;
/// The features of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Eye {
    /// Angles of the ring, from 0 degrees.
    pub angles: usize,
    /// For each angle its features of the target.
    pub target: Vec<[f32; TARGET]>,
    /// For each structure at risk, for each angle its features.
    pub structures: Vec<Vec<[f32; STRUCTURE]>>,
    /// For each pair of angles `a * angles + b` its features; the same for `(b, a)`.
    pub pairs: Vec<[f32; PAIR]>,
}

/// Why a case cannot be seen.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum EyeError {
    /// The case has no outline.
    #[error(
        "the case has no outline, so that no path through tissue can be measured; draw one and import the case again"
    )]
    NoOutline,
    /// The case has no target with voxels and a prescription.
    #[error("the case has no target with a prescription; import it with `--prescribe`")]
    NoTarget,
    /// Nothing is wanted of any structure but targets.
    #[error("no organ and no outline has an objective against overdose, so that all angles are alike")]
    NoRisk,
    /// Bixels that cannot be.
    #[error("bixels of {0} mm are too narrow or too wide: give 1 to 100 mm")]
    Bixel(f64),
    /// Too few angles.
    #[error("a ring of {0} angles is too small: give at least 8")]
    Angles(usize),
}

/// A structure at risk: what of it costs.
struct Risk<'a> {
    mask: &'a Mask,
    outline: bool,
    /// Tolerated dose as a part of the prescription.
    tolerance: f64,
    weight: f64,
}

/// Points of a structure with their doses, so to speak: what an open field on the target gives them, in parts of the
/// target's mean.
struct Seen {
    points_mm: Vec<[f64; 3]>,
    /// For each angle, for each point.
    fluence: Vec<Vec<f32>>,
}

impl Eye {
    /// Looks at a case from `angles` equal steps around it. `requested` are the objectives, as of
    /// [`stillpoint_plan::objectives::ObjectiveSet`]; of each structure but targets the objective of the largest
    /// weight that limits its dose below the prescription counts. `bixel_mm` is the width of the bixels of which the beams
    /// will be made.
    pub fn of_case(
        case: &Case,
        requested: &[StructureObjectives],
        machine: &Machine,
        angles: usize,
        bixel_mm: f64,
    ) -> Result<Self, EyeError> {
        if angles < 8 {
            return Err(EyeError::Angles(angles));
        }
        if !(1.0..=100.0).contains(&bixel_mm) {
            return Err(EyeError::Bixel(bixel_mm));
        }
        let outline = case.external().ok_or(EyeError::NoOutline)?;
        let prescribed = case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
        let target = Mask::from_fn(case.grid().len(), |voxel| case.targets().any(|t| t.mask.contains(voxel)));
        if prescribed <= 0.0 || target.is_empty() {
            return Err(EyeError::NoTarget);
        }
        let risks = risks(case, requested, prescribed);
        if risks.is_empty() {
            return Err(EyeError::NoRisk);
        }
        let mut masks: Vec<&Mask> = vec![&target, &outline.mask];
        masks.extend(risks.iter().map(|risk| risk.mask));
        let volume = Volume::new(case, machine, &masks);
        let views: Vec<BeamView> = (0..angles).map(|a| BeamView::new(case, machine, a, angles)).collect();
        let lattice = |bit: usize, spacing| points(case, &volume, bit, spacing);
        let on_target = lattice(0, POINTS_MM);
        let apertures: Vec<Aperture> =
            views.iter().map(|view| Aperture::of(view, machine, &on_target)).collect();
        let sees = |points_mm: Vec<[f64; 3]>, norms: Option<&[f64]>| {
            let of = |(a, view): (usize, &BeamView)| {
                let norm = norms.map_or(1.0, |norms| norms[a]);
                points_mm
                    .iter()
                    .map(|p| (apertures[a].fluence(&volume, view, machine, *p) / norm) as f32)
                    .collect()
            };
            let fluence = views.iter().enumerate().map(of).collect();
            Seen { points_mm, fluence }
        };
        let raw = sees(on_target, None);
        let norms: Vec<f64> = raw.fluence.iter().map(|f| mean(f).max(1e-9)).collect();
        let mut seen_target = raw;
        for (fluence, norm) in seen_target.fluence.iter_mut().zip(&norms) {
            fluence.iter_mut().for_each(|value| *value = (f64::from(*value) / norm) as f32);
        }
        let seen: Vec<Seen> = risks
            .iter()
            .enumerate()
            .map(|(place, risk)| {
                let spacing = if risk.outline { OUTLINE_POINTS_MM } else { POINTS_MM };
                sees(lattice(place + 2, spacing), Some(&norms))
            })
            .collect();
        let highest = Mask::from_fn(case.grid().len(), |voxel| {
            let of_highest = |name: &str| {
                case.prescription().iter().any(|p| p.structure == name && p.dose_gy >= prescribed)
            };
            case.targets().any(|t| of_highest(&t.name) && t.mask.contains(voxel))
        });
        let voxels = [voxels_of(case, &target, usize::MAX), voxels_of(case, &highest, usize::MAX)];
        let of_risk = |risk: &Risk<'_>| match risk.outline {
            true => Vec::new(),
            false => voxels_of(case, risk.mask, MOST_VOXELS),
        };
        let voxels_at_risk: Vec<Vec<[f64; 3]>> = risks.iter().map(of_risk).collect();
        let mut structures = vec![Vec::with_capacity(angles); risks.len()];
        let mut of_target = Vec::with_capacity(angles);
        for (a, view) in views.iter().enumerate() {
            let passed = Front::of(&volume, view, &seen_target.points_mm, risks.len() + 2);
            let bixels = [0, 1].map(|i| view.lattice(case, machine, &voxels[i], bixel_mm));
            of_target.push(passed.target(&apertures[a], norms[a], &bixels));
            for (place, risk) in risks.iter().enumerate() {
                let mixed = view.mixed(machine, &voxels_at_risk[place], &bixels[0]);
                let found = passed.structure(place + 2, risk, &seen[place], a, view, case, mixed);
                structures[place].push(found);
            }
        }
        let ratio = seen_target.points_mm.len() as f64;
        let pairs = pairs(angles, &risks, &seen_target, &seen, ratio);
        Ok(Self { angles, target: of_target, structures, pairs })
    }
}

/// The structures at risk, in the order of `requested`.
fn risks<'a>(case: &'a Case, requested: &[StructureObjectives], prescribed: f64) -> Vec<Risk<'a>> {
    let mut risks = Vec::new();
    for structure_objectives in requested {
        let Some(structure) = case.structure(&structure_objectives.name).filter(|s| s.role != Role::Target)
        else {
            continue;
        };
        let over = structure_objectives.objectives.iter().filter_map(|objective| {
            let dose = objective.tolerated_gy().filter(|dose| *dose < prescribed)?;
            Some((dose, objective.weight()))
        });
        let Some((dose, weight)) = over.reduce(|a, b| if b.1 > a.1 { b } else { a }) else { continue };
        if weight > 0.0 && !structure.mask.is_empty() && risks.len() + 2 < MOST_STRUCTURES {
            let outline = structure.role == Role::External;
            risks.push(Risk { mask: &structure.mask, outline, tolerance: dose / prescribed, weight });
        }
    }
    risks
}

/// Points of a lattice through the isocentre that lie in a structure. The lattice is coarser where they would be many, and
/// finer where they would be none.
fn points(case: &Case, volume: &Volume, bit: usize, spacing_mm: f64) -> Vec<[f64; 3]> {
    let (grid, centre) = (case.grid(), case.isocentre_mm());
    let mut spacing = spacing_mm;
    for _ in 0..6 {
        let range = |axis: usize| {
            let end = grid.origin_mm[axis] + grid.spacing_mm[axis] * grid.counts[axis] as f64;
            let low = ((grid.origin_mm[axis] - centre[axis]) / spacing).floor() as i32;
            low..=((end - centre[axis]) / spacing).ceil() as i32
        };
        let mut found = Vec::new();
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let steps = [x, y, z].map(f64::from);
                    let point = std::array::from_fn(|axis| centre[axis] + spacing * steps[axis]);
                    if volume.labels_at(point) >> bit & 1 == 1 {
                        found.push(point);
                    }
                }
            }
        }
        match found.len() {
            0..8 => spacing *= 0.5,
            n if n > MOST_POINTS => spacing *= 1.5,
            _ => return found,
        }
        if spacing < 1.0 {
            return found;
        }
    }
    Vec::new()
}

/// Centres of the voxels of a mask, mm; of many one in so many that about `most` are left.
fn voxels_of(case: &Case, mask: &Mask, most: usize) -> Vec<[f64; 3]> {
    let step = mask.count().div_ceil(most.max(1)).max(1);
    let grid = case.grid();
    mask.indices().step_by(step).map(|voxel| grid.centre_mm(grid.voxel(voxel))).collect()
}

/// What the rays through the target's points pass before and behind them.
struct Front {
    before: Vec<crate::volume::Passed>,
    behind: Vec<crate::volume::Passed>,
}

impl Front {
    fn of(volume: &Volume, view: &BeamView, target_mm: &[[f64; 3]], structures: usize) -> Self {
        let pass = |p: &[f64; 3], direction: f64| {
            let (toward, _) = view.toward_source(*p);
            volume.pass(*p, toward.map(|t| direction * t), structures)
        };
        Self {
            before: target_mm.iter().map(|p| pass(p, 1.0)).collect(),
            behind: target_mm.iter().map(|p| pass(p, -1.0)).collect(),
        }
    }

    /// `bixels` are those of all targets, and of the targets of the highest dose.
    fn target(&self, aperture: &Aperture, norm: f64, bixels: &[Lattice; 2]) -> [f32; TARGET] {
        let water: Vec<f64> = self.before.iter().map(|p| p.water_mm).collect();
        let count = water.len().max(1) as f64;
        let sum = |of: fn(&crate::volume::Passed) -> f64| self.before.iter().map(of).sum::<f64>() / count;
        let middle = water.iter().sum::<f64>() / count;
        let spread = libm::sqrt(water.iter().map(|w| (w - middle) * (w - middle)).sum::<f64>() / count);
        let least = water.iter().copied().fold(f64::INFINITY, f64::min);
        let most = water.iter().copied().fold(0.0, f64::max);
        [
            middle / 100.0,
            spread / 20.0,
            if least.is_finite() { least / 100.0 } else { 0.0 },
            most / 100.0,
            norm,
            aperture.area() / 100.0,
            aperture.width_mm / 20.0,
            sum(|p| p.length_mm) / 100.0,
            sum(|p| p.metal_mm) / 20.0,
            sum(|p| p.bone_mm) / 20.0,
            bixels[0].misfit(),
            bixels[0].touched(),
            bixels[0].rounded(),
            bixels[1].misfit(),
            bixels[1].area() / bixels[0].area().max(1e-9),
        ]
        .map(|v| v as f32)
    }

    #[allow(clippy::too_many_arguments)]
    fn structure(
        &self,
        bit: usize,
        risk: &Risk<'_>,
        seen: &Seen,
        a: usize,
        view: &BeamView,
        case: &Case,
        mixed: [f64; 2],
    ) -> [f32; STRUCTURE] {
        let share = |passed: &[crate::volume::Passed]| {
            let crossed = passed.iter().filter(|p| p.structures_mm[bit] > 0.0).count();
            let length: f64 = passed.iter().map(|p| p.structures_mm[bit]).sum();
            let count = passed.len().max(1) as f64;
            [crossed as f64 / count, length / count / 50.0]
        };
        let ([before, before_mm], [behind, behind_mm]) = (share(&self.before), share(&self.behind));
        let fluence = &seen.fluence[a];
        let count = fluence.len().max(1) as f64;
        let hit = fluence.iter().filter(|f| **f > 0.0).count() as f64 / count;
        let square = fluence.iter().map(|f| f64::from(*f) * f64::from(*f)).sum::<f64>() / count;
        let beyond = fluence.iter().filter(|f| **f > 1.0).count() as f64 / count;
        let centre: [f64; 3] = std::array::from_fn(|axis| {
            seen.points_mm.iter().map(|p| p[axis]).sum::<f64>() / count - case.isocentre_mm()[axis]
        });
        let volume = libm::log10(1.0 + seen.points_mm.len() as f64);
        [
            mean(fluence),
            square,
            hit,
            beyond,
            before,
            before_mm,
            behind,
            behind_mm,
            dot(centre, view.across).abs() / 50.0,
            dot(centre, view.toward) / 50.0,
            risk.tolerance,
            libm::log10(risk.weight.max(1e-6)),
            if risk.outline { 1.0 } else { 0.0 },
            volume,
            mixed[0],
            mixed[1],
        ]
        .map(|v| v as f32)
    }
}

fn pairs(
    angles: usize,
    risks: &[Risk<'_>],
    target: &Seen,
    seen: &[Seen],
    target_points: f64,
) -> Vec<[f32; PAIR]> {
    let organs: f64 = risks.iter().filter(|r| !r.outline).map(|r| r.weight).sum::<f64>().max(1e-9);
    let coarser = OUTLINE_POINTS_MM / POINTS_MM;
    let outline_points = coarser * coarser * coarser / target_points.max(1.0);
    let one = |a: usize, b: usize| -> [f32; PAIR] {
        let mut found = [0.0; PAIR];
        for (risk, seen) in risks.iter().zip(seen) {
            let (fa, fb) = (&seen.fluence[a], &seen.fluence[b]);
            let both = || fa.iter().zip(fb).filter(|(a, b)| **a > 0.0 && **b > 0.0);
            let product: f64 = both().map(|(a, b)| f64::from(a * b)).sum();
            let count = fa.len().max(1) as f64;
            if risk.outline {
                found[1] += product * outline_points;
            } else {
                let weight = risk.weight / organs;
                found[0] += weight * product / count;
                found[3] += weight * both().count() as f64 / count;
                found[4] += weight * product / count / (risk.tolerance * risk.tolerance).max(0.01);
            }
        }
        let off = |(a, b): (&f32, &f32)| f64::from((a - 1.0) * (b - 1.0));
        let count = target.points_mm.len().max(1) as f64;
        found[2] = 10.0 * target.fluence[a].iter().zip(&target.fluence[b]).map(off).sum::<f64>() / count;
        let apart = core::f64::consts::TAU * a.abs_diff(b) as f64 / angles as f64;
        for k in 1..=4 {
            found[4 + k] = libm::cos(k as f64 * apart);
        }
        found.map(|v| v as f32)
    };
    let mut all = vec![[0.0; PAIR]; angles * angles];
    for a in 0..angles {
        for b in a..angles {
            let found = one(a, b);
            all[a * angles + b] = found;
            all[b * angles + a] = found;
        }
    }
    all
}

fn mean(values: &[f32]) -> f64 {
    values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len().max(1) as f64
}
