//! A patient's surface from a file: a case, PLY or STL.

use nalgebra::Vector3;
use thiserror::Error;

use super::{Mesh, MeshError, NoOutline, Placing, outline, read_ply, read_stl};
use crate::case::{CaseFileError, PatientPosition, from_bytes};
use crate::couch::patient_from_couch;
use crate::ply::is_ply;

/// Distance of the points of a surface, mm.
const SPACING_MM: f64 = 2.0;
/// A surface is no shorter and no longer than this, mm.
const EXTENT_MM: [f64; 2] = [60.0, 3000.0];

/// Why a file gives no surface of a patient.
#[derive(Debug, Error)]
pub enum SurfaceFileError {
    /// It is no case that can be read.
    #[error(transparent)]
    Case(#[from] CaseFileError),
    /// A case without outline.
    #[error(transparent)]
    Outline(#[from] NoOutline),
    /// It is no mesh that can be read.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Nothing says where the isocentre is.
    #[error("the file does not say where the isocentre is: give it, in the frame of the surface")]
    NoIsocentre,
    /// A patient position that there is not.
    #[error("{0:?} is no patient position: HFS, HFP, FFS or FFP")]
    Position(String),
    /// A size that no patient has.
    #[error("the surface is {0:.4} mm long, which no patient is: write the mesh in millimetres")]
    Extent(f64),
}

/// The surface of a patient, and where it lies in a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct PatientSurface {
    /// The mesh in the DICOM patient frame, mm.
    pub mesh: Mesh,
    /// Isocentre and position.
    pub placing: Placing,
}

/// The surface of a file's bytes: of a case its outline. `isocentre_mm` and `position` replace what the file says of them;
/// a mesh of others says nothing, and lies head first supine.
///
/// # Errors
/// What is wrong with the file, or what it lacks.
pub fn read_surface(
    bytes: &[u8],
    isocentre_mm: Option<[f64; 3]>,
    position: Option<PatientPosition>,
) -> Result<PatientSurface, SurfaceFileError> {
    let (mesh, said, lies) = if bytes.starts_with(b"SPCASE") {
        let case = from_bytes(bytes)?;
        (outline(&case)?, Some(case.isocentre_mm()), case.position())
    } else {
        let read = if is_ply(bytes) { read_ply(bytes)? } else { read_stl(bytes)? };
        let lies = match read.position {
            Some(term) => PatientPosition::of_term(&term).ok_or(SurfaceFileError::Position(term))?,
            None => PatientPosition::default(),
        };
        (read.mesh, read.isocentre_mm, lies)
    };
    let axis =
        |i: usize| mesh.vertices_mm.iter().fold([f64::MAX, f64::MIN], |[a, b], v| [a.min(v[i]), b.max(v[i])]);
    let extent = (0..3).map(axis).map(|[low, high]| high - low).fold(0.0, f64::max);
    if !(EXTENT_MM[0]..=EXTENT_MM[1]).contains(&extent) {
        return Err(SurfaceFileError::Extent(extent));
    }
    let isocentre_mm = isocentre_mm.or(said).ok_or(SurfaceFileError::NoIsocentre)?;
    Ok(PatientSurface { mesh, placing: Placing { isocentre_mm, position: position.unwrap_or(lies) } })
}

impl PatientSurface {
    /// Points of the surface within a box about the isocentre, with their normals: in the axes of the couch, about the
    /// isocentre, m. `least` and `greatest` are corners of the box, m.
    pub fn about_isocentre(&self, least: [f64; 3], greatest: [f64; 3]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let couch_from_patient = patient_from_couch(self.placing.position).transpose();
        let isocentre = Vector3::from(self.placing.isocentre_mm);
        let points = self.mesh.points(SPACING_MM).into_iter().map(|(at, normal)| {
            let at = couch_from_patient * (Vector3::from(at) - isocentre) * 1e-3;
            (at, couch_from_patient * Vector3::from(normal))
        });
        points.filter(|(at, _)| (0..3).all(|i| (least[i]..=greatest[i]).contains(&at[i]))).collect()
    }
}
