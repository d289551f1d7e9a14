//! What a dose does to each structure of a case, as plans are judged by.

use serde::Serialize;

use crate::Grid;
use crate::case::{Case, Mask, Role, Structure};
use crate::fluence::voxels_on;
use crate::metrics::{Dvh, paddick_conformity};

/// Dose that counts as the prescribed one in coverage and conformity.
const COVERED: f64 = 0.95;

/// Figures of one structure. Doses are in gray, volumes without a unit are fractions of the structure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StructureDose {
    /// Its name.
    pub name: String,
    /// What it is to the plan.
    pub role: Role,
    /// Its volume in the image, cm3.
    pub volume_cm3: f64,
    /// Its voxels on the dose grid, which the figures are of.
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
    /// Largest dose.
    pub max_gy: f64,
    /// Doses, and the fraction that gets at least each.
    pub volumes: Vec<VolumeAt>,
    /// Of a target: the fraction that gets 95 % of its prescription.
    pub covered: Option<f64>,
    /// Of a target: `(D2 - D98) / D50`.
    pub homogeneity: Option<f64>,
    /// Of a target: Paddick's index of 95 % of its prescription. Targets of higher doses belong to its volume.
    pub conformity: Option<f64>,
}

/// `V_d`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct VolumeAt {
    /// Gray.
    pub dose_gy: f64,
    /// Fraction of the structure that gets as much.
    pub fraction: f64,
}

/// Where the structures of a case lie on its dose grid.
#[derive(Clone, Debug)]
pub struct OnGrid<'a> {
    case: &'a Case,
    /// For each structure its voxels.
    voxels: Vec<Vec<u32>>,
    /// For each target those of all targets that are prescribed as much or more.
    treated: Vec<Option<Vec<u32>>>,
}

impl<'a> OnGrid<'a> {
    /// The structures of a case on this dose grid.
    pub fn new(case: &'a Case, grid: &Grid) -> Self {
        let on_grid = |mask: &Mask| voxels_on(grid, case.grid(), mask);
        let treated = |structure: &Structure| {
            let least = prescribed(case, structure)?;
            let as_much = |s: &&Structure| prescribed(case, s).is_some_and(|dose| dose >= least);
            let masks: Vec<&Mask> = case.targets().filter(as_much).map(|s| &s.mask).collect();
            Some(on_grid(&Mask::from_fn(case.grid().len(), |i| masks.iter().any(|m| m.contains(i)))))
        };
        Self {
            case,
            voxels: case.structures().iter().map(|s| on_grid(&s.mask)).collect(),
            treated: case.structures().iter().map(treated).collect(),
        }
    }

    /// The histogram of each structure that has voxels, in the order of the case.
    pub fn histograms(&self, gray: &[f32]) -> Vec<(&'a Structure, Dvh)> {
        let structures = self.case.structures().iter().zip(&self.voxels);
        structures.filter_map(|(s, voxels)| Some((s, histogram(gray, voxels)?))).collect()
    }

    /// Figures of every structure that has voxels, with its volumes at these doses (gray).
    pub fn figures(&self, gray: &[f32], volumes_at_gy: &[f64]) -> Vec<StructureDose> {
        let body = self.case.external().and_then(|external| {
            let place = self.case.structures().iter().position(|s| s.name == external.name)?;
            histogram(gray, &self.voxels[place])
        });
        let of = |((structure, voxels), treated): ((&Structure, &Vec<u32>), &Option<Vec<u32>>)| {
            let dvh = histogram(gray, voxels)?;
            let prescribed_gy = prescribed(self.case, structure);
            let conformity = || {
                let treated = histogram(gray, treated.as_ref()?)?;
                Some(paddick_conformity(&treated, body.as_ref()?, COVERED * prescribed_gy?))
            };
            let volume = |dose_gy: &f64| VolumeAt { dose_gy: *dose_gy, fraction: dvh.volume_at(*dose_gy) };
            Some(StructureDose {
                name: structure.name.clone(),
                role: structure.role,
                volume_cm3: self.case.volume_cm3(structure),
                voxels: voxels.len(),
                prescribed_gy,
                d98_gy: dvh.dose_at(98.0),
                d95_gy: dvh.dose_at(95.0),
                d50_gy: dvh.dose_at(50.0),
                d10_gy: dvh.dose_at(10.0),
                d2_gy: dvh.dose_at(2.0),
                mean_gy: dvh.mean(),
                max_gy: dvh.max(),
                volumes: volumes_at_gy.iter().map(volume).collect(),
                covered: prescribed_gy.map(|dose| dvh.volume_at(COVERED * dose)),
                homogeneity: prescribed_gy.map(|_| dvh.homogeneity()).filter(|h| h.is_finite()),
                conformity: conformity(),
            })
        };
        self.case.structures().iter().zip(&self.voxels).zip(&self.treated).filter_map(of).collect()
    }
}

/// A dose on one grid, brought to another, linear between voxels.
pub fn brought_to(grid: &Grid, from: &Grid, gray: &[f32]) -> Vec<f32> {
    (0..grid.len()).map(|i| from.value_at(gray, grid.centre_mm(grid.voxel(i)))).collect()
}

fn prescribed(case: &Case, structure: &Structure) -> Option<f64> {
    let own = case.prescription().iter().find(|p| p.structure == structure.name);
    own.filter(|_| structure.role == Role::Target).map(|p| p.dose_gy)
}

fn histogram(gray: &[f32], voxels: &[u32]) -> Option<Dvh> {
    let doses: Vec<f64> =
        voxels.iter().filter_map(|v| gray.get(*v as usize)).map(|d| f64::from(*d)).collect();
    Dvh::new(&doses).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::case::phantom;
    use crate::dose::DoseParams;

    #[test]
    fn a_dose_that_is_the_prescription_in_the_target_alone_is_perfect() {
        let case = phantom(0).unwrap();
        let grid = DoseParams::over(case.grid(), 5.0).grid;
        let on_grid = OnGrid::new(&case, &grid);
        let mut gray = vec![0.0_f32; grid.len()];
        let ptv = &case.structure("PTV").unwrap().mask;
        voxels_on(&grid, case.grid(), ptv).into_iter().for_each(|v| gray[v as usize] = 78.0);
        let figures = on_grid.figures(&gray, &[20.0, 78.0]);
        assert_eq!(figures.len(), 7);
        let ptv = &figures[1];
        assert_eq!((ptv.d98_gy, ptv.mean_gy, ptv.covered), (78.0, 78.0, Some(1.0)));
        assert_eq!((ptv.homogeneity, ptv.conformity), (Some(0.0), Some(1.0)));
        assert_eq!(ptv.volumes[1], VolumeAt { dose_gy: 78.0, fraction: 1.0 });
        let head = figures.iter().find(|f| f.name == "FemoralHeadL").unwrap();
        assert_eq!((head.max_gy, head.conformity, head.prescribed_gy), (0.0, None, None));
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
