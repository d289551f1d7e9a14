//! What a dose does to each structure of a case, as plans are judged by.
//!
//! Figures are of the volumes of structures: a voxel at the border counts with the part of it that lies inside. They hold
//! for the dose that is given; a plan gives the one that [`crate::recompute`] makes. A structure is judged over all of its
//! voxels: what lies beside the grid of a dose has no dose.

use serde::{Deserialize, Serialize};

use crate::distance::{depths_mm, distances_mm};
use crate::metrics::{Dvh, paddick_conformity};
use crate::occupancy::Occupancy;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Mask, Role, Structure};

/// Dose that counts as the prescribed one in coverage and conformity.
const COVERED: f64 = 0.95;
/// Volume whose least dose stands for the largest dose, cm3.
const SMALL_CM3: f64 = 0.03;
/// Beyond this distance from every target dose counts as far, mm.
const FAR_MM: f32 = 20.0;
/// Targets nearer to each other than this are treated as one, mm.
const ONE_TARGET_MM: f32 = 10.0;
/// Volume below which nothing is beside the grid, cm3.
const ROUNDING_CM3: f64 = 1e-6;
/// Depth below the skin of what beams enter through, mm.
const ENTRY_MM: f32 = 10.0;

/// Figures of one structure. Doses are in gray, volumes without a unit are fractions of the structure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StructureDose {
    /// Its name.
    pub name: String,
    /// What it is to the plan.
    pub role: Role,
    /// Its volume in the image, cm3.
    pub volume_cm3: f64,
    /// Voxels of the dose that it takes, wholly or in part.
    pub voxels: usize,
    /// Dose that is prescribed to it.
    pub prescribed_gy: Option<f64>,
    /// Dose that 98 % of it get at least.
    pub d98_gy: f64,
    /// Dose that 95 % of it get at least.
    pub d95_gy: f64,
    /// Median.
    pub d50_gy: f64,
    /// Dose that 10 % of it get at least.
    pub d10_gy: f64,
    /// Dose that 2 % of it get at least.
    pub d2_gy: f64,
    /// Mean.
    pub mean_gy: f64,
    /// Dose that 0.03 cm3 get at least: the largest dose that counts.
    #[serde(rename = "d0_03cc_gy")]
    pub d003cc_gy: f64,
    /// Doses, and the fraction that gets at least each.
    pub volumes: Vec<VolumeAt>,
    /// Of a target: the fraction that gets 95 % of its prescription.
    pub covered: Option<f64>,
    /// Of a target: `(D2 - D98) / D50`.
    pub homogeneity: Option<f64>,
    /// Of a target: Paddick's index of 95 % of its prescription. Targets of higher doses within 10 mm belong to its volume;
    /// the isodose is that part of it that lies nearer to them than to targets elsewhere.
    pub conformity: Option<f64>,
}

/// `V_d`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VolumeAt {
    /// Gray.
    pub dose_gy: f64,
    /// Fraction of the structure that gets as much.
    pub fraction: f64,
}

/// How a dose falls off around the targets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FallOff {
    /// Volume that gets half of the highest prescription, over that of all targets.
    pub r50: f64,
    /// Largest dose (D0.03cc) more than 2 cm from every target, gray; nothing where all of the patient is nearer.
    pub d2cm_gy: Option<f64>,
    /// Largest dose (D0.03cc) within 1 cm of the skin and not in a target, gray.
    pub first_cm_gy: Option<f64>,
}

/// Where the structures of a case lie on the grid of a dose.
#[derive(Clone, Debug)]
pub struct OnGrid<'a> {
    case: &'a Case,
    grid: Grid,
    /// For each structure what it takes of the voxels.
    parts: Vec<Occupancy>,
    /// Volume of each that lies beside the grid, cm3.
    aside_cm3: Vec<f64>,
    /// For each target what its index is of.
    treated: Vec<Option<Treated>>,
    /// All targets.
    targets: Occupancy,
    /// Voxels wholly in the patient that lie far from every target.
    far: Occupancy,
    /// Voxels wholly in the patient near the skin and not in a target.
    entry: Occupancy,
}

/// What the index of a target is of.
#[derive(Clone, Debug)]
struct Treated {
    /// All targets of its group that are prescribed as much or more.
    volume: Occupancy,
    /// Voxels of the patient that lie nearer to its group than to other targets; nothing where there are no others.
    around: Option<Occupancy>,
}

impl<'a> OnGrid<'a> {
    /// The structures of a case on this grid.
    pub fn new(case: &'a Case, grid: &Grid) -> Self {
        let on_grid = |mask: &Mask| Occupancy::of(grid, case.grid(), mask);
        let union = |requested: &dyn Fn(&Structure) -> bool| {
            let masks: Vec<&Mask> =
                case.structures().iter().filter(|s| requested(s)).map(|s| &s.mask).collect();
            on_grid(&Mask::from_fn(case.grid().len(), |i| masks.iter().any(|m| m.contains(i))))
        };
        let parts: Vec<Occupancy> = case.structures().iter().map(|s| on_grid(&s.mask)).collect();
        let targets = union(&|s: &Structure| s.role == Role::Target);
        let external = case.structures().iter().position(|s| s.role == Role::External);
        let (far, entry) =
            external.map(|at| far_and_entry(grid, case.grid(), &parts[at], &targets)).unwrap_or_default();
        let groups = groups(case);
        let treated = |structure: &Structure| {
            let least = prescribed(case, structure)?;
            let group = groups.iter().find(|group| group.contains(&structure.name.as_str()))?;
            let is_in_group = |s: &Structure| group.contains(&s.name.as_str());
            let volume = union(&|s| is_in_group(s) && prescribed(case, s).is_some_and(|dose| dose >= least));
            let around = (groups.len() > 1).then(|| {
                let other = |s: &Structure| prescribed(case, s).is_some() && !is_in_group(s);
                nearer(grid, external.map(|at| &parts[at]), &union(&is_in_group), &union(&other))
            });
            Some(Treated { volume, around })
        };
        let treated = case.structures().iter().map(treated).collect();
        let outside_cm3 = |(structure, parts): (&Structure, &Occupancy)| {
            (case.volume_cm3(structure) - parts.volume_cm3(grid)).max(0.0)
        };
        let aside_cm3 = case.structures().iter().zip(&parts).map(outside_cm3).collect();
        Self { case, grid: *grid, parts, treated, aside_cm3, targets, far, entry }
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// What a dose (gray) gives the structures. The histogram of a whole patient takes a tenth of a second or more, so each
    /// is made once.
    pub fn evaluate(&self, gray: &[f32]) -> Evaluation<'a> {
        let histogram = |parts: &Occupancy| parts.histogram(&self.grid, gray).ok();
        let structures = self.case.structures();
        let whole = |(parts, aside_cm3): (&Occupancy, &f64)| match histogram(parts) {
            Some(dvh) if *aside_cm3 > ROUNDING_CM3 => Some(dvh.with_undosed(*aside_cm3)),
            None if *aside_cm3 > ROUNDING_CM3 => Dvh::weighted(&[0.0], &[*aside_cm3]).ok(),
            found => found,
        };
        let all: Vec<Option<Dvh>> = self.parts.iter().zip(&self.aside_cm3).map(whole).collect();
        let external = structures.iter().position(|s| s.role == Role::External);
        let body = external.and_then(|place| all[place].as_ref());
        let fall_off = || {
            let highest = self.case.prescription().iter().map(|p| p.dose_gy).fold(0.0, f64::max);
            let (body, targets) = (body?, histogram(&self.targets)?);
            let largest = |parts: &Occupancy| Some(histogram(parts)?.dose_at_volume(SMALL_CM3));
            (highest > 0.0).then(|| FallOff {
                r50: body.volume_at(0.5 * highest) * body.volume() / targets.volume(),
                d2cm_gy: largest(&self.far),
                first_cm_gy: largest(&self.entry),
            })
        };
        let fall_off = fall_off();
        let conformity = |(structure, treated): (&Structure, &Option<Treated>)| {
            let least_gy = COVERED * prescribed(self.case, structure)?;
            let Treated { volume, around } = treated.as_ref()?;
            let around = around.as_ref().and_then(histogram);
            Some(paddick_conformity(&histogram(volume)?, around.as_ref().or(body)?, least_gy))
        };
        let conformities: Vec<Option<f64>> = structures.iter().zip(&self.treated).map(conformity).collect();
        let voxels = self.parts.iter().map(|parts| parts.voxels().len());
        let (mut histograms, mut reported) = (Vec::new(), Vec::new());
        for (((structure, dvh), conformity), voxels) in
            structures.iter().zip(all).zip(conformities).zip(voxels)
        {
            if let Some(dvh) = dvh {
                histograms.push((structure, dvh));
                reported.push((conformity, voxels));
            }
        }
        Evaluation { case: self.case, histograms, reported, fall_off }
    }
}

/// What a dose gives the structures of a case.
#[derive(Clone, Debug)]
pub struct Evaluation<'a> {
    case: &'a Case,
    /// The histogram of each structure that has voxels, in the order of the case; volumes in cm3.
    pub histograms: Vec<(&'a Structure, Dvh)>,
    /// Paddick's index and the number of voxels of each of them.
    reported: Vec<(Option<f64>, usize)>,
    /// How the dose falls off; nothing where the case has no target or no prescription.
    pub fall_off: Option<FallOff>,
}

impl<'a> Evaluation<'a> {
    /// Figures of every structure that has voxels, with its volumes at these doses (gray).
    pub fn figures(&self, volumes_at_gy: &[f64]) -> Vec<StructureDose> {
        let of =
            |((structure, dvh), (conformity, voxels)): (&(&'a Structure, Dvh), &(Option<f64>, usize))| {
                let prescribed_gy = prescribed(self.case, structure);
                let volume =
                    |dose_gy: &f64| VolumeAt { dose_gy: *dose_gy, fraction: dvh.volume_at(*dose_gy) };
                StructureDose {
                    name: structure.name.clone(),
                    role: structure.role,
                    volume_cm3: self.case.volume_cm3(structure),
                    voxels: *voxels,
                    prescribed_gy,
                    d98_gy: dvh.dose_at(98.0),
                    d95_gy: dvh.dose_at(95.0),
                    d50_gy: dvh.dose_at(50.0),
                    d10_gy: dvh.dose_at(10.0),
                    d2_gy: dvh.dose_at(2.0),
                    mean_gy: dvh.mean(),
                    d003cc_gy: dvh.dose_at_volume(SMALL_CM3),
                    volumes: volumes_at_gy.iter().map(volume).collect(),
                    covered: prescribed_gy.map(|dose| dvh.volume_at(COVERED * dose)),
                    homogeneity: prescribed_gy.map(|_| dvh.homogeneity()).filter(|h| h.is_finite()),
                    conformity: *conformity,
                }
            };
        self.histograms.iter().zip(&self.reported).map(of).collect()
    }
}

/// Targets with a prescription, in groups of those that lie within 10 mm of each other, by name.
fn groups(case: &Case) -> Vec<Vec<&str>> {
    let targets: Vec<&Structure> =
        case.structures().iter().filter(|s| prescribed(case, s).is_some()).collect();
    if let [only] = targets[..] {
        return vec![vec![only.name.as_str()]];
    }
    let mut groups: Vec<(Vec<&str>, Vec<f32>)> = Vec::new();
    for target in targets {
        let is_near = |to_group: &Vec<f32>| target.mask.indices().any(|v| to_group[v] <= ONE_TARGET_MM);
        let mut distance = distances_mm(case.grid(), |voxel| target.mask.contains(voxel));
        let mut names = vec![target.name.as_str()];
        let (near, rest): (Vec<_>, Vec<_>) = groups.into_iter().partition(|(_, to)| is_near(to));
        for (others, to_others) in near {
            names.extend(others);
            distance.iter_mut().zip(to_others).for_each(|(own, other)| *own = own.min(other));
        }
        groups = rest;
        groups.push((names, distance));
    }
    groups.into_iter().map(|(names, _)| names).collect()
}

/// What of the patient lies nearer to some targets than to others.
fn nearer(grid: &Grid, patient: Option<&Occupancy>, own: &Occupancy, other: &Occupancy) -> Occupancy {
    let distances = |targets: &Occupancy| {
        let mut inside = vec![false; grid.len()];
        targets.voxels().iter().for_each(|v| inside[*v as usize] = true);
        distances_mm(grid, |voxel| inside[voxel])
    };
    let (to_own, to_other) = (distances(own), distances(other));
    let is_nearer = |voxel: u32| to_own[voxel as usize] <= to_other[voxel as usize];
    let Some(patient) = patient else { return Occupancy::default() };
    Occupancy {
        whole: patient.whole.iter().copied().filter(|voxel| is_nearer(*voxel)).collect(),
        border: patient.border.iter().copied().filter(|border| is_nearer(border.voxel)).collect(),
    }
}

/// Structures of which a part lies outside of the outline of the patient, where no dose is computed: name, that volume and
/// the whole volume, cm3. Structures that are neither targets nor organs, such as a couch, are not among them.
pub fn leaving_outline(case: &Case) -> Vec<(&str, f64, f64)> {
    let Some(external) = case.external() else { return Vec::new() };
    let voxel_cm3 = case.grid().voxel_cm3();
    let judged = |s: &&Structure| !matches!(s.role, Role::External | Role::Other);
    let outside = |s: &Structure| s.mask.indices().filter(|voxel| !external.mask.contains(*voxel)).count();
    let leaving = case.structures().iter().filter(judged).map(|s| (s, outside(s))).filter(|(_, n)| *n > 0);
    leaving.map(|(s, n)| (s.name.as_str(), n as f64 * voxel_cm3, case.volume_cm3(s))).collect()
}

/// Voxels wholly in the patient: those far from the targets, and those near the skin and in no target. Where the image
/// ends there is no skin.
fn far_and_entry(
    grid: &Grid,
    image: &Grid,
    external: &Occupancy,
    targets: &Occupancy,
) -> (Occupancy, Occupancy) {
    let mut in_target = vec![false; grid.len()];
    targets.voxels().iter().for_each(|v| in_target[*v as usize] = true);
    let mut in_patient = vec![false; grid.len()];
    external.voxels().iter().for_each(|v| in_patient[*v as usize] = true);
    let to_target = distances_mm(grid, |voxel| in_target[voxel]);
    let to_air = depths_mm(grid, image, |voxel| in_patient[voxel]);
    let chosen = |requested: &dyn Fn(usize) -> bool| {
        let whole = external.whole.iter().copied().filter(|v| requested(*v as usize)).collect();
        Occupancy { whole, border: Vec::new() }
    };
    let far = chosen(&|voxel| to_target[voxel] > FAR_MM);
    (far, chosen(&|voxel| to_air[voxel] <= ENTRY_MM && !in_target[voxel]))
}

/// A dose on one grid, brought to another, linear between voxels.
pub fn brought_to(grid: &Grid, from: &Grid, gray: &[f32]) -> Vec<f32> {
    (0..grid.len()).map(|i| from.value_at(gray, grid.centre_mm(grid.voxel(i)))).collect()
}

fn prescribed(case: &Case, structure: &Structure) -> Option<f64> {
    let own = case.prescription().iter().find(|p| p.structure == structure.name);
    own.filter(|_| structure.role == Role::Target).map(|p| p.dose_gy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_patient::case::phantom;

    #[test]
    fn a_dose_that_is_the_prescription_in_the_target_alone_is_perfect() {
        // On voxels of a third of the image's, which no border of a structure cuts.
        let case = phantom(0).unwrap();
        let image = case.grid();
        let grid = Grid {
            counts: image.counts.map(|n| 3 * n),
            spacing_mm: image.spacing_mm.map(|mm| mm / 3.0),
            origin_mm: std::array::from_fn(|axis| image.origin_mm[axis] - image.spacing_mm[axis] / 3.0),
        };
        let on_grid = OnGrid::new(&case, &grid);
        let mut gray = vec![0.0_f32; grid.len()];
        let ptv = Occupancy::of(&grid, image, &case.structure("PTV").unwrap().mask);
        assert!(ptv.border.is_empty());
        ptv.whole.iter().for_each(|v| gray[*v as usize] = 78.0);
        let evaluation = on_grid.evaluate(&gray);
        let figures = evaluation.figures(&[20.0, 78.0]);
        assert_eq!(figures.len(), 7);
        let ptv = &figures[1];
        assert_eq!((ptv.d98_gy, ptv.d003cc_gy, ptv.covered), (78.0, 78.0, Some(1.0)));
        assert!((ptv.mean_gy - 78.0).abs() < 1e-9 && (ptv.conformity.unwrap() - 1.0).abs() < 1e-9, "{ptv:?}");
        assert_eq!(
            (ptv.homogeneity, &ptv.volumes[1]),
            (Some(0.0), &VolumeAt { dose_gy: 78.0, fraction: 1.0 })
        );
        let head = figures.iter().find(|f| f.name == "FemoralHeadL").unwrap();
        assert_eq!((head.d003cc_gy, head.conformity, head.prescribed_gy), (0.0, None, None));
        let fall_off = evaluation.fall_off.unwrap();
        assert!((fall_off.r50 - 1.0).abs() < 1e-9, "{fall_off:?}");
        assert_eq!((fall_off.d2cm_gy, fall_off.first_cm_gy), (Some(0.0), Some(0.0)));
    }

    /// A block of water with an outline that ends along z, and balls as targets of 50 Gy.
    fn block(outline_mm: f64, targets: &[(&str, [f64; 3], f64)]) -> Case {
        use stillpoint_patient::case::{CaseParts, Prescription};
        let grid = Grid { counts: [60, 40, 40], spacing_mm: [4.0; 3], origin_mm: [-118.0, -78.0, -78.0] };
        let mask = |inside: &dyn Fn([f64; 3]) -> bool| {
            Mask::from_fn(grid.len(), |i| inside(grid.centre_mm(grid.voxel(i))))
        };
        let ball = |centre: &[f64; 3], radius: f64| {
            mask(&|at| {
                (0..3).map(|k| (at[k] - centre[k]) * (at[k] - centre[k])).sum::<f64>() <= radius * radius
            })
        };
        let mut structures = vec![Structure {
            name: "Body".into(),
            role: Role::External,
            mask: mask(&|at| at[2] < outline_mm && at[0].abs() < 110.0 && at[1].abs() < 70.0),
        }];
        structures.extend(targets.iter().map(|(name, centre, radius)| Structure {
            name: (*name).into(),
            role: Role::Target,
            mask: ball(centre, *radius),
        }));
        let prescription =
            targets.iter().map(|(name, ..)| Prescription { structure: (*name).into(), dose_gy: 50.0 });
        Case::new(CaseParts {
            name: "block".into(),
            grid,
            hu: vec![0; grid.len()],
            structures,
            isocentre_mm: None,
            prescription: prescription.collect(),
            fractions: Some(25),
            reference_dose_gy: None,
            uids: None,
            provenance: String::new(),
        })
        .unwrap()
    }

    /// Its dose is computed inside the outline alone, and was judged there alone.
    #[test]
    fn a_target_that_leaves_the_outline_is_judged_over_all_of_it() {
        use crate::dose::{DoseParams, Machine};
        use crate::recompute::Recompute;
        let case = block(8.0, &[("PTV", [0.0; 3], 26.0)]);
        let ptv = case.structure("PTV").unwrap();
        let left = leaving_outline(&case);
        let (name, outside_cm3, whole_cm3) = left[0];
        assert!(left.len() == 1 && name == "PTV" && (whole_cm3 - case.volume_cm3(ptv)).abs() < 1e-9);
        let inside = 1.0 - outside_cm3 / whole_cm3;
        assert!((0.5..0.8).contains(&inside), "{inside}");
        let params = DoseParams::over(case.grid(), 4.0);
        let recompute = Recompute::with_spacing(&case, Machine::shipped().unwrap(), &params, 2.0).unwrap();
        let body = Occupancy::of(recompute.grid(), case.grid(), &case.external().unwrap().mask);
        let dosed = |grid: &Grid, voxels: &Occupancy| {
            let mut gray = vec![0.0; grid.len()];
            voxels.voxels().iter().for_each(|v| gray[*v as usize] = 50.0);
            OnGrid::new(&case, grid).evaluate(&gray).figures(&[])
        };
        // On the grid of the plan, and on one that ends with the outline.
        let image = *case.grid();
        let cut = Grid { counts: [image.counts[0], image.counts[1], 22], ..image };
        let cut_body = Occupancy::of(&cut, &image, &case.external().unwrap().mask);
        for figures in [dosed(recompute.grid(), &body), dosed(&cut, &cut_body)] {
            let ptv = figures.iter().find(|f| f.name == "PTV").unwrap();
            assert!((ptv.covered.unwrap() - inside).abs() < 0.02, "{:?} {inside}", ptv.covered);
            assert_eq!(ptv.d98_gy, 0.0);
            assert!((ptv.mean_gy - 50.0 * inside).abs() < 1.0, "{}", ptv.mean_gy);
        }
    }

    #[test]
    fn the_isodose_around_another_target_is_no_fault_of_a_target() {
        let case = block(500.0, &[("PTV_1", [70.0, 0.0, 0.0], 14.0), ("PTV_2", [-70.0, 0.0, 0.0], 14.0)]);
        assert!(leaving_outline(&case).is_empty());
        let grid = *case.grid();
        let dose = |of: &dyn Fn(usize) -> bool| {
            let gray: Vec<f32> = (0..grid.len()).map(|i| if of(i) { 50.0 } else { 0.0 }).collect();
            let figures = OnGrid::new(&case, &grid).evaluate(&gray).figures(&[]);
            ["PTV_1", "PTV_2"]
                .map(|name| figures.iter().find(|f| f.name == name).unwrap().conformity.unwrap())
        };
        let [one, two] = ["PTV_1", "PTV_2"].map(|name| &case.structure(name).unwrap().mask);
        assert!(dose(&|i| one.contains(i) || two.contains(i)).iter().all(|index| (index - 1.0).abs() < 1e-6));
        // Dose that spills around one is a fault of that one alone.
        let spilt = |i: usize| {
            let [x, y, z] = grid.centre_mm(grid.voxel(i));
            libm::sqrt((x + 70.0) * (x + 70.0) + y * y + z * z) < 22.0
        };
        let [first, second] = dose(&|i| one.contains(i) || spilt(i));
        assert!((first - 1.0).abs() < 1e-6 && second < 0.5, "{first} {second}");
    }

    #[test]
    fn figures_hardly_depend_on_the_grid_where_the_dose_is_known_everywhere() {
        // A dose that falls off around the isocentre as steeply as a penumbra.
        let case = phantom(0).unwrap();
        let centre = case.isocentre_mm();
        let dose = |[x, y, z]: [f64; 3]| {
            let r = libm::hypot(libm::hypot(x - centre[0], y - centre[1]), z - centre[2]);
            (80.0 / (1.0 + libm::exp((r - 32.0) / 3.0))) as f32
        };
        let figures = |spacing_mm: f64| {
            let counts = [410.0, 250.0, 200.0].map(|mm: f64| (mm / spacing_mm) as usize);
            let origin_mm: [f64; 3] = std::array::from_fn(|axis| {
                let image = case.grid();
                image.origin_mm[axis] + 0.5 * (image.counts[axis] as f64 * image.spacing_mm[axis])
                    - 0.5 * counts[axis] as f64 * spacing_mm
            });
            let grid = Grid { counts, spacing_mm: [spacing_mm; 3], origin_mm };
            let gray: Vec<f32> = (0..grid.len()).map(|i| dose(grid.centre_mm(grid.voxel(i)))).collect();
            OnGrid::new(&case, &grid).evaluate(&gray).figures(&[40.0])
        };
        for (coarse, fine) in figures(2.0).iter().zip(figures(1.0)).filter(|(f, _)| f.role != Role::External)
        {
            let read: [fn(&StructureDose) -> f64; 5] =
                [|f| f.d98_gy, |f| f.d95_gy, |f| f.d50_gy, |f| f.d2_gy, |f| f.d003cc_gy];
            for of in read {
                assert!((of(coarse) - of(&fine)).abs() < 0.3, "{coarse:?} {fine:?}");
            }
            assert!(
                (coarse.volumes[0].fraction - fine.volumes[0].fraction).abs() < 0.004,
                "{coarse:?} {fine:?}"
            );
        }
    }

    #[test]
    fn a_linear_dose_is_the_same_on_another_grid() {
        let from = Grid { counts: [9, 9, 9], spacing_mm: [3.0; 3], origin_mm: [0.0; 3] };
        let to = Grid { counts: [4, 4, 4], spacing_mm: [5.0; 3], origin_mm: [2.0; 3] };
        let dose = |[x, y, z]: [f64; 3]| (x + 2.0 * y + 3.0 * z) as f32;
        let gray: Vec<f32> = (0..from.len()).map(|i| dose(from.centre_mm(from.voxel(i)))).collect();
        for (i, value) in brought_to(&to, &from, &gray).into_iter().enumerate() {
            assert!((value - dose(to.centre_mm(to.voxel(i)))).abs() < 1e-4);
        }
    }
}
