//! What the chain needs to know.

use crate::identity::IdentityParams;
use crate::mls::MlsParams;
use crate::outliers::OutlierParams;
use thiserror::Error;

/// What the chain needs to know, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceParams {
    /// Width of a voxel.
    pub leaf: f64,
    /// Points farther from the camera are ignored.
    pub range_max: f64,
    /// Voxels that stand apart are removed.
    pub outliers: Option<OutlierParams>,
    /// Voxels are moved onto the smooth surface that they lie on.
    pub smoothing: Option<MlsParams>,
    /// Distance within which a voxel belongs to the plane.
    pub plane_tolerance: f64,
    /// Largest number of plane hypotheses; eight times as many until a frame has had a plane.
    pub iterations: u32,
    /// Smallest height of the face above the plane.
    pub height_min: f64,
    /// Largest height of the face above the plane.
    pub height_max: f64,
    /// Distance within which two voxels belong to one cluster.
    pub cluster_tolerance: f64,
    /// Smallest number of voxels of a face or a plane.
    pub min_points: usize,
    /// Rule by which voxels above the plane are the face.
    pub rule: Rule,
    /// Mean distance of an adult head's surface from its middle, for [`Rule::Head`].
    pub head_radius: f64,
    /// What a candidate must be to be the head, for [`Rule::Head`]; without it, the highest ball is.
    pub identity: Option<IdentityParams>,
}

/// Rule by which voxels above the plane are the face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Those of the largest cluster, as the dissertation has it.
    Largest,
    /// Those of a head, cut from what it touches.
    Head,
}

impl Default for FaceParams {
    /// A head of any size on whatever it rests on, seen from 0.5 to 1 m.
    fn default() -> Self {
        Self {
            leaf: 0.005,
            range_max: 1.6,
            outliers: None,
            smoothing: None,
            plane_tolerance: 0.01,
            iterations: 500,
            height_min: 0.015,
            height_max: 0.36,
            cluster_tolerance: 0.02,
            min_points: 100,
            rule: Rule::Head,
            head_radius: 0.09,
            identity: None,
        }
    }
}

/// A parameter outside its range.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{name} is {value}; it must be {must}")]
pub struct ParamError {
    pub name: &'static str,
    /// Its value, SI.
    pub value: f64,
    /// Its range, as text.
    pub must: &'static str,
}

/// The first parameter outside its range.
pub(super) fn check(params: &FaceParams) -> Result<(), ParamError> {
    let positive = |name, value: f64| {
        let fits = value.is_finite() && value > 0.0;
        if fits { Ok(()) } else { Err(ParamError { name, value, must: "finite and above 0" }) }
    };
    positive("leaf", params.leaf)?;
    positive("range_max", params.range_max)?;
    positive("plane_tolerance", params.plane_tolerance)?;
    positive("cluster_tolerance", params.cluster_tolerance)?;
    positive("height_min", params.height_min)?;
    positive("height_max", params.height_max)?;
    positive("head_radius", params.head_radius)?;
    positive("iterations", f64::from(params.iterations))?;
    if let Some(outliers) = &params.outliers {
        positive("outlier neighbours", outliers.neighbours as f64)?;
        positive("outlier deviations", outliers.deviations)?;
        positive("outlier cell", outliers.cell)?;
    }
    if let Some(smoothing) = &params.smoothing {
        positive("smoothing neighbours", smoothing.neighbours as f64)?;
        positive("smoothing deviations", smoothing.deviations)?;
        positive("smoothing tolerance", smoothing.tolerance)?;
        positive("smoothing cell", smoothing.cell)?;
    }
    if params.height_max <= params.height_min {
        return Err(ParamError {
            name: "height_max",
            value: params.height_max,
            must: "greater than height_min",
        });
    }
    if params.min_points < 3 {
        let value = params.min_points as f64;
        return Err(ParamError { name: "min_points", value, must: "at least 3" });
    }
    Ok(())
}
