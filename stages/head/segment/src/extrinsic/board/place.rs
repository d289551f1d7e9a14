//! From images of a board to the place of the camera and its error.

use nalgebra::{Isometry3, Point3, SMatrix, Vector2, Vector3};

use super::super::residual::HEAD_M;
use super::error::BoardError;
use super::lattice::{Search, search};
use super::picture::Picture;
use super::pose::{Lens, Pose, pose};
use super::target::Board;

/// Least side of a square, px.
const LEAST_SIDE: f64 = 5.0;
/// Most that the board of an image may be from where it is in the mean, px.
const MOVED: f64 = 0.1;
/// One standard deviation of the scale: side of a square as printed, and focal lengths as calibrated.
const SCALE: f64 = 1e-3;

/// How far measurements may be from what is given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardLimits {
    /// Largest distance of a corner from its place, m.
    pub residual: f64,
    /// Largest standard deviation of the turn about any axis, rad.
    pub tilt: f64,
    /// Largest difference of the focal length, as a part of it, beyond three times its standard deviation.
    pub focal: f64,
}

impl Default for BoardLimits {
    fn default() -> Self {
        Self { residual: 1e-3, tilt: 0.04_f64.to_radians(), focal: 1e-2 }
    }
}

/// Parts of the error of a place, m. They are added, since nothing says that they differ in direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardParts {
    /// The largest distance of a corner from its place.
    pub corners: f64,
    /// One standard deviation of the place of a head by the scatter of the corners.
    pub noise: f64,
    /// What one standard deviation of the scale moves a head by: a board shows its distance only by its size in the image.
    pub scale: f64,
}

impl BoardParts {
    /// The error, m.
    pub fn sum(&self) -> f64 {
        self.corners + self.noise + self.scale
    }
}

/// A camera over the couch.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardPlace {
    /// From the camera's frame (x right, y down, z forward) to the couch's.
    pub couch_from_camera: Isometry3<f64>,
    /// Corners of the board.
    pub corners: usize,
    /// Root of the mean square of the distances of corners from their places, px.
    pub rms: f64,
    /// The largest one, px.
    pub largest: f64,
    /// Shortest side of a square, px.
    pub shortest: f64,
    /// Angle between the board's normal and the line of sight, rad.
    pub oblique: f64,
    /// One standard deviation of the turn about the axis about which it is known worst, rad.
    pub tilt: f64,
    /// Focal length that the corners have over the given one, less 1, and its standard deviation.
    pub focal: (f64, f64),
    /// The outermost corners in the couch's frame, m.
    pub outermost: [Vector3<f64>; 4],
    /// The error of the place.
    pub error: BoardParts,
}

/// Finds the board in each image, and places the camera by the means of its corners.
///
/// # Errors
/// What is wrong with images or intrinsics, the board is not found as a whole, it moved, or its corners leave the place open.
pub fn place_by_board(
    pictures: &[Picture],
    board: &Board,
    lens: &Lens,
    limits: BoardLimits,
) -> Result<BoardPlace, BoardError> {
    let first = pictures.first().ok_or(BoardError::NoPicture)?;
    check(lens, first.size())?;
    let mut shortest = f64::INFINITY;
    let mut found: Vec<Vec<Vector2<f64>>> = Vec::new();
    for (number, picture) in (1..).zip(pictures) {
        if picture.size() != first.size() {
            return Err(BoardError::Size { image: number, found: picture.size(), expected: first.size() });
        }
        let (corners, side) = corners(picture, board, number)?;
        shortest = shortest.min(side);
        found.push(corners);
    }
    if shortest < LEAST_SIDE {
        return Err(BoardError::Small { found: shortest, least: LEAST_SIDE });
    }
    let count = found.len() as f64;
    let mean: Vec<Vector2<f64>> = (0..found[0].len())
        .map(|corner| found.iter().map(|image| image[corner]).sum::<Vector2<f64>>() / count)
        .collect();
    for (image, corners) in (1..).zip(&found) {
        let off = shift(corners, &mean, board);
        if off > MOVED {
            return Err(BoardError::Moved { image, off, most: MOVED });
        }
    }
    let pose = pose(lens, &board.corners(), &mean).ok_or(BoardError::NoPose)?;
    placed(board, lens, limits, &mean, &pose, shortest)
}

/// Written so that NaN is refused.
fn check(lens: &Lens, [width, height]: [usize; 2]) -> Result<(), BoardError> {
    let Lens { fx, fy, cx, cy } = *lens;
    let (columns, rows) = (width as f64, height as f64);
    let is_right = (0.1 * columns..20.0 * columns).contains(&fx)
        && (0.1 * rows..20.0 * rows).contains(&fy)
        && (0.0..columns).contains(&cx)
        && (0.0..rows).contains(&cy);
    if is_right { Ok(()) } else { Err(BoardError::Intrinsics { fx, fy, cx, cy, width, height }) }
}

/// The corners of one image, and the shortest side of a square.
fn corners(picture: &Picture, board: &Board, image: usize) -> Result<(Vec<Vector2<f64>>, f64), BoardError> {
    let bright = picture.brightest();
    match search(picture, board) {
        Search::Whole { corners, shortest } => Ok((corners, shortest)),
        Search::Holes { missing, near } => {
            Err(BoardError::Missing { image, missing, near: near.into(), bright })
        }
        Search::Piece { found } => Err(BoardError::NoBoard { image, found, bright }),
        Search::Other { counts, .. } => {
            let mut counts = counts;
            counts.sort_by(|a, b| b.cmp(a));
            let mut given = [board.along, board.across];
            given.sort_by(|a, b| b.cmp(a));
            Err(BoardError::Count { image, found: counts, given, bright })
        }
    }
}

/// The largest mean shift of a quarter of the board: a move of the whole and a turn both show in it.
fn shift(corners: &[Vector2<f64>], mean: &[Vector2<f64>], board: &Board) -> f64 {
    let mut sums = [(Vector2::zeros(), 0.0); 4];
    for (place, (corner, mean)) in corners.iter().zip(mean).enumerate() {
        let (a, b) = (place / board.across, place % board.across);
        let quarter = 2 * usize::from(2 * a > board.along) + usize::from(2 * b >= board.across);
        sums[quarter].0 += corner - mean;
        sums[quarter].1 += 1.0;
    }
    sums.iter().map(|(sum, count)| sum.norm() / f64::max(*count, 1.0)).fold(0.0, f64::max)
}

fn placed(
    board: &Board,
    lens: &Lens,
    limits: BoardLimits,
    seen: &[Vector2<f64>],
    pose: &Pose,
    shortest: f64,
) -> Result<BoardPlace, BoardError> {
    let (focal, sigma) = pose.focal;
    let most = limits.focal + 3.0 * sigma;
    if focal.abs() > most {
        return Err(BoardError::Focal { off: 100.0 * focal, most: 100.0 * most });
    }
    let camera_from_board = pose.camera_from_board;
    let couch_from_board = board.couch_from_board();
    let couch_from_camera = couch_from_board * camera_from_board.inverse();
    let points = board.corners();
    // A pixel at the depth of a corner, across the ray.
    let off = |(point, residual): (&Vector3<f64>, &Vector2<f64>)| {
        let depth = (camera_from_board * Point3::from(*point)).z;
        libm::hypot(residual.x / lens.fx, residual.y / lens.fy) * depth
    };
    let offs: Vec<f64> = points.iter().zip(&pose.residuals).map(off).collect();
    let worst = (0..offs.len()).max_by(|a, b| offs[*a].total_cmp(&offs[*b])).unwrap_or(0);
    if offs[worst] > limits.residual {
        let [off_mm, most_mm] = [offs[worst], limits.residual].map(|m| 1e3 * m);
        return Err(BoardError::Residual { near: seen[worst].into(), off_mm, most_mm });
    }
    let turns = pose.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let tilt = turns.symmetric_eigenvalues().max().max(0.0).sqrt();
    if tilt.is_nan() || tilt > limits.tilt || pose.twofold {
        let [found, most] = [tilt, limits.tilt].map(f64::to_degrees);
        return Err(BoardError::Tilt { found, most, twofold: pose.twofold });
    }
    let head = couch_from_camera.inverse() * Point3::new(0.0, 0.0, HEAD_M);
    let middle = camera_from_board.translation.vector;
    let mut moves = SMatrix::<f64, 3, 6>::zeros();
    moves.fixed_view_mut::<3, 3>(0, 0).copy_from(&-(head.coords - middle).cross_matrix());
    moves.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
    let noise = (moves * pose.covariance * moves.transpose()).trace().max(0.0).sqrt();
    let squares: f64 = pose.residuals.iter().map(Vector2::norm_squared).sum();
    let last = points.len() - 1;
    let ends = [0, board.across - 1, last + 1 - board.across, last];
    Ok(BoardPlace {
        couch_from_camera,
        corners: points.len(),
        rms: (squares / points.len() as f64).sqrt(),
        largest: pose.residuals.iter().map(Vector2::norm).fold(0.0, f64::max),
        shortest,
        oblique: libm::acos(
            (camera_from_board.rotation * Vector3::z()).dot(&-middle.normalize()).clamp(-1.0, 1.0),
        ),
        tilt,
        focal: pose.focal,
        outermost: ends.map(|corner| (couch_from_board * Point3::from(points[corner])).coords),
        // The board's distance scales with its size.
        error: BoardParts { corners: offs[worst], noise, scale: SCALE * middle.norm() },
    })
}
