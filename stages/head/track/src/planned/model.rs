//! The surface of a patient from all sides, and what a camera sees of it.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::buckets::Buckets;
use crate::surface::{Surface, SurfaceError, SurfaceParams};

/// Distance of the points that are kept, m.
const SPACING: f64 = 2.5e-3;
/// Surfaces seen more obliquely than this (cosine) are not seen.
const COSINE: f64 = 0.25;
/// Width of the cells of directions in which the nearest surface hides what is behind it, and how far behind, m at the
/// distance of the surface.
const CELL: f64 = 5e-3;
const BEHIND: f64 = 20e-3;
/// Nearer than this no camera sees, m.
const NEAR: f64 = 0.05;

/// Points of a surface with normals that point outwards, in a frame of their own, m.
#[derive(Debug, Clone)]
pub struct Model {
    points: Vec<Vector3<f64>>,
    normals: Vec<Vector3<f64>>,
    surface: Surface,
}

impl Model {
    /// A model of points with unit normals that point outwards, m.
    ///
    /// # Errors
    /// Points that make no surface, or one that is too large for a head.
    pub fn new(
        points: &[(Vector3<f64>, Vector3<f64>)],
        params: &SurfaceParams,
    ) -> Result<Self, SurfaceError> {
        let places: Vec<Vector3<f64>> = points.iter().map(|(at, _)| *at).collect();
        let buckets = Buckets::new(&places, SPACING);
        let (numbers, count) = buckets.numbers();
        let mut normals = vec![Vector3::zeros(); count];
        for (number, (_, normal)) in numbers.iter().zip(points) {
            normals[*number as usize] += normal;
        }
        // A cell that holds both sides of something thin has no normal.
        let retained = buckets
            .means()
            .into_iter()
            .zip(normals)
            .filter_map(|(at, sum)| Some((at, sum.try_normalize(0.5)?)));
        let (points, normals): (Vec<_>, Vec<_>) = retained.unzip();
        let surface = Surface::oriented(&points, &normals, params)?;
        Ok(Self { points, normals, surface })
    }

    /// The whole surface, about its [`centre`](Surface::centre).
    #[must_use]
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The mean of the points that face a viewer far away in this direction (unit, in the model's frame).
    #[must_use]
    pub fn middle_seen_from(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        let (mut sum, mut weights) = (Vector3::zeros(), 0.0);
        for (at, normal) in self.points.iter().zip(&self.normals).step_by(8) {
            let cosine = normal.dot(direction);
            // A camera has fewer pixels on what it sees obliquely.
            let weight = if cosine > COSINE { cosine } else { 0.0 };
            sum += at * weight;
            weights += weight;
        }
        sum / f64::max(weights, 1e-9)
    }

    /// The points that a camera sees which looks along z from the origin of its frame, in that frame, m.
    #[must_use]
    pub fn seen(&self, camera_from_model: &Isometry3<f64>) -> Vec<Vector3<f64>> {
        let placed = self.points.iter().zip(&self.normals).filter_map(|(at, normal)| {
            let at = (camera_from_model * Point3::from(*at)).coords;
            let facing = -(camera_from_model.rotation * normal).dot(&at) / at.norm();
            (at.z > NEAR && facing > COSINE).then_some(at)
        });
        let placed: Vec<Vector3<f64>> = placed.collect();
        let distance = placed.iter().map(|p| p.z).sum::<f64>() / placed.len().max(1) as f64;
        let cell = |p: &Vector3<f64>| [p.x, p.y].map(|c| (c / p.z * distance / CELL).floor() as i64);
        let mut nearest: BTreeMap<[i64; 2], f64> = BTreeMap::new();
        for point in &placed {
            let least = nearest.entry(cell(point)).or_insert(f64::INFINITY);
            *least = least.min(point.z);
        }
        let is_before = |p: &&Vector3<f64>| nearest.get(&cell(p)).is_none_or(|least| p.z < least + BEHIND);
        placed.iter().filter(is_before).copied().collect()
    }
}
