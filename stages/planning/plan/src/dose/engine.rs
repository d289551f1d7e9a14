//! The engine: a patient, a machine and params, made ready to give the dose of any beam.

use super::angles::BeamAngles;
use super::beam::{self, Aim, BeamInfluence, BeamRows};
use super::bixels::{self, BixelSpec};
use super::density;
use super::depth::corners;
use super::error::DoseError;
use super::frame::BeamFrame;
use super::machine::Machine;
use super::name::EngineName;
use super::outline::Outline;
use super::superposition::{self, Superposition};
use crate::threads::on_threads;
use std::num::NonZeroUsize;
use std::ops::RangeInclusive;
use std::sync::OnceLock;
use stillpoint_patient::Grid;
use stillpoint_patient::case::{Case, Mask, PatientPosition};

/// What the engine sees of a patient. Volumes have one entry for each voxel of `grid`.
#[derive(Clone, Copy, Debug)]
pub struct Anatomy<'a> {
    /// Where the image's voxels are.
    pub grid: Grid,
    /// The image, Hounsfield units.
    pub hu: &'a [i16],
    /// The patient: what lies outside of it neither stops the beam nor gets dose.
    pub external: &'a Mask,
    /// All targets together.
    pub target: &'a Mask,
    /// Where the beams meet, mm in the patient frame.
    pub isocentre_mm: [f64; 3],
}

/// How dose is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DoseParams {
    /// Voxels that get dose.
    pub grid: Grid,
    /// Bixels of each beam.
    pub bixels: BixelSpec,
    /// Fluence that a bixel of weight 1 stands for.
    pub fluence: Fluence,
    /// Distance from a bixel's axis, on the isocentre plane, beyond which it gives no dose, mm.
    pub cutoff_mm: f64,
    /// The method.
    pub engine: EngineName,
}

impl DoseParams {
    /// 10 mm bixels and a cutoff of 50 mm on a dose grid of this spacing over an image.
    pub fn over(image: &Grid, spacing_mm: f64) -> Self {
        Self {
            grid: covering(image, spacing_mm),
            bixels: BixelSpec::of_width(10.0),
            fluence: Fluence::Uniform,
            cutoff_mm: 50.0,
            engine: EngineName::Pencil,
        }
    }
}

/// Fluence that a bixel of weight 1 stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fluence {
    /// The same everywhere.
    Uniform,
    /// That of the open field at the bixel's centre, relative to the axis.
    OpenField,
}

/// Dose of any beam to one patient.
#[derive(Clone, Debug)]
pub struct DoseEngine {
    pub(super) machine: Machine,
    pub(super) params: DoseParams,
    pub(super) isocentre_mm: [f64; 3],
    /// How the patient lies.
    pub(super) position: PatientPosition,
    /// Relative electron density on the dose grid.
    pub(super) density: Vec<f32>,
    /// Voxels of the dose grid inside the patient, rising.
    pub(super) voxels: Vec<u32>,
    /// The target with its margin, as points of the patient frame, mm.
    pub(super) target_mm: Vec<[f64; 3]>,
    /// The outline of the patient on the image.
    pub(super) outline: Outline,
    /// Greatest spacing of the image, mm.
    pub(super) image_spacing_mm: f64,
    /// Where doses are wanted at samples alone: the voxels that are rows of the dose matrices, rising. Else every voxel of
    /// the dose grid is a row.
    pub(super) samples: Option<Vec<u32>>,
    /// How far the patient lies from where he was planned, along the axes of his frame, mm.
    pub(super) shift_mm: [f64; 3],
    /// The hash of all that the doses depend on.
    pub(super) key: EngineKey,
}

/// The hash of all that the doses of an engine depend on, once it was asked for: it takes as long as to read the engine. A
/// clone, which may be changed, has none.
#[derive(Debug, Default)]
pub(super) struct EngineKey(OnceLock<[u8; 32]>);

impl EngineKey {
    /// The hash, made by this function the first time.
    pub fn get(&self, make: impl FnOnce() -> [u8; 32]) -> [u8; 32] {
        *self.0.get_or_init(make)
    }
}

impl Clone for EngineKey {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// A patient whose densest voxel has less than this is air.
const LEAST_DENSITY: f32 = 0.1;
/// Voxels that a grid may have.
const MOST_VOXELS: usize = 1 << 28;
/// Farthest that a patient may lie from where he was planned, along an axis, mm.
const MOST_SHIFT_MM: f64 = 50.0;
/// Least distance from the source to the dose grid, mm.
const SOURCE_CLEARANCE_MM: f64 = 100.0;

impl DoseEngine {
    /// Makes a case ready: its outline is the patient, its targets together are aimed at.
    pub fn of_case(case: &Case, machine: Machine, params: DoseParams) -> Result<Self, DoseError> {
        let target = Mask::from_fn(case.grid().len(), |voxel| case.targets().any(|t| t.mask.contains(voxel)));
        let anatomy = Anatomy {
            grid: *case.grid(),
            hu: case.hu(),
            external: &case.external().ok_or(DoseError::NoOutline)?.mask,
            target: &target,
            isocentre_mm: case.isocentre_mm(),
        };
        Ok(Self { position: case.position(), ..Self::new(&anatomy, machine, params)? })
    }

    /// Makes a patient ready.
    pub fn new(anatomy: &Anatomy<'_>, machine: Machine, params: DoseParams) -> Result<Self, DoseError> {
        let (image, grid) = (&anatomy.grid, &params.grid);
        check_grid("the image", image)?;
        let length = |volume, found| match found == image.len() {
            true => Ok(()),
            false => Err(DoseError::Length { volume, expected: image.len(), found }),
        };
        length("the image", anatomy.hu.len())?;
        length("the external contour's mask", anatomy.external.len())?;
        length("the target's mask", anatomy.target.len())?;
        check_numbers(&params, anatomy.isocentre_mm, [0.0; 3], machine.file().sad_mm)?;
        if params.engine == EngineName::Superposition && machine.file().superposition.is_none() {
            return Err(DoseError::NoKernels);
        }

        let target_mm = bixels::with_margin(image, anatomy.target, params.bixels.margin_mm);
        if target_mm.is_empty() {
            return Err(DoseError::NoTarget);
        }
        let outline = Outline::new(image, anatomy.external).ok_or(DoseError::NoPatient)?;
        let voxels = density::voxels_inside(image, anatomy.external, grid);
        if voxels.is_empty() {
            return Err(DoseError::NoPatient);
        }
        if !anatomy.target.indices().any(|voxel| anatomy.external.contains(voxel)) {
            return Err(DoseError::TargetOutside);
        }
        let density = density::on_grid(image, anatomy.hu, anatomy.external, &machine, grid);
        let greatest = density.iter().copied().fold(0.0, f32::max);
        if greatest <= LEAST_DENSITY {
            return Err(DoseError::Air { greatest });
        }
        Ok(Self {
            density,
            voxels,
            target_mm,
            outline,
            image_spacing_mm: image.spacing_mm.into_iter().fold(0.0, f64::max),
            isocentre_mm: anatomy.isocentre_mm,
            position: PatientPosition::default(),
            samples: None,
            shift_mm: [0.0; 3],
            key: EngineKey::default(),
            machine,
            params,
        })
    }

    /// The same patient, set up beside where he was planned: moved by this much along the axes of his frame, mm.
    ///
    /// Bixels stay where they are planned. Doses are to the voxels that were planned: they move with the patient.
    pub fn shifted(&self, shift_mm: [f64; 3]) -> Result<Self, DoseError> {
        check_shift(shift_mm)?;
        Ok(Self { shift_mm, ..self.clone() })
    }

    /// The same patient, of whom only these rows get dose: voxels of the dose grid, or samples.
    pub fn within(&self, rows: &[u32]) -> Self {
        let mut requested = vec![false; self.rows()];
        for row in rows {
            if let Some(requested) = requested.get_mut(*row as usize) {
                *requested = true;
            }
        }
        let voxels = self.voxels.iter().copied().filter(|v| requested[self.row_of(*v) as usize]).collect();
        Self { voxels, ..self.clone() }
    }

    /// The same patient, sampled: row `i` of the dose matrices is voxel `samples[i]` of the dose grid, and no other voxel
    /// gets dose. `samples` rise. [`DoseEngine::within`] counts these rows afterwards.
    pub fn sampled(&self, samples: Vec<u32>) -> Self {
        let inside = |voxel: &u32| self.voxels.binary_search(voxel).is_ok();
        let voxels = samples.iter().copied().filter(inside).collect();
        Self { voxels, samples: Some(samples), ..self.clone() }
    }

    /// The same patient, of whom these voxels of the dose grid get dose.
    pub(crate) fn reaching(&self, voxels: Vec<u32>) -> Self {
        Self { voxels, samples: None, ..self.clone() }
    }

    /// Rows of the dose matrices.
    pub fn rows(&self) -> usize {
        self.samples.as_ref().map_or(self.params.grid.len(), Vec::len)
    }

    /// The row of a voxel that gets dose.
    pub(super) fn row_of(&self, voxel: u32) -> u32 {
        match &self.samples {
            Some(samples) => samples.binary_search(&voxel).unwrap_or_default() as u32,
            None => voxel,
        }
    }

    /// How dose is computed.
    pub fn params(&self) -> &DoseParams {
        &self.params
    }

    /// The machine.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Dose of the bixels of one beam at these angles; a number is a gantry angle.
    pub fn beam(&self, angles: impl Into<BeamAngles>) -> Result<BeamInfluence, DoseError> {
        let angles = self.checked_angles(angles)?;
        match self.superposition()? {
            None => beam::influence(self, angles),
            Some(section) => superposition::influence(self, angles, section)?.by_columns(),
        }
    }

    /// Dose by pencil beams of these squares (centres in mm), each as wide as a bixel of this engine, to the rows of its dose matrices.
    /// Whatever the method of the engine: what an arc opens is searched among too many squares for a superposition of each.
    ///
    /// # Errors
    /// An angle out of range, or a beam without bixels.
    pub(crate) fn squares_of(
        &self,
        angles: impl Into<BeamAngles>,
        squares_mm: Vec<[f64; 2]>,
    ) -> Result<BeamInfluence, DoseError> {
        let angles = self.checked_angles(angles)?;
        beam::influence_of(self, angles, Aim::new(self, angles)?.with(squares_mm))
    }

    /// The same patient with other bixels around the same places.
    pub fn with_bixels(&self, bixels: BixelSpec) -> Self {
        Self { params: DoseParams { bixels, ..self.params }, ..self.clone() }
    }

    /// The same by rows, as doses are kept.
    pub(super) fn beam_rows(&self, angles: BeamAngles) -> Result<BeamRows, DoseError> {
        let angles = self.checked_angles(angles)?;
        match self.superposition()? {
            None => BeamRows::of(beam::influence(self, angles)?),
            Some(section) => superposition::influence(self, angles, section),
        }
    }

    /// Spectrum and kernels, where dose is computed by superposition.
    pub(super) fn superposition(&self) -> Result<Option<&Superposition>, DoseError> {
        match self.params.engine {
            EngineName::Pencil => Ok(None),
            EngineName::Superposition => {
                self.machine.file().superposition.as_ref().map(Some).ok_or(DoseError::NoKernels)
            }
        }
    }

    pub(super) fn checked_angles(&self, angles: impl Into<BeamAngles>) -> Result<BeamAngles, DoseError> {
        let angles = angles.into();
        in_range("gantry angle", angles.gantry_deg, 0.0..=360.0)?;
        in_range("couch angle", angles.couch_deg, -180.0..=180.0)?;
        Ok(angles)
    }

    /// Centres of the bixels of a beam, on the isocentre plane, mm. No dose is computed.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn bixels_mm(&self, angles: impl Into<BeamAngles>) -> Result<Vec<[f64; 2]>, DoseError> {
        let angles = self.checked_angles(angles)?;
        let frame = BeamFrame::new(angles, self.position, self.isocentre_mm, self.machine.file().sad_mm);
        let spec = &self.params.bixels;
        Ok(bixels::positions(&frame, &self.target_mm, spec, self.image_spacing_mm, &self.outline))
    }

    /// Part of each of these bixels (centres in mm) whose rays do not cross the patient as he was planned.
    ///
    /// # Errors
    /// An angle out of range.
    pub fn parts_outside(
        &self,
        angles: impl Into<BeamAngles>,
        bixels_mm: &[[f64; 2]],
    ) -> Result<Vec<f64>, DoseError> {
        let sad_mm = self.machine.file().sad_mm;
        let isocentre_mm = std::array::from_fn(|axis| self.isocentre_mm[axis] - self.shift_mm[axis]);
        let frame = BeamFrame::new(self.checked_angles(angles)?, self.position, isocentre_mm, sad_mm);
        let width_mm = self.params.bixels.width_mm;
        Ok(bixels_mm.iter().map(|bixel| self.outline.part_outside(&frame, *bixel, width_mm)).collect())
    }

    /// Refuses a patient whom a motion takes near to the source of a beam, or behind it.
    pub(super) fn check_clearance(&self, frame: &BeamFrame) -> Result<(), DoseError> {
        let nearest = |near: f64, corner| near.min(frame.beam_from_patient(corner)[1]);
        let near_mm = corners(&self.params.grid).fold(f64::INFINITY, nearest);
        match near_mm >= SOURCE_CLEARANCE_MM {
            true => Ok(()),
            false => Err(DoseError::Far {
                reach_mm: frame.sad_mm() - near_mm,
                most_mm: frame.sad_mm() - SOURCE_CLEARANCE_MM,
            }),
        }
    }

    /// Refuses a beam of a turned couch that enters the patient where the images end: what these bixels cross before is not
    /// known.
    pub(super) fn check_entry(
        &self,
        angles: BeamAngles,
        bixels_mm: impl IntoIterator<Item = [f64; 2]>,
    ) -> Result<(), DoseError> {
        if angles.is_coplanar() {
            return Ok(());
        }
        let frame = BeamFrame::new(angles, self.position, self.isocentre_mm, self.machine.file().sad_mm);
        let (mut bixels, mut by_end) = (0, 0);
        for place in bixels_mm {
            bixels += 1;
            by_end += usize::from(self.outline.is_entered_by_an_end(&frame, place));
        }
        if by_end == 0 { Ok(()) } else { Err(DoseError::CutEnd { angles, bixels, by_end }) }
    }

    /// Whether a beam of these angles can be computed: it has bixels, and its source and its way are in the room and the images.
    pub(crate) fn has_beam(&self, angles: BeamAngles) -> bool {
        Aim::new(self, angles).and_then(|aim| self.check_entry(angles, aim.bixels_mm)).is_ok()
    }

    /// Dose of several beams, on several threads. Any number of threads gives the same bytes.
    pub fn beams(
        &self,
        angles: &[impl Into<BeamAngles> + Copy + Sync],
        threads: NonZeroUsize,
    ) -> Result<Vec<BeamInfluence>, DoseError> {
        on_threads(angles, threads, |angles| self.beam(*angles))
    }
}

/// The grid of this spacing around the middle of an image that covers it.
fn covering(image: &Grid, spacing_mm: f64) -> Grid {
    let extent = |axis: usize| image.counts[axis] as f64 * image.spacing_mm[axis];
    let counts: [usize; 3] = std::array::from_fn(|axis| (extent(axis) / spacing_mm).ceil() as usize);
    let origin = |axis: usize| {
        let middle = image.origin_mm[axis] + 0.5 * (extent(axis) - image.spacing_mm[axis]);
        middle - 0.5 * (counts[axis] as f64 - 1.0) * spacing_mm
    };
    Grid { counts, spacing_mm: [spacing_mm; 3], origin_mm: std::array::from_fn(origin) }
}

fn check_shift(shift_mm: [f64; 3]) -> Result<(), DoseError> {
    shift_mm
        .into_iter()
        .try_for_each(|mm| in_range("shift of the patient", mm, -MOST_SHIFT_MM..=MOST_SHIFT_MM))
}

/// Refuses parameters and places that are out of range, for a source at `sad_mm` from the isocentre.
pub(super) fn check_numbers(
    params: &DoseParams,
    isocentre_mm: [f64; 3],
    shift_mm: [f64; 3],
    sad_mm: f64,
) -> Result<(), DoseError> {
    check_grid("the dose grid", &params.grid)?;
    check_bixel(params.bixels.width_mm)?;
    in_range("margin of bixels", params.bixels.margin_mm, 0.0..=200.0)?;
    in_range("margin of bixels within the outline", params.bixels.inside_mm, -50.0..=50.0)?;
    in_range("cutoff", params.cutoff_mm, 5.0..=500.0)?;
    for place in isocentre_mm {
        in_range("place of the isocentre", place, -1e5..=1e5)?;
    }
    check_shift(shift_mm)?;
    let reach_mm = corners(&params.grid)
        .map(|[x, y, _]| libm::hypot(x - isocentre_mm[0], y - isocentre_mm[1]))
        .fold(0.0, f64::max);
    if reach_mm > sad_mm - SOURCE_CLEARANCE_MM {
        return Err(DoseError::Far { reach_mm, most_mm: sad_mm - SOURCE_CLEARANCE_MM });
    }
    Ok(())
}

/// Refuses a width of bixels that is out of range, mm.
pub(crate) fn check_bixel(width_mm: f64) -> Result<(), DoseError> {
    in_range("width of a bixel", width_mm, 1.0..=100.0)
}

/// Refuses a grid of too many voxels, or of voxels too small or too large.
pub(crate) fn check_grid(what: &'static str, grid: &Grid) -> Result<(), DoseError> {
    // First: the counts of a grid that is made to cover an image follow from its spacing.
    for axis in 0..3 {
        in_range("spacing of voxels", grid.spacing_mm[axis], 0.1..=100.0)?;
        in_range("place of a grid", grid.origin_mm[axis], -1e5..=1e5)?;
    }
    let voxels = grid.counts.iter().try_fold(1, |product: usize, &count| product.checked_mul(count));
    if !voxels.is_some_and(|voxels| (1..=MOST_VOXELS).contains(&voxels)) {
        return Err(DoseError::Voxels { what, counts: grid.counts, most: MOST_VOXELS });
    }
    Ok(())
}

fn in_range(what: &'static str, value: f64, range: RangeInclusive<f64>) -> Result<(), DoseError> {
    match range.contains(&value) {
        true => Ok(()),
        false => Err(DoseError::Number { what, value, least: *range.start(), most: *range.end() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dose_grid_covers_the_image_around_the_same_middle() {
        let image = Grid { counts: [136, 80, 64], spacing_mm: [3.0; 3], origin_mm: [-202.5, -118.5, -94.5] };
        let grid = covering(&image, 5.0);
        assert_eq!(
            grid,
            Grid { counts: [82, 48, 39], spacing_mm: [5.0; 3], origin_mm: [-202.5, -117.5, -95.0] }
        );
    }
}
