//! The outline of the patient as rays see it, and the pencils at its edge.
//!
//! A pencil beam kernel is that of water without end. A ray beside the patient crosses air, where no photon sets electrons
//! free, so the tail of its kernel does not exist. Three kinds of pencils follow from the patient's outline:
//!
//! - *inside*: its own ray and all rays one width around it cross the patient; its dose is that of the kernel;
//! - *outside*: its own ray crosses nothing; it gives no dose;
//! - *edge*: anything else; it gives no more than what its own ray carries ([`Carried`]).

use std::sync::Arc;

use super::depth::corners;
use super::frame::BeamFrame;
use super::machine::{COMPONENTS, Machine};
use super::siddon::segments;
use stillpoint_patient::Grid;
use stillpoint_patient::case::Mask;

/// Directions in which the surroundings of a ray are looked at: corners and edges of a square.
const AROUND: [[f64; 2]; 8] =
    [[-1.0, -1.0], [-1.0, 0.0], [-1.0, 1.0], [0.0, -1.0], [0.0, 1.0], [1.0, -1.0], [1.0, 0.0], [1.0, 1.0]];
/// Where the rays of a bixel run, in parts of its width: its axis and the middles of its quarters.
const RAYS: [[f64; 2]; 5] = [[0.0, 0.0], [-0.25, -0.25], [-0.25, 0.25], [0.25, -0.25], [0.25, 0.25]];
/// Distance within which a ray that comes into a box is on a face of it, mm.
const FACE_MM: f64 = 1e-6;
/// Distance between samples along a pencil, mm.
const STEP_MM: f64 = 1.0;

/// Which voxels of the image are the patient, cut to the box around them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outline {
    pub grid: Grid,
    pub inside: Arc<Mask>,
    /// Whether the patient reaches the first and the last image: he goes on beyond it.
    pub is_cut: [bool; 2],
}

/// What a pencil is to the patient.
#[derive(Clone, Debug)]
pub(super) enum Pencil {
    Inside,
    Edge(Carried),
    Outside,
}

impl Outline {
    /// Of a mask on an image; nothing where it is empty.
    pub fn new(image: &Grid, mask: &Mask) -> Option<Self> {
        let mut extent = [[usize::MAX, 0]; 3];
        for voxel in mask.indices() {
            for (range, place) in extent.iter_mut().zip(image.voxel(voxel)) {
                *range = [range[0].min(place), range[1].max(place)];
            }
        }
        if extent[0][0] > extent[0][1] {
            return None;
        }
        let grid = Grid {
            counts: extent.map(|[low, high]| high - low + 1),
            spacing_mm: image.spacing_mm,
            origin_mm: image.centre_mm(extent.map(|[low, _]| low)),
        };
        let inside = Mask::from_fn(grid.len(), |voxel| {
            let place = grid.voxel(voxel);
            mask.contains(image.index(std::array::from_fn(|axis| place[axis] + extent[axis][0])))
        });
        let is_cut = [extent[2][0] == 0, extent[2][1] + 1 == image.counts[2]];
        Some(Self { grid, inside: Arc::new(inside), is_cut })
    }

    /// Whether a place (mm) is inside of the patient.
    pub fn contains(&self, place_mm: [f64; 3]) -> bool {
        voxel_at(&self.grid, place_mm).is_some_and(|voxel| self.inside.contains(voxel))
    }

    /// Whether the ray from the source through a place of the isocentre plane (mm) crosses the patient.
    pub fn is_crossed(&self, frame: &BeamFrame, [x, z]: [f64; 2]) -> bool {
        let beyond = frame.patient_from_beam([2.0 * x, 2.0 * frame.sad_mm(), 2.0 * z]);
        segments(&self.grid, frame.source_mm(), beyond).any(|segment| self.inside.contains(segment.voxel))
    }

    /// Whether the ray from the source through a place of the isocentre plane (mm) crosses the patient, and comes to him through
    /// the room beyond the first or the last image where he goes on: the box around him, continued there. What it crosses in
    /// that room is not known.
    pub fn is_entered_by_an_end(&self, frame: &BeamFrame, [x, z]: [f64; 2]) -> bool {
        let (source, beyond) =
            (frame.source_mm(), frame.patient_from_beam([2.0 * x, 2.0 * frame.sad_mm(), 2.0 * z]));
        let Some(first) = segments(&self.grid, source, beyond).next() else { return false };
        let length_mm = self.grid.counts[2] as f64 * self.grid.spacing_mm[2];
        let low_mm = self.grid.origin_mm[2] - 0.5 * self.grid.spacing_mm[2];
        let enters_mm = source[2] + first.begin * (beyond[2] - source[2]);
        let is_at = |end_mm: f64| (enters_mm - end_mm).abs() < FACE_MM;
        let comes_by_an_end = (self.is_cut[0] && source[2] < low_mm && is_at(low_mm))
            || (self.is_cut[1] && source[2] > low_mm + length_mm && is_at(low_mm + length_mm));
        comes_by_an_end && self.is_crossed(frame, [x, z])
    }

    /// Whether every ray of a bixel that stands for a part of its area crosses the patient at least `inside_mm` within the
    /// edge of what the source sees of him; with a negative length, at most so far beside it.
    pub fn holds(&self, frame: &BeamFrame, bixel_mm: [f64; 2], width_mm: f64, inside_mm: f64) -> bool {
        let crossed = |x: f64, z: f64| self.is_crossed(frame, [x, z]);
        let is_ray_held = |[x, z]: [f64; 2]| {
            let around = |by: f64| AROUND.into_iter().map(move |[dx, dz]| [x + by * dx, z + by * dz]);
            if inside_mm < 0.0 {
                // Rays between are looked at, too, so that a thin part of the patient is not jumped over.
                crossed(x, z)
                    || [0.5, 1.0].iter().any(|part| around(part * inside_mm).any(|[x, z]| crossed(x, z)))
            } else {
                crossed(x, z) && (inside_mm == 0.0 || around(inside_mm).all(|[x, z]| crossed(x, z)))
            }
        };
        let ray = |[x, z]: [f64; 2]| [bixel_mm[0] + width_mm * x, bixel_mm[1] + width_mm * z];
        RAYS.into_iter().all(|part| is_ray_held(ray(part)))
    }

    /// The part of a bixel's area whose rays do not cross the patient: of 16 equal parts, by the middle of each.
    pub fn part_outside(&self, frame: &BeamFrame, bixel_mm: [f64; 2], width_mm: f64) -> f64 {
        const PARTS: i32 = 4;
        let places = || (0..PARTS).map(|i| width_mm * ((f64::from(i) + 0.5) / f64::from(PARTS) - 0.5));
        let missed = places()
            .flat_map(|x| places().map(move |z| [bixel_mm[0] + x, bixel_mm[1] + z]))
            .filter(|place| !self.is_crossed(frame, *place));
        missed.count() as f64 / f64::from(PARTS * PARTS)
    }

    /// What a pencil of this width is to the patient.
    pub fn pencil(
        &self,
        frame: &BeamFrame,
        bixel_mm: [f64; 2],
        width_mm: f64,
        (grid, density): (&Grid, &[f32]),
        machine: &Machine,
    ) -> Pencil {
        let [x, z] = bixel_mm;
        if !self.is_crossed(frame, bixel_mm) {
            return Pencil::Outside;
        }
        let around = |[dx, dz]: [f64; 2]| self.is_crossed(frame, [x + width_mm * dx, z + width_mm * dz]);
        match AROUND.into_iter().all(around) {
            true => Pencil::Inside,
            false => Pencil::Edge(Carried::new(self, frame, bixel_mm, (grid, density), machine)),
        }
    }
}

/// Depth doses of the components along a pencil, from its own way through the patient.
///
/// The depth dose of a component, `beta / (beta - m) (exp(-m d) - exp(-beta d))`, is the attenuated fluence `exp(-m s)`
/// folded with the forward kernel `beta exp(-beta (d - s))`. The fold is over water that is there: it begins where the
/// pencil enters the patient, and in a gap outside of the outline only the decay goes on, as in the tissue beside it.
/// Where the pencil is in water all along, this is the depth dose.
#[derive(Clone, Debug)]
pub(super) struct Carried {
    /// Place of the first sample along the beam's axis, mm.
    first_mm: f32,
    /// One for each step.
    doses: Vec<[f32; 4]>,
}

impl Carried {
    fn new(
        outline: &Outline,
        frame: &BeamFrame,
        [x, z]: [f64; 2],
        (grid, density): (&Grid, &[f32]),
        machine: &Machine,
    ) -> Self {
        let along: Vec<f64> =
            corners(&outline.grid).map(|corner| frame.beam_from_patient(corner)[1]).collect();
        let margin_mm = outline.grid.spacing_mm.into_iter().fold(STEP_MM, f64::max);
        let first_mm = along.iter().copied().fold(f64::INFINITY, f64::min) - margin_mm;
        let last_mm = along.iter().copied().fold(f64::NEG_INFINITY, f64::max) + margin_mm;
        let sad_mm = frame.sad_mm();
        let step_mm = STEP_MM * libm::sqrt(x * x + sad_mm * sad_mm + z * z) / sad_mm;
        let (m, betas) = (machine.file().m_per_mm, &machine.file().betas_per_mm);
        let mut carried = [0.0_f64; COMPONENTS];
        let mut fluence = 1.0;
        let mut doses = vec![[0.0; 4]];
        for step in 0..libm::ceil((last_mm - first_mm) / STEP_MM) as usize {
            let y = first_mm + (step as f64 + 0.5) * STEP_MM;
            let place = frame.patient_from_beam([x * y / sad_mm, y, z * y / sad_mm]);
            let is_inside = voxel_at(&outline.grid, place).is_some_and(|v| outline.inside.contains(v));
            let water_mm = match voxel_at(grid, place) {
                Some(voxel) if is_inside => step_mm * f64::from(density[voxel]),
                _ => 0.0,
            };
            let decay_mm = if is_inside { water_mm } else { step_mm };
            let passed = libm::exp(-m * water_mm);
            for (dose, beta) in carried.iter_mut().zip(betas) {
                *dose *= libm::exp(-beta * decay_mm);
                if water_mm > 0.0 {
                    *dose += fluence * beta / (beta - m) * (passed - libm::exp(-beta * water_mm));
                }
            }
            fluence *= passed;
            let [a, b, c] = carried.map(|dose| dose as f32);
            doses.push([a, b, c, 0.0]);
        }
        Self { first_mm: first_mm as f32, doses }
    }

    /// The depth dose of a voxel, with the inverse square of its distance, held to what the pencil carries in the plane of
    /// the voxel.
    #[inline]
    pub fn holding(&self, depth_dose: &[f32; 4], y_mm: f32, inverse_square: f32) -> [f32; 4] {
        let place = ((y_mm - self.first_mm) / STEP_MM as f32).clamp(0.0, (self.doses.len() - 1) as f32);
        let before = place as usize;
        let part = place - before as f32;
        let (near, far) = (&self.doses[before], &self.doses[(before + 1).min(self.doses.len() - 1)]);
        std::array::from_fn(|c| depth_dose[c].min((near[c] + part * (far[c] - near[c])) * inverse_square))
    }
}

/// The voxel of a grid that a place lies in.
fn voxel_at(grid: &Grid, place_mm: [f64; 3]) -> Option<usize> {
    let mut voxel = [0; 3];
    for axis in 0..3 {
        let at = libm::round((place_mm[axis] - grid.origin_mm[axis]) / grid.spacing_mm[axis]);
        if !(at >= 0.0 && at < grid.counts[axis] as f64) {
            return None;
        }
        voxel[axis] = at as usize;
    }
    Some(grid.index(voxel))
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_patient::case::PatientPosition::HeadFirstSupine;

    /// A block of water, 100 mm wide along x and z, 200 mm deep, in an image twice as wide.
    fn block() -> (Grid, Outline, Vec<f32>) {
        let image =
            Grid { counts: [80, 80, 40], spacing_mm: [2.5, 2.5, 5.0], origin_mm: [-98.75, -98.75, -97.5] };
        let mask = Mask::from_fn(image.len(), |voxel| {
            let [x, _, z] = image.centre_mm(image.voxel(voxel));
            x.abs() < 50.0 && z.abs() < 50.0
        });
        let density = (0..image.len()).map(|voxel| if mask.contains(voxel) { 1.0 } else { 0.0 }).collect();
        (image, Outline::new(&image, &mask).unwrap(), density)
    }

    #[test]
    fn a_bixel_is_held_where_its_rays_cross_the_block_and_flash_lets_it_out() {
        let (_, outline, _) = block();
        let frame = BeamFrame::new(0.0, HeadFirstSupine, [0.0; 3], 1000.0);
        // Seen from the source the front of the block, 900 mm away, reaches 55.6 mm on the isocentre plane.
        let held = |x: f64, inside_mm: f64| outline.holds(&frame, [x, 0.0], 10.0, inside_mm);
        assert!(held(50.0, 0.0) && !held(55.0, 0.0) && !held(60.0, 0.0));
        assert!(held(40.0, 10.0) && !held(50.0, 10.0));
        assert!(held(60.0, -10.0) && !held(70.0, -10.0));
        assert_eq!(outline.part_outside(&frame, [0.0, 0.0], 10.0), 0.0);
        assert_eq!(outline.part_outside(&frame, [90.0, 0.0], 10.0), 1.0);
        assert_eq!(outline.part_outside(&frame, [55.6, 0.0], 10.0), 0.5);
    }

    #[test]
    fn a_pencil_in_water_carries_its_depth_dose_and_one_beside_it_nothing() {
        let (image, outline, density) = block();
        let machine = Machine::shipped().unwrap();
        let frame = BeamFrame::new(0.0, HeadFirstSupine, [0.0; 3], 1000.0);
        let pencil = |x: f64| outline.pencil(&frame, [x, 0.0], 10.0, (&image, &density), &machine);
        assert!(matches!(pencil(0.0), Pencil::Inside) && matches!(pencil(60.0), Pencil::Outside));
        let Pencil::Edge(edge) = pencil(50.0) else { panic!("the edge is 5.6 mm away") };
        // At 50 mm it runs in the block from 900 to 1000 mm from the source, and leaves through its side.
        let held = |y: f32| edge.holding(&[1e3; 4], y, 1.0);
        for depth in [5.0, 30.0, 95.0] {
            let expected = machine.depth_dose(depth);
            for (c, expected) in expected.into_iter().enumerate() {
                let found = f64::from(held(900.0 + depth as f32)[c]);
                assert!((found - expected).abs() < 0.03, "{depth} mm, {c}: {found}, {expected}");
            }
        }
        assert_eq!(held(890.0), [0.0; 4]);
        // Electrons end within centimetres of the way out.
        assert!(held(1050.0)[0] < 1e-3 * held(990.0)[0]);
        assert_eq!(edge.holding(&[1e-6; 4], 950.0, 1.0)[..3], [1e-6; 3]);
    }
}
