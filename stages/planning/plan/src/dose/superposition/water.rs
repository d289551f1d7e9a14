//! Dose at places in a water tank, as a linear function of the TERMA over depth: what a fit of the spectrum needs.
//!
//! The sum is that of `gather`, without voxels: from each place backwards along the axis of each cone, shell by shell. The
//! shares are filed by the depth of the water at which they begin, so one pass serves every spectrum.

use super::directions;
use super::section::{PointKernels, Superposition};

/// Distance between the depths by which shares are filed, mm.
pub(crate) const NODE_MM: f64 = 2.0;
/// Longest step along an axis, mm.
const STEP_MM: f64 = 2.5;
/// Distance between the places at which the edge of a field is tabulated, mm.
const EDGE_STEP_MM: f64 = 0.25;
/// Distance on both sides of an edge that is tabulated, mm.
const EDGE_REACH_MM: f64 = 60.0;

/// A rectangular open field on a water tank whose surface is perpendicular to the axis.
#[derive(Clone, Copy)]
pub(crate) struct TankField<'a> {
    /// Sides on the isocentre plane, mm: x and z of the beam.
    pub sides_mm: [f64; 2],
    /// From the source to the surface, mm.
    pub ssd_mm: f64,
    /// From the source to the isocentre, mm.
    pub sad_mm: f64,
    /// Full width at half maximum of the Gaussian that blurs the edges, mm.
    pub penumbra_mm: f64,
    /// Fluence over the distance from the axis on the isocentre plane, mm.
    pub fluence: &'a dyn Fn(f64) -> f64,
}

/// Dose at a place for each unit of TERMA at the depths `0, NODE_MM, ...`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Response {
    /// Depth of the place along its ray, mm of water.
    pub depth_mm: f64,
    /// Of the primary, for the kernels of the first and of the last depth.
    pub primary: [Vec<f64>; 2],
    /// Of the scatter.
    pub scatter: Vec<f64>,
}

/// The edge of a field: the part of the fluence over the distance outwards from the edge.
struct Edge(Vec<f64>);

impl Edge {
    fn new(penumbra_mm: f64) -> Self {
        let sigma = penumbra_mm / libm::sqrt(8.0 * core::f64::consts::LN_2);
        let steps = (2.0 * EDGE_REACH_MM / EDGE_STEP_MM) as usize;
        let of = |step: usize| {
            let outside = step as f64 * EDGE_STEP_MM - EDGE_REACH_MM;
            0.5 * libm::erfc(outside / sigma * core::f64::consts::FRAC_1_SQRT_2)
        };
        Self((0..=steps).map(of).collect())
    }

    #[inline]
    fn at(&self, outside_mm: f64) -> f64 {
        let place = (outside_mm + EDGE_REACH_MM) / EDGE_STEP_MM;
        if place <= 0.0 {
            return 1.0;
        }
        let low = place as usize;
        match (self.0.get(low), self.0.get(low + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (place - low as f64),
            _ => 0.0,
        }
    }
}

/// The responses at places `[x, depth, z]` below the surface (mm; x and z from the axis at that depth).
pub(crate) fn responses(
    section: &Superposition,
    field: &TankField<'_>,
    places: &[[f64; 3]],
) -> Vec<Response> {
    let edge = Edge::new(field.penumbra_mm);
    let deepest = places.iter().map(|place| place[1]).fold(0.0, f64::max);
    let nodes = ((deepest + section.scatter.shells_mm()) * 1.2 / NODE_MM) as usize + 2;
    let cones = |kernels: &PointKernels, depth: usize| Cones::new(kernels, depth);
    let primary = [cones(&section.primary, 0), cones(&section.primary, section.primary.depths_mm.len() - 1)];
    let scatter = cones(&section.scatter, 0);
    let of = |place: &[f64; 3]| {
        let at = [place[0], field.ssd_mm + place[1], place[2]];
        let file = |cones: &Cones| {
            let mut filed = vec![0.0; nodes];
            cones.each_share(field, &edge, at, |depth_mm, share| {
                let node = depth_mm / NODE_MM;
                let low = (node as usize).min(nodes - 2);
                let part = (node - low as f64).min(1.0);
                filed[low] += share * (1.0 - part);
                filed[low + 1] += share * part;
            });
            filed
        };
        let [first, last] = &primary;
        Response {
            depth_mm: depth_mm(field, at),
            primary: [file(first), file(last)],
            scatter: file(&scatter),
        }
    };
    places.iter().map(of).collect()
}

/// Depth along the ray to a place of the beam's frame, mm.
fn depth_mm(field: &TankField<'_>, at: [f64; 3]) -> f64 {
    (at[1] - field.ssd_mm) * libm::sqrt(1.0 + (at[0] * at[0] + at[2] * at[2]) / (at[1] * at[1]))
}

/// Axes with the energy of each step.
struct Cones {
    axes: Vec<directions::Axis>,
    /// By ring and step.
    energy: Vec<Vec<f64>>,
    step_mm: f64,
}

impl Cones {
    fn new(kernels: &PointKernels, depth: usize) -> Self {
        let parts = (kernels.shell_mm / STEP_MM).ceil().max(1.0);
        let ring = |(energy, cones): (&Vec<f64>, &usize)| {
            let each = |shell: &f64| std::iter::repeat_n(shell / (*cones as f64 * parts), parts as usize);
            energy.iter().flat_map(each).collect()
        };
        Self {
            axes: directions::axes(kernels),
            energy: kernels.energy[depth].iter().zip(&kernels.cones).map(ring).collect(),
            step_mm: kernels.shell_mm / parts,
        }
    }

    /// The depth and the fluence with its inverse square of each step, times its energy.
    fn each_share(&self, field: &TankField<'_>, edge: &Edge, at: [f64; 3], mut visit: impl FnMut(f64, f64)) {
        let half = field.sides_mm.map(|side| 0.5 * side);
        for axis in &self.axes {
            let [dx, dy, dz] = axis.towards;
            for (step, energy) in self.energy[axis.ring].iter().enumerate() {
                let begin = step as f64 * self.step_mm;
                let mut length = self.step_mm;
                if dy > 0.0 {
                    // Above the surface there is nothing.
                    length = length.min((at[1] - field.ssd_mm) / dy - begin);
                    if length <= 0.0 {
                        break;
                    }
                }
                let back = begin + 0.5 * length;
                let place = [at[0] - back * dx, at[1] - back * dy, at[2] - back * dz];
                let scale = field.sad_mm / place[1];
                let (x, z) = (place[0] * scale, place[2] * scale);
                let fluence = edge.at(x.abs() - half[0]) * edge.at(z.abs() - half[1]);
                if fluence > 0.0 {
                    let fluence = fluence * (field.fluence)(libm::hypot(x, z));
                    // The inverse square of the distance along the ray, and TERMA counts along the axis.
                    let square = field.sad_mm * field.sad_mm
                        / (place[0] * place[0] + place[1] * place[1] + place[2] * place[2]);
                    let part = energy * length / self.step_mm;
                    visit(depth_mm(field, place), part * fluence * square);
                }
            }
        }
    }
}
