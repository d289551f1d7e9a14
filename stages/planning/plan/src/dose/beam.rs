//! One beam: the dose of each of its bixels to each voxel.
//!
//! Dose per unit weight is `(sad / r)^2 * sum over components of depth dose * lateral dose` (Bortfeld, Schlegel, Rhein,
//! Med. Phys. 20 (1993) 311, (8)-(10)), with the depth dose at the voxel's radiological depth, the lateral dose at its
//! distance from the bixel's axis as seen on the isocentre plane, and `r` its distance from the source.

use super::bixels;
use super::depth::{LitVoxel, depths_mm, skin_distance_mm};
use super::engine::{DoseEngine, Fluence};
use super::error::DoseError;
use super::frame::BeamFrame;
use super::kernel::BixelKernel;
use super::machine::COMPONENTS;
use crate::Csc;
use stillpoint_patient::couch::Motion;

/// The bixels of a beam and what they give.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamInfluence {
    /// Gantry angle, degrees.
    pub gantry_deg: f64,
    /// Centres of the bixels on the isocentre plane, x and z in the beam's frame, mm.
    pub bixels_mm: Vec<[f64; 2]>,
    /// Dose by voxel of the dose grid and bixel, gray per unit weight. All entries are positive.
    pub dose: Csc,
}

/// Bixels that a beam may have.
const MOST_BIXELS: usize = 1 << 14;
/// A bixel's cutoff is measured beside its own axis, which is at most this much more on the isocentre plane.
pub(super) const OBLIQUE: f64 = 1.05;

/// A beam before any voxel gets dose.
pub(super) struct Aim {
    /// Centres of the bixels on the isocentre plane, mm.
    pub bixels_mm: Vec<[f64; 2]>,
    /// The beam's frame in the patient as he lies now.
    pub frame: BeamFrame,
    kernel: BixelKernel,
    offset_mm: f32,
}

impl Aim {
    pub fn new(engine: &DoseEngine, gantry_deg: f64) -> Result<Self, DoseError> {
        Self::at(engine, gantry_deg, None)
    }

    /// At a patient who moved, if he did.
    pub fn at(engine: &DoseEngine, gantry_deg: f64, motion: Option<&Motion>) -> Result<Self, DoseError> {
        let (params, machine) = (&engine.params, &engine.machine);
        let (width_mm, sad_mm) = (params.bixels.width_mm, machine.file().sad_mm);
        let planned = BeamFrame::new(gantry_deg, engine.position, engine.isocentre_mm, sad_mm);
        let bixels_mm = bixels::positions(&planned, &engine.target_mm, width_mm, engine.image_spacing_mm);
        if bixels_mm.len() > MOST_BIXELS {
            return Err(DoseError::Bixels { gantry_deg, found: bixels_mm.len(), most: MOST_BIXELS });
        }
        // In the frame of a patient who is moved, the isocentre goes the other way.
        let isocentre_mm = std::array::from_fn(|axis| engine.isocentre_mm[axis] - engine.shift_mm[axis]);
        let mut frame = BeamFrame::new(gantry_deg, engine.position, isocentre_mm, sad_mm);
        if let Some(motion) = motion {
            frame = frame.of_moved(motion);
            engine.check_clearance(&frame)?;
        }
        let central =
            bixels_mm.iter().copied().min_by(|a, b| square(*a).total_cmp(&square(*b))).unwrap_or_default();
        let ssd_mm = skin_distance_mm(&params.grid, &engine.density, &frame, central).unwrap_or(sad_mm);
        let offset_mm = params.bixels.centre.offset_mm(width_mm);
        let kernel = BixelKernel::new(machine, ssd_mm, width_mm, params.cutoff_mm + offset_mm.abs());
        Ok(Self { bixels_mm, frame, kernel, offset_mm: offset_mm as f32 })
    }

    /// Lateral dose of the components at a place beside a bixel's axis, mm.
    #[inline]
    pub fn lateral(&self, [x, z]: [f32; 2]) -> [f32; 4] {
        self.kernel.at(x - self.offset_mm, z - self.offset_mm)
    }

    /// Where the samples of the lateral dose lie beside multiples of their distance around a bixel's axis, mm.
    pub fn phase_mm(&self) -> f64 {
        self.kernel.phase_mm() + f64::from(self.offset_mm)
    }

    /// Fluence of a bixel of weight 1.
    pub fn fluence(&self, engine: &DoseEngine, bixel_mm: [f64; 2]) -> f32 {
        match engine.params.fluence {
            Fluence::Uniform => 1.0,
            Fluence::OpenField => {
                engine.machine.primary_fluence(libm::hypot(bixel_mm[0], bixel_mm[1])) as f32
            }
        }
    }
}

pub(super) fn influence(engine: &DoseEngine, gantry_deg: f64) -> Result<BeamInfluence, DoseError> {
    let aim = Aim::new(engine, gantry_deg)?;
    let voxels = Voxels::near(engine, &aim.frame, &aim.bixels_mm);
    let mut starts = Vec::with_capacity(aim.bixels_mm.len() + 1);
    starts.push(0);
    let (mut row, mut value) = (Vec::new(), Vec::new());
    let cutoff2 = (engine.params.cutoff_mm * engine.params.cutoff_mm) as f32;
    for &bixel in &aim.bixels_mm {
        let fluence = aim.fluence(engine, bixel);
        let axis = BixelAxis::new(bixel, aim.frame.sad_mm());
        voxels.each_beside(&axis, cutoff2, |place, beside| {
            let lateral = aim.lateral(beside);
            let depth_dose = &voxels.depth_dose[place];
            let dose = (0..COMPONENTS).map(|c| lateral[c] * depth_dose[c]).sum::<f32>() * fluence;
            // A kernel's far tail may be negative; no dose is.
            if dose > 0.0 {
                row.push(voxels.row[place]);
                value.push(dose);
            }
        });
        starts.push(row.len() as u64);
    }
    let dose = Csc::new(engine.rows(), starts, row, value)
        .map_err(|fault| DoseError::Matrix { gantry_deg, fault })?;
    Ok(BeamInfluence { gantry_deg, bixels_mm: aim.bixels_mm, dose })
}

/// Dose of the components in voxels at their depths, with the inverse square of the distance from the source.
pub(super) fn depth_doses(engine: &DoseEngine, frame: &BeamFrame, lit: &[LitVoxel]) -> Vec<[f32; 4]> {
    let depths = depths_mm(&engine.params.grid, &engine.density, frame, lit);
    let of = |(voxel, depth_mm): (&LitVoxel, f64)| {
        let [x, y, z] = voxel.beam_mm;
        let inverse_square = frame.sad_mm() * frame.sad_mm() / (x * x + y * y + z * z);
        let [a, b, c] = engine.machine.depth_dose(depth_mm).map(|dose| (dose * inverse_square) as f32);
        [a, b, c, 0.0]
    };
    lit.iter().zip(depths).map(of).collect()
}

/// The voxels that some bixel may reach, rising.
struct Voxels {
    row: Vec<u32>,
    /// Where the line from the source meets the isocentre plane, mm.
    x_mm: Vec<f32>,
    z_mm: Vec<f32>,
    /// Depth dose of the components, with the inverse square of the distance from the source.
    depth_dose: Vec<[f32; 4]>,
}

impl Voxels {
    fn near(engine: &DoseEngine, frame: &BeamFrame, bixels_mm: &[[f64; 2]]) -> Self {
        let grid = &engine.params.grid;
        let reach2 = libm::pow(engine.params.cutoff_mm * OBLIQUE, 2.0);
        let near =
            |plane: [f64; 2]| bixels_mm.iter().any(|b| square([b[0] - plane[0], b[1] - plane[1]]) <= reach2);
        let lit: Vec<LitVoxel> = engine
            .voxels
            .iter()
            .map(|&row| LitVoxel {
                row,
                beam_mm: frame.beam_from_patient(grid.centre_mm(grid.voxel(row as usize))),
            })
            .filter(|voxel| near(frame.on_isocentre_plane(voxel.beam_mm)))
            .collect();
        let on_plane =
            |axis: usize| lit.iter().map(move |v| frame.on_isocentre_plane(v.beam_mm)[axis] as f32).collect();
        Self {
            depth_dose: depth_doses(engine, frame, &lit),
            row: lit.iter().map(|voxel| engine.row_of(voxel.row)).collect(),
            x_mm: on_plane(0),
            z_mm: on_plane(1),
        }
    }

    /// The voxels whose distance beside an axis is within the cutoff, and where they lie beside it.
    #[inline]
    fn each_beside(&self, axis: &BixelAxis, cutoff2: f32, mut visit: impl FnMut(usize, [f32; 2])) {
        const BLOCK: usize = 128;
        let mut beside = [[0.0; 2]; BLOCK];
        for (block, (x, z)) in self.x_mm.chunks(BLOCK).zip(self.z_mm.chunks(BLOCK)).enumerate() {
            for ((beside, &x), &z) in beside.iter_mut().zip(x).zip(z) {
                *beside = axis.beside([x, z]);
            }
            for (i, &[x, z]) in beside[..x.len()].iter().enumerate() {
                if x * x + z * z <= cutoff2 {
                    visit(block * BLOCK + i, [x, z]);
                }
            }
        }
    }
}

/// A bixel's axis, and the smallest turn that takes the beam's axis there: what was the beam's x and z is the bixel's.
pub(super) struct BixelAxis {
    x: [f32; 3],
    y: [f32; 3],
    z: [f32; 3],
    sad_mm: f32,
}

impl BixelAxis {
    pub fn new([x, z]: [f64; 2], sad_mm: f64) -> Self {
        let length = libm::sqrt(x * x + sad_mm * sad_mm + z * z);
        let [x, y, z] = [x / length, sad_mm / length, z / length];
        let k = 1.0 / (1.0 + y);
        // The point that it is applied to lies on the isocentre plane, so its y is known.
        let on_plane = |axis: [f64; 3]| [axis[0] as f32, (axis[1] * sad_mm) as f32, axis[2] as f32];
        Self {
            x: on_plane([1.0 - x * x * k, -x, -x * z * k]),
            y: on_plane([x, y, z]),
            z: on_plane([-x * z * k, -z, 1.0 - z * z * k]),
            sad_mm: sad_mm as f32,
        }
    }

    /// How far beside the axis the line through a place of the isocentre plane is, where it is `sad_mm` along the axis.
    #[inline]
    pub fn beside(&self, [x, z]: [f32; 2]) -> [f32; 2] {
        let along = |axis: &[f32; 3]| axis[0] * x + axis[1] + axis[2] * z;
        let scale = self.sad_mm / along(&self.y);
        [along(&self.x) * scale, along(&self.z) * scale]
    }
}

fn square([x, z]: [f64; 2]) -> f64 {
    x * x + z * z
}
