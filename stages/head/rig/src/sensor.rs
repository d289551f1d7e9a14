//! From what a camera would see to the depth image that it would give.
//!
//! Every pixel takes 32 random bits, and a pixel at an edge three words more, row by row from the top left.

use rand::Rng;

use crate::camera::Pinhole;
use crate::noise::{DEPTH_UNIT_M, NoiseModel};
use crate::normal::NormalTable;
use crate::shadow::light_row;
use crate::view::RenderedView;

/// Why no image is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SenseError {
    /// A view of another camera.
    #[error("the view has {found:?} pixels; the sensor has {expected:?}")]
    ViewSize {
        /// Columns and rows of the sensor.
        expected: (usize, usize),
        /// Columns and rows of the view.
        found: (usize, usize),
    },
    /// A buffer that does not hold one image.
    #[error("the depth buffer holds {found} pixels; an image has {expected}")]
    BufferSize {
        /// Pixels of an image.
        expected: usize,
        /// Pixels of the buffer.
        found: usize,
    },
}

const ANGLE_STEPS: usize = 256;
/// Pixels looked through for edges at once.
const BLOCK: usize = 16;

/// A depth camera's errors, with the buffers that a frame needs; no allocation after construction.
#[derive(Debug, Clone)]
pub struct DepthSensor {
    width: usize,
    height: usize,
    model: NoiseModel,
    normal: NormalTable,
    /// The angle's part of the deviation, by the cosine in 256 equal steps.
    angle_terms: [f32; ANGLE_STEPS],
    constants: Constants,
    /// Words below these drop out, swap or mix at an edge.
    edge_chances: [u64; 3],
    random: Vec<u8>,
    words: Vec<u32>,
    sigma: Vec<f32>,
    noisy: Vec<f32>,
    lit: Vec<bool>,
    edge: Vec<bool>,
}

/// The model's numbers in the form in which the loop over pixels takes them.
#[derive(Debug, Clone, Copy)]
struct Constants {
    floor: f32,
    growth: f32,
    best: f32,
    grazing_cosine: f32,
    near: f32,
    far: f32,
    /// Words below this fail.
    dropout: u32,
    edge_jump: f32,
    /// fx times the baseline, in pixel metres.
    focal_baseline: f32,
    disparity_step: f32,
}

impl DepthSensor {
    /// A sensor for views of `camera` with the errors of `model`.
    pub fn new(camera: &Pinhole, model: NoiseModel) -> Self {
        let p = model.params();
        let constants = Constants {
            floor: p.axial_floor as f32,
            growth: p.axial_growth as f32,
            best: p.axial_best as f32,
            grazing_cosine: libm::cos(p.grazing) as f32,
            near: p.near as f32,
            far: p.far as f32,
            dropout: chance(p.dropout) as u32,
            edge_jump: p.edge_jump as f32,
            focal_baseline: (camera.fx() * p.baseline) as f32,
            disparity_step: p.disparity_step as f32,
        };
        let angle_terms =
            core::array::from_fn(|step| model.angle_term((step as f64 + 0.5) / ANGLE_STEPS as f64) as f32);
        Self {
            width: camera.width(),
            height: camera.height(),
            model,
            normal: NormalTable::new(),
            angle_terms,
            constants,
            edge_chances: [
                chance(p.edge_dropout),
                chance(p.edge_dropout + p.edge_swap),
                chance(p.edge_dropout + p.edge_swap + p.edge_mix),
            ],
            random: vec![0; 4 * camera.width()],
            words: vec![0; camera.width()],
            sigma: vec![0.0; camera.width()],
            noisy: vec![0.0; camera.width()],
            lit: vec![true; camera.width()],
            edge: vec![false; camera.width()],
        }
    }

    /// The model whose errors the sensor has.
    pub fn model(&self) -> &NoiseModel {
        &self.model
    }

    /// Writes the depth image of `view` in units of 0.1 mm, 0 where nothing is measured,
    /// row by row from the top left. The same generator state gives the same bytes.
    ///
    /// # Errors
    /// [`SenseError`] when the view or the buffer has another size than the sensor.
    pub fn sense(
        &mut self,
        view: &RenderedView,
        rng: &mut impl Rng,
        depth: &mut [u16],
    ) -> Result<(), SenseError> {
        let expected = (self.width, self.height);
        let found = (view.width(), view.height());
        if expected != found {
            return Err(SenseError::ViewSize { expected, found });
        }
        if depth.len() != self.width * self.height {
            return Err(SenseError::BufferSize { expected: self.width * self.height, found: depth.len() });
        }
        for (v, row) in depth.chunks_exact_mut(self.width).enumerate() {
            self.sense_surfaces(view, v, rng, row);
            self.sense_edges(view, v, rng, row);
        }
        Ok(())
    }

    /// One row as if there were no edges. Loops without lookups are apart, since they run four pixels at a time.
    fn sense_surfaces(&mut self, view: &RenderedView, v: usize, rng: &mut impl Rng, row: &mut [u16]) {
        let pixels = v * self.width..(v + 1) * self.width;
        let (depths, cosines) = (&view.depth_m()[pixels.clone()], &view.cosine()[pixels]);
        let c = self.constants;
        if c.focal_baseline != 0.0 {
            light_row(depths, c.focal_baseline, &mut self.noisy, &mut self.lit);
        }
        rng.fill_bytes(&mut self.random);
        for (word, bytes) in self.words.iter_mut().zip(self.random.as_chunks::<4>().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        for (sigma, &z) in self.sigma.iter_mut().zip(depths) {
            *sigma = 1.0 / z.sqrt();
        }
        for ((sigma, &z), &cosine) in self.sigma.iter_mut().zip(depths).zip(cosines) {
            let step = (cosine * ANGLE_STEPS as f32) as i32;
            let angle_term = self.angle_terms[step.clamp(0, ANGLE_STEPS as i32 - 1) as usize];
            *sigma = c.floor + c.growth * (z - c.best) * (z - c.best) + angle_term * *sigma;
        }
        for (noisy, &word) in self.noisy.iter_mut().zip(&self.words) {
            *noisy = self.normal.deviate(word);
        }
        for ((noisy, &z), &sigma) in self.noisy.iter_mut().zip(depths).zip(&self.sigma) {
            *noisy = c.to_disparity(z + sigma * *noisy);
        }
        let surfaces = self.noisy.iter().zip(&self.words).zip(cosines).zip(&self.lit);
        for (out, (((&noisy, &word), &cosine), &lit)) in row.iter_mut().zip(surfaces) {
            // An odd factor permutes the words, so that those that fail are spread over all deviates.
            let works = word.wrapping_mul(0x9e37_79b1) >= c.dropout;
            let valid = lit & works & (cosine >= c.grazing_cosine);
            // A mask and not a branch: what fails cannot be predicted.
            *out = c.to_units(noisy) & u16::from(valid).wrapping_neg();
        }
    }

    /// The pixels of one row beside which the depth jumps.
    fn sense_edges(&mut self, view: &RenderedView, v: usize, rng: &mut impl Rng, row: &mut [u16]) {
        if self.edge_chances[2] == 0 {
            return;
        }
        self.mark_edges(view, v);
        for (block, (edges, outs)) in self.edge.chunks(BLOCK).zip(row.chunks_mut(BLOCK)).enumerate() {
            // Edges are few: most blocks have none, and are seen to at once.
            if !edges.iter().fold(false, |any, &edge| any | edge) {
                continue;
            }
            for (place, (&edge, out)) in edges.iter().zip(outs).enumerate() {
                if edge && *out != 0 {
                    *out = self.sense_edge(view, block * BLOCK + place, v, rng, *out);
                }
            }
        }
    }

    /// One pixel beside which the depth jumps, that would have been `undisturbed`.
    fn sense_edge(
        &self,
        view: &RenderedView,
        u: usize,
        v: usize,
        rng: &mut impl Rng,
        undisturbed: u16,
    ) -> u16 {
        let z = view.depth_m()[v * self.width + u];
        let beyond = self.across_the_edge(view, u, v);
        let (what, word) = (u64::from(rng.next_u32()), rng.next_u32());
        let share = rng.next_u32() as f32 * (1.0 / 4_294_967_296.0);
        let [dropout, swap, mix] = self.edge_chances;
        if what < dropout {
            0
        } else if what < swap {
            self.measure(u, beyond, word)
        } else if what < mix {
            self.measure(u, z + (beyond - z) * share, word)
        } else {
            undisturbed
        }
    }

    fn mark_edges(&mut self, view: &RenderedView, v: usize) {
        let depths = view.depth_m();
        let row = |v: usize| &depths[v * self.width..(v + 1) * self.width];
        let (here, above, below) = (row(v), row(v.saturating_sub(1)), row((v + 1).min(self.height - 1)));
        let jump = self.constants.edge_jump;
        let columns = here.iter().zip(above).zip(below);
        for (edge, ((&z, &above), &below)) in self.edge.iter_mut().zip(columns) {
            *edge = ((above - z).abs() > jump * z) | ((below - z).abs() > jump * z);
        }
        // To the left and to the right, as two loops without a carried value.
        for (edge, pair) in self.edge.iter_mut().zip(here.windows(2)) {
            *edge |= (pair[1] - pair[0]).abs() > jump * pair[0];
        }
        for (edge, pair) in self.edge[1..].iter_mut().zip(here.windows(2)) {
            *edge |= (pair[0] - pair[1]).abs() > jump * pair[1];
        }
    }

    /// The depth of the neighbour that differs most.
    fn across_the_edge(&self, view: &RenderedView, u: usize, v: usize) -> f32 {
        let depth = |u: usize, v: usize| view.depth_m()[v * self.width + u];
        let z = depth(u, v);
        let neighbours = [
            depth(u.saturating_sub(1), v),
            depth((u + 1).min(self.width - 1), v),
            depth(u, v.saturating_sub(1)),
            depth(u, (v + 1).min(self.height - 1)),
        ];
        neighbours
            .into_iter()
            .fold(z, |far, near| if (near - z).abs() > (far - z).abs() { near } else { far })
    }

    /// A depth in column `u` with that pixel's deviation, in units; 0 out of range.
    fn measure(&self, u: usize, z: f32, word: u32) -> u16 {
        let noisy = z + self.sigma[u] * self.normal.deviate(word);
        self.constants.to_units(self.constants.to_disparity(noisy))
    }
}

impl Constants {
    /// The depth as the nearest step of disparity gives it.
    #[inline]
    fn to_disparity(self, z: f32) -> f32 {
        if self.disparity_step == 0.0 {
            return z;
        }
        let steps_at_one_metre = self.focal_baseline.abs() / self.disparity_step;
        // The cast rounds down, since disparities are positive.
        steps_at_one_metre / (steps_at_one_metre / z + 0.5) as i32 as f32
    }

    /// The depth in units of the image; 0 out of range. An infinite depth has come to NaN or infinity.
    #[inline]
    fn to_units(self, z: f32) -> u16 {
        let in_range = (z >= self.near) & (z <= self.far);
        let z = if in_range { z } else { 0.0 };
        (z * (1.0 / DEPTH_UNIT_M) as f32 + 0.5) as i32 as u16 & u16::from(in_range).wrapping_neg()
    }
}

/// A probability as the number of 32-bit words out of all.
fn chance(probability: f64) -> u64 {
    (probability * 4_294_967_296.0) as u64
}
