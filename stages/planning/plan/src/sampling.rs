//! The points whose dose is optimised.
//!
//! Doses change within millimetres at the border of a target and hardly along the rest of the patient. So the points are the
//! voxels of a fine lattice at the borders of targets, every second of them along each axis in and around targets and in
//! organs, and every third elsewhere. Where the outline has a part so thin that none of these is in it, the part has points of
//! its own, so that no dose is left free. Each point stands for the volume of its zone over the points of it.

use std::collections::BTreeSet;

use crate::distance::{depths_mm, distances_mm};
use crate::dose::density::voxels_inside;
use crate::dose::engine::{check_bixel, check_grid};
use crate::dose::{DoseEngine, DoseError, DoseParams};
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Mask, Role, Structure};

/// Spacings of the lattice from the border of a target within which every voxel of it is a point.
const BORDER: f32 = 1.01;
/// Distance from the border of a target within which every second voxel is a point, mm.
const NEAR_MM: f32 = 20.0;
/// Structures smaller than this have every voxel as a point, cm3.
const SMALL_CM3: f64 = 5.0;
/// Step from point to point farther from targets than that, in voxels along each axis.
const FAR: u8 = 3;
/// The same where doses from all angles must be at hand.
const FAR_AND_FEW: u8 = 5;
/// Number of zones that any rule has.
const ZONES: usize = FAR_AND_FEW as usize + 1;
/// Points of the lattice along the width of a bixel, at least.
const POINTS_A_BIXEL: f64 = 4.0;

/// Where the points of a case are.
#[derive(Clone, Debug)]
pub struct Sampling {
    grid: Grid,
    rule: Rule,
    /// Voxels of the lattice that are points, rising; every voxel where there are none.
    points: Option<Vec<u32>>,
    /// For each structure of the case the voxels of the lattice in it, rising.
    pub(crate) members: Vec<Vec<u32>>,
    /// Points in thin parts of the outline, rising.
    thin: Vec<u32>,
    /// For each structure whether each of its voxels is a point.
    small: Vec<bool>,
    /// For each voxel of the lattice its zone: the step from point to point, in voxels.
    zones: Vec<u8>,
    /// For each voxel of the lattice its distance to the nearest target, mm.
    pub(crate) to_target_mm: Vec<f32>,
}

/// The rule by which voxels of the lattice are points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rule {
    /// By steps that grow with the distance from the borders of targets.
    Borders,
    /// The same with half of these points in and around targets and in organs, and longer steps elsewhere.
    Sparse,
    /// By the role of the structure: all of targets, half of organs and of what is near a target, one in eighteen of the rest.
    Thinned,
}

/// Points with what they stand for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// Rows of the dose matrices, rising.
    pub rows: Vec<u32>,
    /// Voxels of the lattice that each stands for.
    pub volumes: Vec<f64>,
    /// Distance of each to the nearest target, mm.
    pub to_target_mm: Vec<f64>,
}

impl Sampling {
    /// Every voxel of this grid.
    pub fn every_voxel(case: &Case, grid: &Grid) -> Self {
        let members = members(case, grid);
        let to_target_mm = distances_mm(grid, inside(case, grid, &members));
        let small = vec![true; members.len()];
        let (thin, zones) = (Vec::new(), vec![1; grid.len()]);
        Self { grid: *grid, rule: Rule::Borders, points: None, members, thin, small, zones, to_target_mm }
    }

    /// Every voxel of a grid of this spacing around the image.
    ///
    /// Errors: a spacing out of range, or too many voxels.
    pub fn every_voxel_of(case: &Case, spacing_mm: f64) -> Result<Self, DoseError> {
        let grid = DoseParams::over(case.grid(), spacing_mm).grid;
        check_grid("the dose grid", &grid)?;
        Ok(Self::every_voxel(case, &grid))
    }

    /// Few voxels of a grid of this spacing, for searches on many patients: every voxel of targets, every second one of
    /// organs and within 20 mm of a target, and one in eighteen elsewhere.
    ///
    /// Errors: a spacing out of range, or too many voxels.
    pub fn thinned(case: &Case, spacing_mm: f64) -> Result<Self, DoseError> {
        let mut sampling = Self::every_voxel_of(case, spacing_mm)?;
        sampling.rule = Rule::Thinned;
        sampling.choose_points(case);
        Ok(sampling)
    }

    /// Points at most `spacing_mm` apart in and around targets, half of that at their borders, for bixels of this width: at
    /// least two across a bixel, four at the borders.
    ///
    /// Errors: a spacing or a width out of range, or too many voxels.
    pub fn new(case: &Case, spacing_mm: f64, bixel_mm: f64) -> Result<Self, DoseError> {
        Self::at_borders(case, spacing_mm, bixel_mm, Rule::Borders)
    }

    /// The same with half of these points in and around targets and in organs, and about a fifth elsewhere: for what needs the
    /// doses from all angles at hand.
    ///
    /// Errors: as above.
    pub fn sparse(case: &Case, spacing_mm: f64, bixel_mm: f64) -> Result<Self, DoseError> {
        Self::at_borders(case, spacing_mm, bixel_mm, Rule::Sparse)
    }

    fn at_borders(case: &Case, spacing_mm: f64, bixel_mm: f64, rule: Rule) -> Result<Self, DoseError> {
        check_grid("the dose grid", &DoseParams::over(case.grid(), spacing_mm).grid)?;
        check_bixel(bixel_mm)?;
        let fine_mm = (0.5 * spacing_mm).min(bixel_mm / POINTS_A_BIXEL);
        let grid = DoseParams::over(case.grid(), fine_mm).grid;
        check_grid("the lattice of points", &grid)?;
        let members = members(case, &grid);
        let to_target_mm = distances_mm(&grid, inside(case, &grid, &members));
        let at_border = borders(case, &grid, &members);
        let to_border_mm = distances_mm(&grid, |voxel| at_border.contains(voxel));
        let far = if rule == Rule::Sparse { FAR_AND_FEW } else { FAR };
        let zone = |(border, outside): (&f32, &f32)| {
            if *border <= BORDER * fine_mm as f32 {
                1
            } else if *border <= NEAR_MM || *outside == 0.0 {
                2
            } else {
                far
            }
        };
        let zones: Vec<u8> = to_border_mm.iter().zip(&to_target_mm).map(zone).collect();
        let small = case.structures().iter().map(|s| case.volume_cm3(s) < SMALL_CM3).collect();
        let thin = Vec::new();
        let mut sampling = Self { grid, rule, points: None, members, thin, small, zones, to_target_mm };
        sampling.thin = sampling.thin_parts(case);
        sampling.choose_points(case);
        Ok(sampling)
    }

    fn choose_points(&mut self, case: &Case) {
        let mut points: Vec<u32> = Vec::new();
        for (place, structure) in case.structures().iter().enumerate() {
            let all = &self.members[place];
            points.extend(all.iter().filter(|v| self.is_point(place, structure, **v)));
        }
        points.sort_unstable();
        points.dedup();
        self.points = Some(points);
    }

    /// The lattice.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Depth of each voxel of the lattice below the skin of this outline, mm.
    pub(crate) fn depths_mm(&self, case: &Case, outline: &Structure) -> Vec<f32> {
        let place = case.structures().iter().position(|s| s.name == outline.name);
        let mut inside = vec![false; self.grid.len()];
        place.iter().flat_map(|place| &self.members[*place]).for_each(|v| inside[*v as usize] = true);
        depths_mm(&self.grid, case.grid(), |voxel| inside[voxel])
    }

    /// Number of points: rows of the dose matrices.
    pub fn rows(&self) -> usize {
        self.points.as_ref().map_or(self.grid.len(), Vec::len)
    }

    /// An engine of the lattice that gives dose to the points alone.
    pub fn engine(&self, engine: &DoseEngine) -> DoseEngine {
        match &self.points {
            Some(points) => engine.sampled(points.clone()),
            None => engine.clone(),
        }
    }

    /// The points of a structure among these voxels of the lattice, which are in it. The volume of a zone without points
    /// goes to the others.
    pub fn points(&self, place: usize, structure: &Structure, voxels: &[u32]) -> Points {
        let mut found = Points::default();
        let (mut all, mut chosen) = ([0.0; ZONES], [0.0; ZONES]);
        let mut zones = Vec::new();
        for &voxel in voxels {
            let zone = self.zone(structure, voxel);
            all[zone] += 1.0;
            if self.is_point(place, structure, voxel)
                && let Some(row) = self.row_of(voxel)
            {
                chosen[zone] += 1.0;
                zones.push(zone);
                found.rows.push(row);
                found.to_target_mm.push(f64::from(self.to_target_mm[voxel as usize]));
            }
        }
        found.volumes = zones.iter().map(|zone| all[*zone] / chosen[*zone]).collect();
        found
    }

    fn row_of(&self, voxel: u32) -> Option<u32> {
        match &self.points {
            Some(points) => points.binary_search(&voxel).ok().map(|row| row as u32),
            None => Some(voxel),
        }
    }

    /// The zone of a voxel as a part of this structure. The points of a zone stand for the volume of it.
    fn zone(&self, structure: &Structure, voxel: u32) -> usize {
        match (self.rule, structure.role) {
            (Rule::Borders | Rule::Sparse, _) => usize::from(self.zones[voxel as usize]),
            (Rule::Thinned, Role::Target) => 0,
            (Rule::Thinned, Role::Organ) => 1,
            (Rule::Thinned, _) if self.to_target_mm[voxel as usize] <= NEAR_MM => 1,
            (Rule::Thinned, _) => 2,
        }
    }

    fn is_point(&self, place: usize, structure: &Structure, voxel: u32) -> bool {
        if self.rule == Rule::Thinned {
            let [x, y, z] = self.grid.voxel(voxel as usize);
            return match self.zone(structure, voxel) {
                0 => true,
                1 => (x + y + z) % 2 == 0,
                _ => x % 3 == 0 && y % 3 == 0 && z % 2 == 0,
            };
        }
        (self.is_at_step(place, structure, voxel) && self.is_chosen(place, structure, voxel))
            || (structure.role == Role::External && self.thin.binary_search(&voxel).is_ok())
    }

    /// Whether a voxel is one of those that are a step apart.
    fn is_at_step(&self, place: usize, structure: &Structure, voxel: u32) -> bool {
        let step = self.step(place, structure, voxel);
        self.grid.voxel(voxel as usize).iter().all(|place| place % step == 0)
    }

    /// Whether a voxel that is at a step is a point where every second one is: like the squares of one colour of a chessboard.
    fn is_chosen(&self, place: usize, structure: &Structure, voxel: u32) -> bool {
        let step = self.step(place, structure, voxel);
        let is_every = self.rule != Rule::Sparse || self.small[place] || step == usize::from(FAR_AND_FEW);
        is_every || self.grid.voxel(voxel as usize).iter().map(|place| place / step).sum::<usize>() % 2 == 0
    }

    fn step(&self, place: usize, structure: &Structure, voxel: u32) -> usize {
        let zone = usize::from(self.zones[voxel as usize]);
        match structure.role {
            _ if self.small[place] => 1,
            Role::External => zone,
            _ => zone.min(2),
        }
    }

    /// The first voxel of the outline in each block between points whose corner, where the point would be, is not in it.
    fn thin_parts(&self, case: &Case) -> Vec<u32> {
        let mut parts: Vec<u32> = Vec::new();
        let [nx, ny, _] = self.grid.counts;
        for (place, structure) in case.structures().iter().enumerate() {
            if structure.role != Role::External {
                continue;
            }
            let own = &self.members[place];
            let mut begun: BTreeSet<usize> = BTreeSet::new();
            for &voxel in own {
                let step = self.step(place, structure, voxel);
                let [x, y, z] = self.grid.voxel(voxel as usize).map(|at| at / step * step);
                let corner = x + nx * (y + ny * z);
                let has_point = own.binary_search(&(corner as u32)).is_ok()
                    && self.is_at_step(place, structure, corner as u32);
                if !has_point && begun.insert(corner) {
                    parts.push(voxel);
                }
            }
        }
        parts.sort_unstable();
        parts.dedup();
        parts
    }
}

fn members(case: &Case, grid: &Grid) -> Vec<Vec<u32>> {
    case.structures().iter().map(|s| voxels_inside(case.grid(), &s.mask, grid)).collect()
}

/// Whether a voxel is in any target.
fn inside(case: &Case, grid: &Grid, members: &[Vec<u32>]) -> impl Fn(usize) -> bool {
    let mut inside = vec![false; grid.len()];
    let targets = case.structures().iter().zip(members).filter(|(s, _)| s.role == Role::Target);
    targets.for_each(|(_, voxels)| voxels.iter().for_each(|v| inside[*v as usize] = true));
    move |voxel| inside[voxel]
}

/// Voxels of targets beside voxels that are not in them.
fn borders(case: &Case, grid: &Grid, members: &[Vec<u32>]) -> Mask {
    let mut at_border = vec![false; grid.len()];
    let [nx, ny, _] = grid.counts;
    for (_, voxels) in case.structures().iter().zip(members).filter(|(s, _)| s.role == Role::Target) {
        let mut own = vec![false; grid.len()];
        voxels.iter().for_each(|v| own[*v as usize] = true);
        for voxel in voxels.iter().map(|v| *v as usize) {
            let place = grid.voxel(voxel);
            let alone = |axis: usize, stride: usize| {
                place[axis] == 0
                    || place[axis] + 1 == grid.counts[axis]
                    || !own[voxel - stride]
                    || !own[voxel + stride]
            };
            at_border[voxel] |= alone(0, 1) || alone(1, nx) || alone(2, nx * ny);
        }
    }
    Mask::from_fn(grid.len(), |voxel| at_border[voxel])
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_patient::case::phantom;

    #[test]
    fn points_are_dense_at_the_border_of_the_target_and_their_volumes_are_the_structures() {
        let case = phantom(0).unwrap();
        let (plans, arcs) =
            (Sampling::new(&case, 5.0, 10.0).unwrap(), Sampling::sparse(&case, 5.0, 10.0).unwrap());
        assert!(arcs.rows() < plans.rows() / 3, "{} of {} points", arcs.rows(), plans.rows());
        for sampling in [&plans, &arcs] {
            assert_eq!(sampling.grid().spacing_mm, [2.5; 3]);
            let every = Sampling::every_voxel(&case, sampling.grid());
            assert!(sampling.rows() < every.rows() / 10, "{} points", sampling.rows());
            for (place, structure) in case.structures().iter().enumerate() {
                let points = sampling.points(place, structure, &sampling.members[place]);
                let (volume, cm3) = (points.volumes.iter().sum::<f64>(), case.volume_cm3(structure));
                assert!((volume - sampling.members[place].len() as f64).abs() < 1e-6, "{}", structure.name);
                assert!(
                    (volume * sampling.grid().voxel_cm3() - cm3).abs() < 0.02 * cm3,
                    "{}",
                    structure.name
                );
                assert!(points.rows.windows(2).all(|pair| pair[0] < pair[1]));
                let own = plans.points(place, structure, &plans.members[place]).rows.len() as f64;
                let part = points.rows.len() as f64 / own;
                let is_dense = structure.role != Role::External && case.volume_cm3(structure) > SMALL_CM3;
                assert!(
                    sampling.rule == Rule::Borders || !is_dense || (0.45..0.55).contains(&part),
                    "{part}"
                );
            }
        }
    }

    /// A beam through a sliver of a shoulder had no point there, and gave it 115 Gy.
    #[test]
    fn every_block_of_the_outline_has_a_point() {
        let case = phantom(0).unwrap();
        let sampling = Sampling::new(&case, 5.0, 10.0).unwrap();
        let place = case.structures().iter().position(|s| s.role == Role::External).unwrap();
        let outline = &case.structures()[place];
        let far = || sampling.members[place].iter().filter(|v| sampling.zones[**v as usize] == 3);
        let block = |voxel: &u32| sampling.grid.voxel(*voxel as usize).map(|at| at / 3);
        let with_point: BTreeSet<_> = sampling.members[place]
            .iter()
            .filter(|v| sampling.is_point(place, outline, **v))
            .map(block)
            .collect();
        let without = far().filter(|voxel| !with_point.contains(&block(voxel))).count();
        assert_eq!(without, 0, "voxels in blocks without a point, of {}", far().count());
    }

    #[test]
    fn narrow_bixels_make_the_lattice_finer() {
        let case = phantom(0).unwrap();
        let spacing =
            |grid_mm, bixel_mm| Sampling::new(&case, grid_mm, bixel_mm).unwrap().grid().spacing_mm[0];
        assert_eq!([spacing(5.0, 10.0), spacing(5.0, 8.0), spacing(4.0, 20.0)], [2.5, 2.0, 2.0]);
        for [grid_mm, bixel_mm] in
            [[0.0, 10.0], [f64::NAN, 10.0], [5.0, 0.0], [5.0, f64::INFINITY], [0.11, 10.0]]
        {
            assert!(Sampling::new(&case, grid_mm, bixel_mm).is_err(), "{grid_mm} {bixel_mm}");
        }
    }
}
