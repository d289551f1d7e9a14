//! Scatter of a pencil in water, which shares the scatter of a field among its bixels.

use super::section::Superposition;
use super::terma::Terma;

/// Distance between depths, mm.
const DEPTH_STEP_MM: f64 = 10.0;
/// Deepest, mm.
const DEEPEST_MM: f64 = 500.0;
/// Distance between distances from the axis, mm.
const RADIUS_STEP_MM: f64 = 2.5;
/// Distance between sources along the pencil, mm.
const SOURCE_STEP_MM: f64 = 5.0;
/// Places across the square of a bixel, along each axis, over which the dose is a mean.
const ACROSS: usize = 4;

/// Dose by depth in water and distance from the axis, for a bixel of fluence 1.
#[derive(Clone, Debug)]
pub(super) struct ScatterPencil {
    doses: Vec<f32>,
    radii: usize,
}

impl ScatterPencil {
    /// Of a square bixel of this width, out to this distance, mm.
    pub fn new(section: &Superposition, width_mm: f64, farthest_mm: f64) -> Self {
        let terma = Terma::new(section);
        let densities = densities(section);
        let shell_mm = section.scatter.shell_mm;
        let edges: Vec<f64> =
            section.scatter.edges_deg.iter().map(|deg| libm::cos(deg.to_radians())).collect();
        let reach_mm = shell_mm * densities[0].len() as f64;
        // The kernel at a place behind (along > 0) and beside an interaction, 1/mm3.
        let kernel = |along: f64, off2: f64| {
            let distance = libm::sqrt(along * along + off2);
            let shell = (distance / shell_mm) as usize;
            let cos = if distance > 0.0 { along / distance } else { 1.0 };
            let ring = (edges.partition_point(|edge| *edge >= cos)).clamp(1, densities.len()) - 1;
            densities[ring].get(shell).copied().unwrap_or(0.0)
        };
        let (depths, radii) =
            ((DEEPEST_MM / DEPTH_STEP_MM) as usize + 1, (farthest_mm / RADIUS_STEP_MM).ceil() as usize + 2);
        let places: Vec<f64> =
            (0..ACROSS).map(|i| width_mm * ((i as f64 + 0.5) / ACROSS as f64 - 0.5)).collect();
        let mut doses = Vec::with_capacity(depths * radii);
        for depth in (0..depths).map(|depth| depth as f64 * DEPTH_STEP_MM) {
            // Symmetric in both axes: a quarter of the places stands for all.
            let sources = ((depth + reach_mm) / SOURCE_STEP_MM) as usize;
            let first = (((depth - reach_mm) / SOURCE_STEP_MM).max(0.0)) as usize;
            for radius in (0..radii).map(|radius| radius as f64 * RADIUS_STEP_MM) {
                let mut sum = 0.0;
                for source in first..sources {
                    let at = (source as f64 + 0.5) * SOURCE_STEP_MM;
                    let mut mean = 0.0;
                    for dx in &places {
                        for dz in &places[..ACROSS / 2] {
                            mean += kernel(depth - at, (radius + dx) * (radius + dx) + dz * dz);
                        }
                    }
                    sum += f64::from(terma.at(at)[1]) * mean;
                }
                let parts = (ACROSS * (ACROSS / 2)) as f64;
                doses.push((sum * SOURCE_STEP_MM * width_mm * width_mm / parts) as f32);
            }
        }
        Self { doses, radii }
    }

    /// Dose at a depth in water and a distance from the axis, mm.
    #[inline]
    pub fn at(&self, depth_mm: f32, distance_mm: f32) -> f32 {
        let last = (self.doses.len() / self.radii - 2) as f32;
        let depth = depth_mm * (1.0 / DEPTH_STEP_MM as f32);
        let row = depth.min(last) as usize;
        let down = (depth - row as f32).min(1.0);
        let radius = distance_mm * (1.0 / RADIUS_STEP_MM as f32);
        let column = (radius as usize).min(self.radii - 2);
        let right = (radius - column as f32).min(1.0);
        let start = row * self.radii + column;
        let (above, below) =
            (&self.doses[start..start + 2], &self.doses[start + self.radii..start + self.radii + 2]);
        (above[0] + right * (above[1] - above[0])) * (1.0 - down)
            + (below[0] + right * (below[1] - below[0])) * down
    }
}

/// Density of the scatter kernel by ring and shell, 1/mm3.
fn densities(section: &Superposition) -> Vec<Vec<f64>> {
    let kernels = &section.scatter;
    let cube = |shell: usize| libm::pow(shell as f64 * kernels.shell_mm, 3.0);
    let ring = |(energy, edges): (&Vec<f64>, &[f64])| {
        let [low, high] = [edges[0], edges[1]].map(|deg| libm::cos(deg.to_radians()));
        let angle = std::f64::consts::TAU * (low - high);
        let of = |(shell, part): (usize, &f64)| part * 3.0 / (angle * (cube(shell + 1) - cube(shell)));
        energy.iter().enumerate().map(of).collect()
    };
    kernels.energy[0].iter().zip(kernels.edges_deg.windows(2)).map(ring).collect()
}
