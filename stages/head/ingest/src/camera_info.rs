//! `sensor_msgs/msg/CameraInfo` in CDR: a message's bytes in, the rays of its pixels out.

use stillpoint_cdr::{CdrError, Reader};
use stillpoint_operator::Choice;
use thiserror::Error;

use crate::checks::{self, CheckError, quoted};
use crate::depth::MAX_PIXELS;

/// Largest distance, in pixels, between a pixel and the place at which its ray is distorted again.
const TOLERANCE: f64 = 1e-3;
/// Steps in which the distortion of a pixel is undone; each divides the error by ten or more for cameras of depth.
const STEPS: u32 = 100;

/// Why a message gives no rays.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum CameraInfoError {
    /// The message is not CDR, or damaged.
    #[error("{fault} ({what})")]
    Cdr {
        /// The part of the message.
        what: &'static str,
        /// What is wrong with it.
        fault: CdrError,
    },
    /// It describes no camera, as the info of a driver without calibration.
    #[error(
        "its matrix has the focal lengths {fx} and {fy} and the principal point ({cx}, {cy}): calibrate the camera"
    )]
    Uncalibrated {
        /// Along a row, px.
        fx: f64,
        /// Along a column, px.
        fy: f64,
        /// Column, px.
        cx: f64,
        /// Row, px.
        cy: f64,
    },
    /// The projection of rectified images is missing, and the lens distorts.
    #[error(
        "its image is rectified by its name, and the projection P is zero: record P, or set `image: raw` if the image is not \
         rectified"
    )]
    NoProjection,
    /// The matrix is not that of a camera.
    #[error("the entry {entry} of its matrix is {value} (allowed: {allowed})")]
    Matrix {
        /// Its place.
        entry: &'static str,
        /// Its value.
        value: f64,
        /// The values that it can have.
        allowed: f64,
    },
    /// The principal point is not in the image.
    #[error(transparent)]
    PrincipalPoint(#[from] CheckError),
    /// The part of the camera that its images show is none.
    #[error(
        "its images show {width} x {height} pixels at ({x_offset}, {y_offset}), binned {binning_x} x {binning_y}, of a camera \
         of {camera:?} pixels"
    )]
    Region {
        /// Columns of the part; 0 for all.
        width: u32,
        /// Rows of the part; 0 for all.
        height: u32,
        /// First column.
        x_offset: u32,
        /// First row.
        y_offset: u32,
        /// Pixels of a row that became one.
        binning_x: u32,
        /// Pixels of a column that became one.
        binning_y: u32,
        /// Columns and rows of the camera.
        camera: [u32; 2],
    },
    /// A lens that is not known here.
    #[error(
        "the distortion model `{model}` with {numbers} numbers is not known, only `plumb_bob` (5) and `rational_polynomial` \
         (8, or 12 or 14 of which those behind the eighth are zero): record the rectified image"
    )]
    Model {
        /// Its name.
        model: String,
        /// How many numbers describe it.
        numbers: usize,
    },
    /// The distortion folds the image there.
    #[error("the distortion cannot be undone at column {column}, row {row}: record the rectified image")]
    Folded {
        /// Column of the pixel.
        column: u32,
        /// Row of the pixel.
        row: u32,
    },
    /// More pixels than any image has.
    #[error("it is of an image of {width} x {height} pixels, at most {MAX_PIXELS} in all are read")]
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// Which image the rays are of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Choice)]
pub enum Image {
    /// As the camera took it: the matrix `K` and the distortion.
    Raw,
    /// Rectified: the projection `P`, without distortion.
    Rectified,
}

/// A camera: its images' size, its matrix, and the distortion of its lens.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraInfo {
    /// Pixels of an image in a row.
    pub width: u32,
    /// Rows of an image.
    pub height: u32,
    /// Focal length along a row and along a column, column and row of the principal point, px of the image.
    pub matrix: [f64; 4],
    /// Frame of its header; empty where none is given.
    pub frame: String,
    /// How far a row shifts columns: the skew of the matrix, px.
    skew: f64,
    /// k1, k2, p1, p2, k3, k4, k5, k6 of the polynomial.
    distortion: [f64; 8],
}

impl CameraInfo {
    /// Reads a message.
    ///
    /// # Errors
    /// What is wrong with the message, or why its camera cannot be used.
    pub fn parse(bytes: &[u8], image: Image) -> Result<Self, CameraInfoError> {
        let mut r = Reader::in_either_order(bytes).map_err(of("the encapsulation"))?;
        let (_, frame) = r.foreign_header().map_err(of("the header"))?;
        let frame = frame.to_owned();
        let height = r.u32().map_err(of("height"))?;
        let width = r.u32().map_err(of("width"))?;
        let model = r.text().map_err(of("distortion_model"))?;
        let count = r.u32().map_err(of("the count of d"))? as usize;
        if count > r.rest() {
            let fault = CdrError::TooShort { at: 0, needed: 8 * count, found: bytes.len() };
            return Err(CameraInfoError::Cdr { what: "d", fault });
        }
        let d: Vec<f64> =
            (0..count).map(|_| r.f64()).collect::<Result<_, _>>().map_err(of("the numbers of d"))?;
        let mut matrices = [0.0; 9 + 9 + 12];
        for number in &mut matrices {
            *number = r.f64().map_err(of("the matrices"))?;
        }
        let mut rest = [0; 6];
        for number in &mut rest {
            *number = r.u32().map_err(of("the binning and the region"))?;
        }
        if u64::from(width) * u64::from(height) > MAX_PIXELS as u64 {
            return Err(CameraInfoError::TooLarge { width, height });
        }
        let no_projection = matrices[18..30].iter().all(|n| *n == 0.0);
        let image = match image {
            // Without distortion, the rectified image is the raw one.
            Image::Rectified if no_projection && polynomial(model, &d) == Ok([0.0; 8]) => Image::Raw,
            Image::Rectified if no_projection => return Err(CameraInfoError::NoProjection),
            image => image,
        };
        // K is 3 x 3, behind it stand R, 3 x 3, and P, 3 x 4.
        let (of, zeros, one) = match image {
            Image::Raw => ([0, 1, 2, 4, 5], [(3, "(2, 1)"), (6, "(3, 1)"), (7, "(3, 2)")], 8),
            Image::Rectified => ([18, 19, 20, 23, 24], [(22, "(2, 1)"), (26, "(3, 1)"), (27, "(3, 2)")], 28),
        };
        let [fx, skew, cx, fy, cy] = of.map(|at| matrices[at]);
        let finite = [fx, skew, cx, fy, cy].iter().all(|n| n.is_finite());
        if !finite || fx <= 0.0 || fy <= 0.0 {
            return Err(CameraInfoError::Uncalibrated { fx, fy, cx, cy });
        }
        for (at, entry) in zeros {
            if matrices[at] != 0.0 {
                return Err(CameraInfoError::Matrix { entry, value: matrices[at], allowed: 0.0 });
            }
        }
        if matrices[one] != 1.0 {
            return Err(CameraInfoError::Matrix { entry: "(3, 3)", value: matrices[one], allowed: 1.0 });
        }
        let size = [width, height].map(|n| n as usize);
        checks::principal_point([cx, cy], size)?;
        let distortion = match image {
            Image::Raw => polynomial(model, &d)?,
            Image::Rectified => [0.0; 8],
        };
        Self { width, height, matrix: [fx, fy, cx, cy], frame, skew, distortion }.cut(rest)
    }

    /// The camera of images that show a part of it: `width`, `height` and matrix become those of the images. As
    /// `image_geometry` of ROS has it, a binned image keeps the place of its first pixel.
    fn cut(
        self,
        [binning_x, binning_y, x_offset, y_offset, height, width]: [u32; 6],
    ) -> Result<Self, CameraInfoError> {
        let camera = [self.width, self.height];
        // Zero stands for the whole, and for no binning.
        let part = |pixels: u32, all: u32, binning: u32| {
            let pixels = if pixels == 0 { all } else { pixels };
            pixels / binning.max(1)
        };
        let image = [part(width, camera[0], binning_x), part(height, camera[1], binning_y)];
        let fits = |pixels: u32, offset: u32, all: u32| {
            let end = u64::from(offset) + u64::from(if pixels == 0 { all } else { pixels });
            end <= u64::from(all)
        };
        let is_empty = image.contains(&0) && !camera.contains(&0);
        if is_empty || !fits(width, x_offset, camera[0]) || !fits(height, y_offset, camera[1]) {
            let (part, offset, binning) = ([width, height], [x_offset, y_offset], [binning_x, binning_y]);
            return Err(CameraInfoError::Region {
                width: part[0],
                height: part[1],
                x_offset: offset[0],
                y_offset: offset[1],
                binning_x: binning[0],
                binning_y: binning[1],
                camera,
            });
        }
        let [fx, fy, cx, cy] = self.matrix;
        let [bx, by] = [binning_x, binning_y].map(|b| f64::from(b.max(1)));
        let matrix = [fx / bx, fy / by, (cx - f64::from(x_offset)) / bx, (cy - f64::from(y_offset)) / by];
        Ok(Self { width: image[0], height: image[1], matrix, skew: self.skew / bx, ..self })
    }

    /// For each pixel, row by row: x and y of the point of its ray at a depth of 1.
    ///
    /// # Errors
    /// A pixel whose distortion cannot be undone.
    pub fn rays(&self) -> Result<Vec<[f64; 2]>, CameraInfoError> {
        let [fx, fy, cx, cy] = self.matrix;
        let (inv_fx, inv_fy) = (1.0 / fx, 1.0 / fy);
        let mut rays = Vec::with_capacity(self.width as usize * self.height as usize);
        for row in 0..self.height {
            let y = (f64::from(row) - cy) * inv_fy;
            for column in 0..self.width {
                let along = f64::from(column) - cx;
                // Without skew, nothing is subtracted: the rays keep their bits.
                let along = if self.skew == 0.0 { along } else { along - self.skew * y };
                let seen = [along * inv_fx, y];
                let ray = if self.distortion == [0.0; 8] { Some(seen) } else { self.undistorted(seen) };
                rays.push(ray.ok_or(CameraInfoError::Folded { column, row })?);
            }
        }
        Ok(rays)
    }

    /// The place that the lens moves to `seen`, by fixed-point iteration.
    fn undistorted(&self, seen: [f64; 2]) -> Option<[f64; 2]> {
        let mut ray = seen;
        for _ in 0..STEPS {
            let (radial, tangential) = self.distortion_at(ray);
            ray = [0, 1].map(|axis| (seen[axis] - tangential[axis]) / radial);
        }
        let (radial, tangential) = self.distortion_at(ray);
        let [fx, fy, ..] = self.matrix;
        let off = [0, 1].map(|axis| (ray[axis] * radial + tangential[axis] - seen[axis]) * [fx, fy][axis]);
        // Written so that NaN is refused; behind a fold the radius shrinks where it should grow.
        (radial > 0.0 && off.iter().all(|pixels| pixels.abs() <= TOLERANCE)).then_some(ray)
    }

    /// Factor along the radius and shift of the Brown-Conrady model, as OpenCV and ROS have it, with the denominator of
    /// `rational_polynomial`.
    fn distortion_at(&self, [x, y]: [f64; 2]) -> (f64, [f64; 2]) {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.distortion;
        let r2 = x * x + y * y;
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
        let shift = [2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y];
        (above / below, shift)
    }
}

fn of(what: &'static str) -> impl Fn(CdrError) -> CameraInfoError {
    move |fault| CameraInfoError::Cdr { what, fault }
}

/// Names under which drivers describe a pinhole without distortion, where all numbers are zero.
const PINHOLES: [&str; 9] = [
    "",
    "none",
    "plumb_bob",
    "rational_polynomial",
    "brown_conrady",
    "inverse_brown_conrady",
    "modified_brown_conrady",
    "radtan",
    "pinhole",
];

/// The numbers of a model, which are all zero for an image without distortion. A fisheye with zeros is no pinhole.
fn polynomial(model: &str, d: &[f64]) -> Result<[f64; 8], CameraInfoError> {
    let mut all = [0.0; 8];
    let is_zero = d.iter().all(|number| *number == 0.0);
    if is_zero && PINHOLES.iter().any(|name| model.eq_ignore_ascii_case(name)) {
        return Ok(all);
    }
    // Behind the eighth number stand the thin prism and the tilt of the sensor.
    let (first, rest) = d.split_at(d.len().min(8));
    let fits = match model {
        "plumb_bob" => d.len() == 4 || d.len() == 5,
        "rational_polynomial" => [8, 12, 14].contains(&d.len()) && rest.iter().all(|n| *n == 0.0),
        _ => false,
    };
    if !fits || !d.iter().all(|number| number.is_finite()) {
        return Err(CameraInfoError::Model { model: quoted(model), numbers: d.len() });
    }
    all.iter_mut().zip(first).for_each(|(to, from)| *to = *from);
    Ok(all)
}
