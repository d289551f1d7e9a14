//! What is known of a pose in the couch's frame: covariance about the head's origin, and directions.

use nalgebra::{Isometry3, Matrix3, Matrix6, Vector3, Vector6};

use crate::align::Alignment;

/// An axis of which a refused direction holds at least this part is unknown (0.05 squared: 3 degrees).
const PART_UNKNOWN: f64 = 0.0025;

/// What is known of a pose, in the axes of the couch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertainty {
    /// Covariance of (x, y, z, rotation about x, y, z) of the head's origin, m2 and rad2. An axis that a refused
    /// direction takes part in has infinite variance, and zeros beside it.
    pub covariance: Matrix6<f64>,
    /// The directions as columns (translation, rotation times length) about the centre.
    pub directions: Matrix6<f64>,
    /// Standard deviation of the movement in each direction, m; infinite where it is refused.
    pub direction_sd: [f64; 6],
    /// The centre in the couch's frame, m.
    pub centre: [f64; 3],
}

impl Uncertainty {
    /// Of an alignment with a surface of this `length`, m, where `couch_from_surface` brings the surface's axes and
    /// centre to where the head is now, and the head's origin is at `origin`, m, in the couch's frame. `reference` is the
    /// variance of the surface's own error over that of the alignment: every pose has the same error of the surface.
    #[must_use]
    pub fn new(
        alignment: &Alignment,
        length: f64,
        couch_from_surface: &Isometry3<f64>,
        origin: &Vector3<f64>,
        reference: f64,
    ) -> Self {
        let rotation = couch_from_surface.rotation.to_rotation_matrix().into_inner();
        let turn = blocks(&rotation, &Matrix3::zeros(), &rotation);
        let directions = turn * alignment.observability.directions;
        let spread = turn * alignment.covariance * turn.transpose() * (1.0 + reference);
        let centre = couch_from_surface.translation.vector;
        // From (translation of the centre, rotation times length) to (translation of the origin, rotation).
        let lever = (origin - centre).cross_matrix();
        let shift = blocks(&Matrix3::identity(), &(-lever / length), &(Matrix3::identity() / length));
        let covariance = shift * spread * shift.transpose();
        let constrained = alignment.observability.constrained;
        let unknown = unknown_axes(&directions, constrained, &(lever / length));
        let direction_sd = core::array::from_fn(|i| {
            let direction: Vector6<f64> = directions.column(i).into_owned();
            let variance = (spread * direction).dot(&direction).max(0.0);
            if i < constrained { variance.sqrt() } else { f64::INFINITY }
        });
        Self { covariance: masked(&covariance, &unknown), directions, direction_sd, centre: centre.into() }
    }
}

fn blocks(upper: &Matrix3<f64>, right: &Matrix3<f64>, lower: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(upper);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(right);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(lower);
    m
}

/// The axes (x, y, z of the origin, rotations) that a refused direction moves.
fn unknown_axes(directions: &Matrix6<f64>, constrained: usize, lever: &Matrix3<f64>) -> [bool; 6] {
    let mut part = Vector6::zeros();
    for i in constrained..6 {
        let direction: Vector6<f64> = directions.column(i).into_owned();
        let turn: Vector3<f64> = direction.fixed_rows::<3>(3).into_owned();
        let along = direction.fixed_rows::<3>(0) - lever * turn;
        let all = Vector6::new(along.x, along.y, along.z, turn.x, turn.y, turn.z);
        part += all.component_mul(&all) / all.norm_squared();
    }
    core::array::from_fn(|axis| part[axis] > PART_UNKNOWN)
}

/// The covariance, symmetric to the last bit, with infinite variance on the unknown axes.
fn masked(covariance: &Matrix6<f64>, unknown: &[bool; 6]) -> Matrix6<f64> {
    Matrix6::from_fn(|i, j| match (unknown[i] || unknown[j], i == j) {
        (true, true) => f64::INFINITY,
        (true, false) => 0.0,
        _ => 0.5 * (covariance[(i, j)] + covariance[(j, i)]),
    })
}

/// Covariance of the pose of three points whose errors are independent with deviation `sd` (m) on each axis, for a
/// head's origin at `origin`: the inverse of sum J^T J / sd^2 with J = (I, -[p - origin]x).
#[must_use]
pub fn of_three_points(points: &[Vector3<f64>; 3], sd: f64, origin: &Vector3<f64>) -> Matrix6<f64> {
    let mut information = Matrix6::zeros();
    for point in points {
        let arm = (point - origin).cross_matrix();
        let row = blocks(&Matrix3::identity(), &(-arm), &Matrix3::zeros());
        information += row.transpose() * row;
    }
    let known = information.cholesky().map(|c| c.inverse() * (sd * sd));
    let covariance = known.unwrap_or_else(|| Matrix6::from_diagonal_element(f64::INFINITY));
    masked(&covariance, &[false; 6])
}
