//! One beam: the dose of each of its bixels to each voxel.
//!
//! Dose per unit weight is `(sad / r)^2 * sum over components of depth dose * lateral dose` (Bortfeld, Schlegel, Rhein,
//! Med. Phys. 20 (1993) 311, (8)-(10)), with the depth dose at the voxel's radiological depth, the lateral dose at its
//! distance from the bixel's axis as seen on the isocentre plane, and `r` its distance from the source.

use super::angles::BeamAngles;
use super::depth::{LitVoxel, depths_mm, skin_distance_mm};
use super::engine::{DoseEngine, Fluence};
use super::error::DoseError;
use super::frame::BeamFrame;
use super::kernel::BixelKernel;
use super::machine::COMPONENTS;
use super::outline::Pencil;
use crate::{Csc, Rows};
use stillpoint_patient::couch::Motion;

/// The bixels of a beam and what they give.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamInfluence {
    /// Where it comes from.
    pub angles: BeamAngles,
    /// Centres of the bixels on the isocentre plane, x and z in the beam's frame, mm.
    pub bixels_mm: Vec<[f64; 2]>,
    /// Dose by voxel of the dose grid and bixel, gray per unit weight. All entries are positive.
    pub dose: Csc,
}

/// The same with the dose by rows.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BeamRows {
    pub angles: BeamAngles,
    pub bixels_mm: Vec<[f64; 2]>,
    pub dose: Rows,
}

impl BeamRows {
    pub fn of(beam: BeamInfluence) -> Result<Self, DoseError> {
        let BeamInfluence { angles, bixels_mm, dose } = beam;
        let dose = Rows::from_columns(dose.view()).map_err(|fault| DoseError::Rows { angles, fault })?;
        Ok(Self { angles, bixels_mm, dose })
    }

    pub fn by_columns(self) -> Result<BeamInfluence, DoseError> {
        let Self { angles, bixels_mm, dose } = self;
        let dose = dose.to_columns().map_err(|fault| DoseError::Matrix { angles, fault })?;
        Ok(BeamInfluence { angles, bixels_mm, dose })
    }
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
    pub fn new(engine: &DoseEngine, angles: BeamAngles) -> Result<Self, DoseError> {
        Self::at(engine, angles, None)
    }

    /// At a patient who moved, if he did.
    pub fn at(engine: &DoseEngine, angles: BeamAngles, motion: Option<&Motion>) -> Result<Self, DoseError> {
        let (params, machine) = (&engine.params, &engine.machine);
        let (width_mm, sad_mm) = (params.bixels.width_mm, machine.file().sad_mm);
        let bixels_mm = engine.bixels_mm(angles)?;
        if bixels_mm.is_empty() {
            return Err(DoseError::NoBixel { angles });
        }
        if bixels_mm.len() > MOST_BIXELS {
            return Err(DoseError::Bixels { angles, found: bixels_mm.len(), most: MOST_BIXELS });
        }
        // In the frame of a patient who is moved, the isocentre goes the other way.
        let isocentre_mm = std::array::from_fn(|axis| engine.isocentre_mm[axis] - engine.shift_mm[axis]);
        let mut frame = BeamFrame::new(angles, engine.position, isocentre_mm, sad_mm);
        if let Some(motion) = motion {
            frame = frame.of_moved(motion);
        }
        // Where the couch is turned, the source goes round the patient along his length, too.
        if motion.is_some() || !angles.is_coplanar() {
            engine.check_clearance(&frame)?;
        }
        let central =
            bixels_mm.iter().copied().min_by(|a, b| square(*a).total_cmp(&square(*b))).unwrap_or_default();
        let ssd_mm = skin_distance_mm(&params.grid, &engine.density, &frame, central).unwrap_or(sad_mm);
        let offset_mm = params.bixels.centre.offset_mm(width_mm);
        let kernel = BixelKernel::new(machine, ssd_mm, width_mm, params.cutoff_mm + offset_mm.abs());
        Ok(Self { bixels_mm, frame, kernel, offset_mm: offset_mm as f32 })
    }

    /// The same with other bixels.
    pub fn with(self, bixels_mm: Vec<[f64; 2]>) -> Self {
        Self { bixels_mm, ..self }
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

    /// What a pencil is to the patient as he lies now.
    pub fn pencil(&self, engine: &DoseEngine, bixel_mm: [f64; 2]) -> Pencil {
        let (params, offset_mm) = (&engine.params, f64::from(self.offset_mm));
        let centre_mm = bixel_mm.map(|mm| mm + offset_mm);
        let patient = (&params.grid, engine.density.as_slice());
        engine.outline.pencil(&self.frame, centre_mm, params.bixels.width_mm, patient, &engine.machine)
    }

    /// Centres of the fluence of all bixels (mm), with the fluence of weight 1.
    pub fn bixels_with_fluence(&self, engine: &DoseEngine) -> Vec<([f64; 2], f32)> {
        let of = |bixel: &[f64; 2]| (self.centre_mm(*bixel), self.fluence(engine, *bixel));
        self.bixels_mm.iter().map(of).collect()
    }

    /// Where the fluence of a bixel is centred, mm.
    pub fn centre_mm(&self, bixel_mm: [f64; 2]) -> [f64; 2] {
        bixel_mm.map(|mm| mm + f64::from(self.offset_mm))
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

pub(super) fn influence(engine: &DoseEngine, angles: BeamAngles) -> Result<BeamInfluence, DoseError> {
    influence_of(engine, angles, Aim::new(engine, angles)?)
}

/// The same of the bixels of an aim.
pub(super) fn influence_of(
    engine: &DoseEngine,
    angles: BeamAngles,
    aim: Aim,
) -> Result<BeamInfluence, DoseError> {
    engine.check_entry(angles, aim.bixels_mm.iter().copied())?;
    let voxels = Voxels::near(engine, &aim.frame, &aim.bixels_mm);
    let depth_dose = &voxels.depth_dose;
    let mut starts = Vec::with_capacity(aim.bixels_mm.len() + 1);
    starts.push(0);
    let (mut row, mut value) = (Vec::new(), Vec::new());
    let cutoff2 = (engine.params.cutoff_mm * engine.params.cutoff_mm) as f32;
    for &bixel in &aim.bixels_mm {
        let fluence = aim.fluence(engine, bixel);
        let axis = BixelAxis::new(bixel, aim.frame.sad_mm());
        let mut put = |place: usize, offset: [f32; 2], depth_dose: &[f32; 4]| {
            let lateral = aim.lateral(offset);
            let dose = (0..COMPONENTS).map(|c| lateral[c] * depth_dose[c]).sum::<f32>() * fluence;
            // A kernel's far tail may be negative; no dose is.
            if dose > 0.0 {
                row.push(voxels.row[place]);
                value.push(dose);
            }
        };
        match aim.pencil(engine, bixel) {
            Pencil::Outside => {}
            Pencil::Inside => {
                voxels.each_near(&axis, cutoff2, |place, offset| put(place, offset, &depth_dose[place]))
            }
            Pencil::Edge(carried) => voxels.each_near(&axis, cutoff2, |place, offset| {
                let [y_mm, inverse_square] = voxels.along[place];
                put(place, offset, &carried.holding(&depth_dose[place], y_mm, inverse_square));
            }),
        }
        starts.push(row.len() as u64);
    }
    let dose =
        Csc::new(engine.rows(), starts, row, value).map_err(|fault| DoseError::Matrix { angles, fault })?;
    Ok(BeamInfluence { angles, bixels_mm: aim.bixels_mm, dose })
}

/// Dose of the components in voxels at their depths, with the inverse square of the distance from the source.
pub(super) fn depth_doses(engine: &DoseEngine, frame: &BeamFrame, lit: &[LitVoxel]) -> Vec<[f32; 4]> {
    let depths = depths_mm(&engine.params.grid, &engine.density, frame, lit);
    let of = |(voxel, depth_mm): (&LitVoxel, f64)| {
        let inverse_square = inverse_square(frame, voxel.beam_mm);
        let [a, b, c] = engine.machine.depth_dose(depth_mm).map(|dose| (dose * inverse_square) as f32);
        [a, b, c, 0.0]
    };
    lit.iter().zip(depths).map(of).collect()
}

/// The inverse square of the distance from the source, 1 at the isocentre.
pub(super) fn inverse_square(frame: &BeamFrame, [x, y, z]: [f64; 3]) -> f64 {
    frame.sad_mm() * frame.sad_mm() / (x * x + y * y + z * z)
}

/// The voxels that some bixel may reach, rising.
pub(super) struct Voxels {
    pub row: Vec<u32>,
    /// Where the line from the source meets the isocentre plane, mm.
    x_mm: Vec<f32>,
    z_mm: Vec<f32>,
    /// Depth dose of the components, with the inverse square of the distance from the source.
    pub depth_dose: Vec<[f32; 4]>,
    /// Place along the beam's axis, mm, and the inverse square.
    pub along: Vec<[f32; 2]>,
}

impl Voxels {
    /// Those within the cutoff of one of these bixels.
    pub fn near(engine: &DoseEngine, frame: &BeamFrame, bixels_mm: &[[f64; 2]]) -> Self {
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
            along: lit
                .iter()
                .map(|v| [v.beam_mm[1], inverse_square(frame, v.beam_mm)].map(|n| n as f32))
                .collect(),
        }
    }

    /// The voxels whose distance beside an axis is within the cutoff, and where they lie beside it.
    #[inline]
    pub fn each_near(&self, axis: &BixelAxis, cutoff2: f32, mut visit: impl FnMut(usize, [f32; 2])) {
        const BLOCK: usize = 128;
        let mut offset = [[0.0; 2]; BLOCK];
        for (block, (x, z)) in self.x_mm.chunks(BLOCK).zip(self.z_mm.chunks(BLOCK)).enumerate() {
            for ((offset, &x), &z) in offset.iter_mut().zip(x).zip(z) {
                *offset = axis.offset([x, z]);
            }
            for (i, &[x, z]) in offset[..x.len()].iter().enumerate() {
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
    pub fn offset(&self, [x, z]: [f32; 2]) -> [f32; 2] {
        let along = |axis: &[f32; 3]| axis[0] * x + axis[1] + axis[2] * z;
        let scale = self.sad_mm / along(&self.y);
        [along(&self.x) * scale, along(&self.z) * scale]
    }
}

fn square([x, z]: [f64; 2]) -> f64 {
    x * x + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dose::outline::Outline;
    use crate::dose::{BixelSpec, DoseParams, Machine};
    use stillpoint_patient::case::{Case, Mask, neck};

    fn engine(case: &Case, inside_mm: f64) -> DoseEngine {
        let bixels = BixelSpec { inside_mm, ..BixelSpec::of_width(10.0) };
        let params = DoseParams { bixels, ..DoseParams::over(case.grid(), 8.0) };
        DoseEngine::of_case(case, Machine::shipped().unwrap(), params).unwrap()
    }

    /// The same patient for whom every ray through the image is one through the patient.
    fn without_outline(case: &Case, engine: &DoseEngine) -> DoseEngine {
        let all = Mask::from_fn(case.grid().len(), |_| true);
        DoseEngine { outline: Outline::new(case.grid(), &all).unwrap(), ..engine.clone() }
    }

    /// Whether a ray comes into the patient, by a walk along it in small steps.
    fn meets(case: &Case, angles: BeamAngles, [x, z]: [f64; 2]) -> bool {
        let frame = BeamFrame::new(angles, case.position(), case.isocentre_mm(), 1000.0);
        let grid = case.grid();
        (0..3000).any(|step| {
            let y = 700.0 + 0.2 * f64::from(step);
            let place = frame.patient_from_beam([x * y / 1000.0, y, z * y / 1000.0]);
            let voxel: [f64; 3] = std::array::from_fn(|axis| {
                libm::round((place[axis] - grid.origin_mm[axis]) / grid.spacing_mm[axis])
            });
            let is_on_grid = (0..3).all(|axis| (0.0..grid.counts[axis] as f64).contains(&voxel[axis]));
            is_on_grid && case.external().unwrap().mask.contains(grid.index(voxel.map(|at| at as usize)))
        })
    }

    #[test]
    fn no_bixel_of_a_neck_passes_beside_the_patient_unless_flash_is_asked_for() {
        let case = neck(0).unwrap();
        let [held, flash] = [0.0, -10.0].map(|inside_mm| engine(&case, inside_mm));
        let all = without_outline(&case, &held);
        let mut left_out = 0;
        for angles in [0.0, 72.0, 144.0, 216.0, 288.0] {
            let of = |engine: &DoseEngine| Aim::new(engine, angles.into()).unwrap().bixels_mm;
            let (held, flash, all) = (of(&held), of(&flash), of(&all));
            assert!(held.iter().all(|bixel| meets(&case, angles.into(), *bixel)), "{angles}");
            assert!(held.iter().all(|bixel| flash.contains(bixel)) && flash.len() >= held.len());
            assert!(flash.iter().all(|bixel| all.contains(bixel)));
            left_out += all.len() - held.len();
            if angles == 0.0 {
                // It carried 174 times the median weight of its beam.
                assert!(all.contains(&[70.0, 0.0]) && !held.contains(&[70.0, 0.0]));
            }
        }
        assert!(left_out > 20, "{left_out}");
    }

    #[test]
    fn pencils_within_the_patient_keep_their_bits_and_those_at_the_edge_give_less() {
        let case = neck(0).unwrap();
        let real = engine(&case, 0.0);
        let beam = real.beam(72.0).unwrap();
        let aim = Aim::new(&real, 72.0.into()).unwrap();
        let whole = without_outline(&case, &real).beam(72.0).unwrap();
        let (mut inside, mut edge) = (0, 0);
        for (at, bixel) in beam.bixels_mm.iter().enumerate() {
            let place = whole.bixels_mm.iter().position(|other| other == bixel).unwrap();
            let (now, before) = (beam.dose.view().column(at), whole.dose.view().column(place));
            match aim.pencil(&real, *bixel) {
                Pencil::Inside => {
                    inside += 1;
                    assert_eq!(now, before, "{bixel:?}");
                }
                Pencil::Edge(_) => {
                    edge += 1;
                    assert!(now.1.iter().sum::<f32>() < before.1.iter().sum::<f32>(), "{bixel:?}");
                }
                Pencil::Outside => panic!("{bixel:?} is beside the patient"),
            }
        }
        assert!(inside > 50 && edge > 5, "{inside} {edge}");
    }

    #[test]
    fn a_pencil_whose_ray_is_in_air_gives_nothing_and_moves_into_the_patient_with_a_shift() {
        let case = neck(0).unwrap();
        let engine = engine(&case, 0.0);
        let sum = |engine: &DoseEngine, x: f64| {
            engine.weighted_bixels(0.0, &[[x, 0.0]], &[1.0]).unwrap().iter().sum::<f32>()
        };
        let edge =
            (0..30).map(|step| 5.0 * f64::from(step)).find(|x| !meets(&case, 0.0.into(), [*x, 0.0])).unwrap();
        assert_eq!(sum(&engine, edge + 5.0), 0.0);
        assert!(sum(&engine.shifted([20.0, 0.0, 0.0]).unwrap(), edge + 5.0) > 0.0);
    }
}
