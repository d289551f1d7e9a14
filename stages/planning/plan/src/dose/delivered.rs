//! The dose of a weighted beam to every voxel of the dose grid, without a matrix.
//!
//! The lateral dose depends only on where a voxel is seen on the isocentre plane. It is summed over the bixels once, on a
//! lattice of that plane, and each voxel takes the three components there times its own depth doses. So a fine grid costs
//! little: the same model as [`DoseEngine::beam`], at the price of one bixel for all. Pencils at the edge of the patient have
//! depth doses of their own ([`super::outline`]), so each of them is added by itself.

use super::angles::BeamAngles;
use super::beam::{Aim, BixelAxis, OBLIQUE, Voxels, depth_doses};
use super::depth::LitVoxel;
use super::engine::DoseEngine;
use super::error::DoseError;
use super::kernel::STEP_MM;
use super::machine::COMPONENTS;
use super::outline::{Carried, Pencil};
use super::superposition;
use stillpoint_patient::couch::Motion;

impl DoseEngine {
    /// Dose of a beam to the voxels of the dose grid, gray, by the weights of its bixels in the order of
    /// [`super::BeamInfluence::bixels_mm`]. A number is a gantry angle.
    ///
    /// Errors: an angle out of range, or weights that are not as many as the bixels.
    pub fn weighted_beam(
        &self,
        angles: impl Into<BeamAngles>,
        weights: &[f64],
    ) -> Result<Vec<f32>, DoseError> {
        let angles = self.checked_angles(angles)?;
        self.dose_of(Aim::new(self, angles)?, angles, weights)
    }

    /// Dose of a beam like that of [`DoseEngine::weighted_beam`], of bixels with these centres (x and z on the isocentre
    /// plane, mm) instead of those that the target needs.
    pub fn weighted_bixels(
        &self,
        angles: impl Into<BeamAngles>,
        bixels_mm: &[[f64; 2]],
        weights: &[f64],
    ) -> Result<Vec<f32>, DoseError> {
        let angles = self.checked_angles(angles)?;
        let mut aim = Aim::new(self, angles)?;
        aim.bixels_mm = bixels_mm.to_vec();
        self.dose_of(aim, angles, weights)
    }

    /// Dose of a beam like that of [`DoseEngine::weighted_bixels`] to a patient who moved like this in his frame. The beam
    /// stands still; doses are to the voxels that were planned, so rays cross the image in the frame that moved with it.
    ///
    /// Errors: also a motion that takes the dose grid to within 100 mm of the source.
    pub fn moved_bixels(
        &self,
        angles: impl Into<BeamAngles>,
        bixels_mm: &[[f64; 2]],
        weights: &[f64],
        motion: &Motion,
    ) -> Result<Vec<f32>, DoseError> {
        let angles = self.checked_angles(angles)?;
        let mut aim = Aim::at(self, angles, Some(motion))?;
        aim.bixels_mm = bixels_mm.to_vec();
        self.dose_of(aim, angles, weights)
    }

    fn dose_of(&self, aim: Aim, angles: BeamAngles, weights: &[f64]) -> Result<Vec<f32>, DoseError> {
        let (found, expected) = (weights.len(), aim.bixels_mm.len());
        if found != expected {
            return Err(DoseError::Weights { angles, expected, found });
        }
        let lit = aim.bixels_mm.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
        self.check_entry(angles, lit.map(|(place, _)| *place))?;
        if let Some(section) = self.superposition()? {
            let of = |(bixel_mm, weight): (&[f64; 2], &f64)| {
                (aim.centre_mm(*bixel_mm), *weight as f32 * aim.fluence(self, *bixel_mm))
            };
            let weighted = aim.bixels_mm.iter().zip(weights).filter(|(_, weight)| **weight > 0.0);
            let bixels: Vec<([f64; 2], f32)> = weighted.map(of).collect();
            return Ok(superposition::weighted(self, &aim.frame, section, &bixels));
        }
        let mut dose = vec![0.0; self.rows()];
        let (mut inside, mut edge) = (Vec::new(), Vec::new());
        for (bixel_mm, weight) in aim.bixels_mm.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
            let fluence = *weight as f32 * aim.fluence(self, *bixel_mm);
            match aim.pencil(self, *bixel_mm) {
                Pencil::Inside => inside.push((*bixel_mm, fluence)),
                Pencil::Edge(carried) => edge.push((*bixel_mm, fluence, carried)),
                Pencil::Outside => {}
            }
        }
        self.add_inside(&aim, &inside, &mut dose);
        self.add_edge(&aim, &edge, &mut dose);
        dose.iter_mut().for_each(|dose| *dose = dose.max(0.0));
        Ok(dose)
    }

    /// Adds the dose of pencils of which the kernel is all that there is to say.
    fn add_inside(&self, aim: &Aim, bixels: &[([f64; 2], f32)], dose: &mut [f32]) {
        let Some(plane) = Plane::new(self, aim, bixels) else { return };
        let grid = &self.params.grid;
        let mut lateral = Vec::new();
        let lit = self.voxels.iter().filter_map(|&row| {
            let beam_mm = aim.frame.beam_from_patient(grid.centre_mm(grid.voxel(row as usize)));
            lateral.push(plane.at(aim.frame.on_isocentre_plane(beam_mm))?);
            Some(LitVoxel { row, beam_mm })
        });
        let lit: Vec<LitVoxel> = lit.collect();
        let depth_dose = depth_doses(self, &aim.frame, &lit);
        for ((voxel, lateral), depth_dose) in lit.iter().zip(&lateral).zip(&depth_dose) {
            let sum: f32 = (0..COMPONENTS).map(|c| lateral[c] * depth_dose[c]).sum();
            dose[self.row_of(voxel.row) as usize] = sum;
        }
    }

    /// Adds the dose of pencils at the edge of the patient, one by one.
    fn add_edge(&self, aim: &Aim, bixels: &[([f64; 2], f32, Carried)], dose: &mut [f32]) {
        if bixels.is_empty() {
            return;
        }
        let places: Vec<[f64; 2]> = bixels.iter().map(|(place, ..)| *place).collect();
        let voxels = Voxels::near(self, &aim.frame, &places);
        let cutoff2 = (self.params.cutoff_mm * self.params.cutoff_mm) as f32;
        for (place, fluence, carried) in bixels {
            let axis = BixelAxis::new(*place, aim.frame.sad_mm());
            voxels.each_near(&axis, cutoff2, |voxel, offset| {
                let [y_mm, inverse_square] = voxels.along[voxel];
                let depth_dose = carried.holding(&voxels.depth_dose[voxel], y_mm, inverse_square);
                let lateral = aim.lateral(offset);
                let sum: f32 = (0..COMPONENTS).map(|c| lateral[c] * depth_dose[c]).sum();
                dose[voxels.row[voxel] as usize] += fluence * sum;
            });
        }
    }
}

/// Lateral dose of all bixels on the isocentre plane.
struct Plane {
    /// By z and then x.
    places: Vec<[f32; 4]>,
    counts: [usize; 2],
    /// The first place, mm.
    first_mm: [f64; 2],
}

impl Plane {
    /// Of bixels with their fluences; `None` where there are none.
    fn new(engine: &DoseEngine, aim: &Aim, bixels: &[([f64; 2], f32)]) -> Option<Self> {
        bixels.first()?;
        let reach_mm = engine.params.cutoff_mm * OBLIQUE;
        // Upon the samples of the kernels, so that hardly anything is interpolated twice.
        let phase_mm = aim.phase_mm();
        let ends = |axis: usize| {
            let places = || bixels.iter().map(|(bixel, _)| bixel[axis]);
            let low = ((places().fold(f64::INFINITY, f64::min) - reach_mm - phase_mm) / STEP_MM).floor();
            let high = ((places().fold(f64::NEG_INFINITY, f64::max) + reach_mm - phase_mm) / STEP_MM).ceil();
            (low * STEP_MM + phase_mm, (high - low) as usize + 1)
        };
        let [(x, across), (z, along)] = [ends(0), ends(1)];
        let mut plane =
            Self { places: vec![[0.0; 4]; across * along], counts: [across, along], first_mm: [x, z] };
        for (bixel, fluence) in bixels {
            plane.add(engine, aim, *bixel, *fluence, reach_mm);
        }
        Some(plane)
    }

    fn add(&mut self, engine: &DoseEngine, aim: &Aim, bixel: [f64; 2], weight: f32, reach_mm: f64) {
        let axis = BixelAxis::new(bixel, aim.frame.sad_mm());
        let cutoff2 = (engine.params.cutoff_mm * engine.params.cutoff_mm) as f32;
        let range = |k: usize| {
            let place = |mm: f64| (mm - self.first_mm[k]) / STEP_MM;
            let low = place(bixel[k] - reach_mm).max(0.0) as usize;
            low..(place(bixel[k] + reach_mm).ceil() as usize + 1).min(self.counts[k])
        };
        let (across, along) = (range(0), range(1));
        for j in along {
            let z = (self.first_mm[1] + j as f64 * STEP_MM) as f32;
            let row = &mut self.places[j * self.counts[0]..(j + 1) * self.counts[0]];
            for i in across.clone() {
                let x = (self.first_mm[0] + i as f64 * STEP_MM) as f32;
                let offset = axis.offset([x, z]);
                if offset[0] * offset[0] + offset[1] * offset[1] <= cutoff2 {
                    let lateral = aim.lateral(offset);
                    row[i].iter_mut().zip(lateral).for_each(|(sum, part)| *sum += weight * part);
                }
            }
        }
    }

    /// Linear between the places of the lattice; `None` beside it, and where nothing is.
    fn at(&self, at_mm: [f64; 2]) -> Option<[f32; 4]> {
        let mut low = [0; 2];
        let mut part = [0.0_f32; 2];
        for axis in 0..2 {
            let place = (at_mm[axis] - self.first_mm[axis]) / STEP_MM;
            if !(place >= 0.0 && place < self.counts[axis] as f64 - 1.0) {
                return None;
            }
            low[axis] = place as usize;
            part[axis] = (place - place.floor()) as f32;
        }
        let start = low[1] * self.counts[0] + low[0];
        let (front, behind) = (
            self.places.get(start..start + 2)?,
            self.places.get(start + self.counts[0]..start + self.counts[0] + 2)?,
        );
        let [right, back] = part;
        let mixed: [f32; 4] = std::array::from_fn(|c| {
            (front[0][c] * (1.0 - right) + front[1][c] * right) * (1.0 - back)
                + (behind[0][c] * (1.0 - right) + behind[1][c] * right) * back
        });
        mixed.iter().any(|part| *part != 0.0).then_some(mixed)
    }
}
