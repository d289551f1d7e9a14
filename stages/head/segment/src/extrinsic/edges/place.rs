//! From the couch's plane and edges to the place of the camera and its error.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::super::residual::HEAD_M;
use super::super::still::Still;
use super::cracks::cracks;
use super::error::EdgeError;
use super::plane::top;
use super::sides::{Edge, sides};

/// One standard deviation of the stated width and head end, m.
const STATED: f64 = 0.5e-3;

/// The top of the couch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Couch {
    width: f64,
    head_end: f64,
}

impl Couch {
    /// A couch of this width, whose head end is at this y, m.
    ///
    /// # Errors
    /// A number is out of its range.
    pub fn new(width: f64, head_end: f64) -> Result<Self, EdgeError> {
        for (what, value, [least, most]) in
            [("width", width, [0.2, 1.0]), ("y of the head end", head_end, [-1.0, 2.0])]
        {
            if !(least..=most).contains(&value) {
                let [value_mm, least_mm, most_mm] = [value, least, most].map(|m| 1e3 * m);
                return Err(EdgeError::Range { what, value_mm, least_mm, most_mm });
            }
        }
        Ok(Self { width, head_end })
    }

    /// The two corners at the head end, m.
    pub fn corners(&self) -> [Vector3<f64>; 2] {
        [-0.5, 0.5].map(|side| Vector3::new(side * self.width, self.head_end, 0.0))
    }
}

/// Parts of the error of a place, m. They are added, since nothing says that they differ in direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeParts {
    /// Pixels that are either on the couch or not: one standard deviation of the three edges.
    pub pixels: f64,
    /// Half of what the blur of edges, known from the width, moves the head end by: it may differ between edges.
    pub blur: f64,
    /// Scatter of the plane's points over the root of a hundredth of them, since neighbours err alike.
    pub plane: f64,
    /// One standard deviation of the stated width and head end.
    pub stated: f64,
}

impl EdgeParts {
    /// The error, m.
    pub fn sum(&self) -> f64 {
        self.pixels + self.blur + self.plane + self.stated
    }
}

/// A camera over the couch.
#[derive(Clone, Debug, PartialEq)]
pub struct EdgePlace {
    /// From the camera's frame (x right, y down, z forward) to the couch's.
    pub couch_from_camera: Isometry3<f64>,
    /// Points on the plane, and the root of the mean square of their distances from it, m.
    pub plane: (usize, f64),
    /// The two long edges, and that at the head end.
    pub edges: [Edge; 3],
    /// Measured width less the stated one, m: what edges are blurred by.
    pub width: f64,
    /// How far edges appear inwards of where they are, px.
    pub blur: f64,
    /// Angle of the head end from square to the sides, rad.
    pub off_square: f64,
    /// The error of the place.
    pub error: EdgeParts,
}

/// Finds the plane of the couch's top and its edges.
///
/// # Errors
/// The couch does not fill the middle of the image, an edge is not in view or not straight, or the width differs.
pub fn place_by_edges(still: &Still, couch: &Couch) -> Result<EdgePlace, EdgeError> {
    let top = top(still)?;
    // The camera is on the side that the normal points to.
    let up = top.plane.normal;
    let (u, _) = top.plane.axes();
    let axes = [u, up.cross(&u)];
    let cracks = cracks(still, &top, axes);
    let found = sides(&cracks, couch.width)?;
    let in_camera = |at: &nalgebra::Vector2<f64>| axes[0] * at.x + axes[1] * at.y;
    let head = in_camera(&found.head).normalize();
    let left = head.cross(&up);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[left, head, up]).transpose());
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    // The middle of the head end is at x = 0, y as stated, z = 0.
    let middle = in_camera(&found.middle) - up * top.plane.offset;
    let place = Vector3::new(0.0, couch.head_end, 0.0) - rotation * middle;
    let edges = found.edges;
    let squares: f64 = edges.iter().map(|edge| edge.sigma() * edge.sigma()).sum();
    let plane = top.rms / (0.01 * top.points as f64).sqrt().max(1.0);
    let error = EdgeParts {
        pixels: squares.sqrt(),
        blur: 0.5 * found.blur.abs() * edges[2].pixel,
        // The tilt of a plane over a couch is a few times its height's error over half of its width.
        plane: plane * (1.0 + HEAD_M / (0.5 * couch.width)),
        stated: STATED,
    };
    Ok(EdgePlace {
        couch_from_camera: Isometry3::from_parts(Translation3::from(place), rotation),
        plane: (top.points, top.rms),
        edges,
        width: found.width - couch.width,
        blur: found.blur,
        off_square: found.off_square,
        error,
    })
}
