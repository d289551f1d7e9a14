//! The outline of a patient as a mesh of triangles.
//!
//! - `march`: where a volume crosses a value
//! - `body`: the outline of a case
//! - `ply`, `stl`: the files that hold a mesh, written and read
//! - `file`: a surface from a file of any of these kinds, or from a case

mod body;
mod file;
mod march;
mod ply;
mod stl;

pub use body::{NoOutline, outline};
pub use file::{PatientSurface, SurfaceFileError, read_surface};
pub use march::march;
pub use ply::{read_ply, write_ply};
pub use stl::{read_stl, write_stl};

use nalgebra::Vector3;
use thiserror::Error;

use crate::case::PatientPosition;
use crate::ply::PlyError;

/// Triangles over shared vertices. Seen from outside, the corners of a triangle go round against the clock.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners, mm.
    pub vertices_mm: Vec<[f64; 3]>,
    /// Numbers of three corners each.
    pub triangles: Vec<[u32; 3]>,
}

/// Where a mesh lies in a plan; what a file may say of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placing {
    /// The isocentre in the frame of the vertices, mm.
    pub isocentre_mm: [f64; 3],
    /// How the patient lies.
    pub position: PatientPosition,
}

/// A mesh as a file holds it, with what the file says of its place.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// The triangles.
    pub mesh: Mesh,
    /// The isocentre in the frame of the vertices, mm.
    pub isocentre_mm: Option<[f64; 3]>,
    /// How the patient lies, as a term of DICOM.
    pub position: Option<String>,
}

/// Why bytes are no mesh.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MeshError {
    /// It is no PLY file that can be read.
    #[error(transparent)]
    Ply(#[from] PlyError),
    /// The file ends before what its header promises.
    #[error("the file ends at byte {found}, but its header promises {expected} bytes")]
    Short {
        /// Bytes that the header promises.
        expected: usize,
        /// Bytes found.
        found: usize,
    },
    /// The header, or a line of text.
    #[error("line {line}: {why}")]
    Line {
        /// From 1.
        line: usize,
        /// Description of the fault.
        why: String,
    },
    /// A triangle names a corner that is not there.
    #[error("triangle {triangle} has corner {corner}, but there are {vertices} vertices")]
    Corner {
        /// From 0.
        triangle: usize,
        /// The corner.
        corner: u64,
        /// Vertices of the file.
        vertices: usize,
    },
    /// A coordinate is not finite.
    #[error("vertex {0} has a coordinate that is not finite")]
    NotFinite(usize),
    /// There is no triangle.
    #[error(
        "the file has no triangles: a surface needs them, for points alone do not say which side is outside"
    )]
    NoTriangles,
}

impl Mesh {
    /// A mesh whose numbers were checked.
    ///
    /// # Errors
    /// No triangles, corners that are not there, coordinates that are not finite.
    pub fn checked(vertices_mm: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if let Some(vertex) = vertices_mm.iter().position(|v| !v.iter().all(|c| c.is_finite())) {
            return Err(MeshError::NotFinite(vertex));
        }
        let vertices = vertices_mm.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(corner) = corners.iter().find(|c| **c as usize >= vertices) {
                return Err(MeshError::Corner { triangle, corner: u64::from(*corner), vertices });
            }
        }
        if triangles.is_empty() { Err(MeshError::NoTriangles) } else { Ok(Self { vertices_mm, triangles }) }
    }

    /// The corners of a triangle, mm.
    fn corners(&self, triangle: &[u32; 3]) -> [Vector3<f64>; 3] {
        triangle.map(|corner| self.vertices_mm.get(corner as usize).copied().unwrap_or_default().into())
    }

    /// Area of all triangles, cm2.
    pub fn area_cm2(&self) -> f64 {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = self.corners(t);
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        1e-2 * self.triangles.iter().map(area).sum::<f64>()
    }

    /// Volume inside a closed mesh, cm3; negative if its triangles face inwards.
    pub fn volume_cm3(&self) -> f64 {
        let origin: Vector3<f64> = self.vertices_mm.first().copied().unwrap_or_default().into();
        let cone = |t: &[u32; 3]| {
            let [a, b, c] = self.corners(t).map(|corner| corner - origin);
            a.dot(&b.cross(&c)) / 6.0
        };
        1e-3 * self.triangles.iter().map(cone).sum::<f64>()
    }

    /// Points spread evenly over the triangles, about `spacing_mm` apart, with the unit normals that point outwards. The
    /// triangles of a mesh that is turned inside out are turned back.
    pub fn points(&self, spacing_mm: f64) -> Vec<([f64; 3], [f64; 3])> {
        let side = if self.volume_cm3() < 0.0 { -1.0 } else { 1.0 };
        let mut points = Vec::new();
        for triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle);
            let across = (b - a).cross(&(c - a));
            let Some(normal) = across.try_normalize(1e-12) else { continue };
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            // Halves of a triangle's sides until the parts are small; what they have in common is their middle.
            let parts = libm::ceil(longest / spacing_mm).clamp(1.0, 1000.0) as u32;
            let step = 1.0 / f64::from(parts);
            for i in 0..parts {
                for j in 0..parts - i {
                    let middle = |third: f64| -> [f64; 3] {
                        let (u, v) = ((f64::from(i) + third) * step, (f64::from(j) + third) * step);
                        (a + (b - a) * u + (c - a) * v).into()
                    };
                    points.push((middle(1.0 / 3.0), (side * normal).into()));
                    if j + 1 < parts - i {
                        points.push((middle(2.0 / 3.0), (side * normal).into()));
                    }
                }
            }
        }
        points
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_on_the_mesh_and_their_normals_point_outwards_however_it_is_turned() {
        // A tetrahedron.
        let corners = vec![[0.0; 3], [30.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 0.0, 30.0]];
        let out = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let inwards = out.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        let meshes = [out, inwards].map(|t| Mesh::checked(corners.clone(), t).unwrap());
        assert!((meshes[0].volume_cm3() - 4.5).abs() < 1e-12 && (meshes[1].volume_cm3() + 4.5).abs() < 1e-12);
        for mesh in &meshes {
            let points = mesh.points(2.0);
            let density = points.len() as f64 / (100.0 * mesh.area_cm2());
            assert!((0.2..1.5).contains(&density), "{density} per mm2");
            for (at, normal) in points {
                let from_middle = Vector3::from(at) - Vector3::repeat(7.5);
                assert!(Vector3::from(normal).dot(&from_middle) > 0.0, "{at:?} {normal:?}");
            }
        }
    }

    #[test]
    fn a_mesh_with_impossible_numbers_is_refused() {
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let refused = |v: &[[f64; 3]], t: &[[u32; 3]]| Mesh::checked(v.to_vec(), t.to_vec()).unwrap_err();
        assert_eq!(refused(&vertices, &[]), MeshError::NoTriangles);
        assert_eq!(
            refused(&vertices, &[[0, 1, 3]]),
            MeshError::Corner { triangle: 0, corner: 3, vertices: 3 }
        );
        assert_eq!(refused(&[[f64::NAN, 0.0, 0.0]], &[[0, 0, 0]]), MeshError::NotFinite(0));
    }
}
