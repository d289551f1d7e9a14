//! Noise of tissue and scanner: a plan on flat tissue would be kinder than any patient.

use chacha20::ChaCha8Rng;
use chacha20::rand_core::{Rng, SeedableRng};

use super::anatomy::BodyPart;
use crate::Grid;

/// Distance of the knots between which tissue changes.
const KNOT_MM: f64 = 12.0;
/// Standard deviation of the scanner's noise.
const SCANNER_HU: f64 = 9.0;
/// A stream of its own: the anatomy does not change when the texture does.
const STREAM: u64 = 1;

/// Hounsfield units of tissue, voxel by voxel in the order of the grid.
pub struct Texture {
    random: ChaCha8Rng,
    knots: [usize; 3],
    values: Vec<f64>,
    knots_per_voxel: [f64; 3],
}

impl Texture {
    /// The texture of this seed.
    pub fn of_seed(seed: u64, grid: &Grid) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(STREAM);
        let knots_per_voxel = grid.spacing_mm.map(|s| s / KNOT_MM);
        let knots = [0, 1, 2].map(|axis| (grid.counts[axis] as f64 * knots_per_voxel[axis]) as usize + 2);
        let values = (0..knots.iter().product()).map(|_| normal(&mut random)).collect();
        Self { random, knots, values, knots_per_voxel }
    }

    /// Hounsfield units of the next voxel of the grid.
    pub fn hu(&mut self, part: BodyPart, voxel: [usize; 3]) -> i16 {
        let (mean, spread) = match part {
            BodyPart::Air => (-1000.0, 0.0),
            BodyPart::Fat => (-95.0, 10.0),
            BodyPart::Muscle => (52.0, 14.0),
            BodyPart::Cortex => (720.0, 110.0),
            BodyPart::Marrow => (270.0, 60.0),
            BodyPart::Bladder => (9.0, 2.0),
            BodyPart::RectumWall => (42.0, 8.0),
            BodyPart::Stool => (28.0, 25.0),
            BodyPart::Gas => (-880.0, 40.0),
            BodyPart::Prostate => (42.0, 7.0),
            BodyPart::Tumour => (45.0, 8.0),
            BodyPart::Bowel => (25.0, 20.0),
            BodyPart::Metal => (2900.0, 20.0),
        };
        self.value(mean, spread, voxel)
    }

    /// Hounsfield units of the next voxel of the grid, of a tissue with this mean and spread.
    pub fn value(&mut self, mean: f64, spread: f64, voxel: [usize; 3]) -> i16 {
        let scanner = SCANNER_HU * normal(&mut self.random);
        let hu = mean + spread * self.smooth(voxel) + scanner;
        libm::round(hu).clamp(-1024.0, 3000.0) as i16
    }

    /// Values between the knots.
    fn smooth(&self, voxel: [usize; 3]) -> f64 {
        let place = [0, 1, 2].map(|axis| voxel[axis] as f64 * self.knots_per_voxel[axis]);
        let low = place.map(|p| p as usize);
        let part = [0, 1, 2].map(|axis| place[axis] - low[axis] as f64);
        let mut sum = 0.0;
        for corner in 0..8_usize {
            let up = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight: f64 =
                (0..3).map(|axis| if up[axis] == 1 { part[axis] } else { 1.0 - part[axis] }).product();
            let [x, y, z] = [0, 1, 2].map(|axis| low[axis] + up[axis]);
            sum += weight * self.values[x + self.knots[0] * (y + self.knots[1] * z)];
        }
        sum
    }
}

/// Nearly normal with mean 0 and standard deviation 1: a sum of four uniform numbers needs no logarithm, so that it is the
/// same everywhere.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let bits = random.next_u64();
    let sum: u64 = (0..4).map(|i| bits >> (16 * i) & 0xffff).sum();
    // Each has variance 1/12 of its range squared.
    (sum as f64 / 65536.0 - 2.0) * libm::sqrt(3.0)
}
