//! The median of the images of a scene that stands still.

use nalgebra::Vector3;

use super::error::ExtrinsicError;

/// Most images that count; later ones are left out.
const MOST_IMAGES: usize = 60;
/// Depths that count, m.
const DEPTHS_M: std::ops::RangeInclusive<f64> = 0.01..=20.0;
/// Largest x or y of a ray at a depth of 1: beyond, no lens sees.
const WIDEST: f64 = 10.0;

/// Images of one camera, pixel by pixel.
#[derive(Clone, Debug, Default)]
pub struct StillImages {
    size: [usize; 2],
    /// x and y of the ray of each pixel at a depth of 1; NaN until it is known.
    rays: Vec<[f64; 2]>,
    /// Depths of each image, m; NaN where there is none.
    depths: Vec<Vec<f32>>,
}

/// One image: the median depth of each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Still {
    pub(super) width: usize,
    /// Points in the camera's frame (x right, y down, z forward), m, row by row; `None` where most images have none.
    pub(super) points: Vec<Option<Vector3<f64>>>,
    /// Angle between the rays of neighbouring pixels, about, rad.
    pub(super) pixel_rad: f64,
}

impl StillImages {
    /// Adds a depth image: depths along the optical axis in m, 0 for none, and the ray of each pixel at a depth of 1.
    ///
    /// # Errors
    /// It has another size than those before.
    pub fn add_depths(
        &mut self,
        size: [usize; 2],
        depths: impl IntoIterator<Item = f64>,
        ray: impl Fn(usize, usize) -> [f64; 2],
    ) -> Result<(), ExtrinsicError> {
        let valid = |depth: f64| if DEPTHS_M.contains(&depth) { depth as f32 } else { f32::NAN };
        let depths: Vec<f32> = depths.into_iter().map(valid).collect();
        self.begin(size, depths.len())?;
        if self.depths.is_empty() {
            self.rays = (0..depths.len()).map(|pixel| ray(pixel % size[0], pixel / size[0])).collect();
        }
        if self.depths.len() < MOST_IMAGES {
            self.depths.push(depths);
        }
        Ok(())
    }

    /// Adds an organised cloud: points in the camera's frame, m; not finite for none.
    ///
    /// # Errors
    /// It has another size than those before, or is not organised.
    pub fn add_cloud(
        &mut self,
        size: [usize; 2],
        points: impl IntoIterator<Item = [f32; 3]>,
    ) -> Result<(), ExtrinsicError> {
        let [width, height] = size;
        if height < 2 {
            return Err(ExtrinsicError::Unorganised { width, height });
        }
        let points: Vec<[f32; 3]> = points.into_iter().collect();
        self.begin(size, points.len())?;
        self.rays.resize(points.len(), [f64::NAN; 2]);
        if self.depths.len() < MOST_IMAGES {
            let mut depths = vec![f32::NAN; points.len()];
            for ((point, depth), ray) in points.iter().zip(&mut depths).zip(&mut self.rays) {
                if point.iter().all(|part| part.is_finite()) && DEPTHS_M.contains(&f64::from(point[2])) {
                    *depth = point[2];
                    if ray[0].is_nan() {
                        *ray = [point[0], point[1]].map(|part| f64::from(part) / f64::from(point[2]));
                    }
                }
            }
            self.depths.push(depths);
        }
        Ok(())
    }

    fn begin(&mut self, size: [usize; 2], pixels: usize) -> Result<(), ExtrinsicError> {
        let image = self.depths.len() + 1;
        let expected = size[0].saturating_mul(size[1]);
        if pixels != expected || pixels == 0 {
            return Err(ExtrinsicError::Pixels { image, found: pixels, size });
        }
        if self.depths.is_empty() {
            self.size = size;
        }
        if size == self.size {
            return Ok(());
        }
        Err(ExtrinsicError::Size { image, found: size, expected: self.size })
    }

    /// Images that count.
    pub fn count(&self) -> usize {
        self.depths.len()
    }

    /// The median of each pixel.
    ///
    /// # Errors
    /// There is no image.
    pub fn still(&self) -> Result<Still, ExtrinsicError> {
        if self.depths.is_empty() {
            return Err(ExtrinsicError::NoImage);
        }
        let mut seen = Vec::with_capacity(self.depths.len());
        let point = |pixel: usize, seen: &mut Vec<f32>| {
            seen.clear();
            seen.extend(self.depths.iter().map(|image| image[pixel]).filter(|depth| depth.is_finite()));
            if 2 * seen.len() <= self.depths.len() {
                return None;
            }
            seen.sort_by(f32::total_cmp);
            let middle = seen.len() / 2;
            let upper = f64::from(seen[middle]);
            let depth = if seen.len() % 2 == 1 { upper } else { 0.5 * (upper + f64::from(seen[middle - 1])) };
            let [x, y] = self.rays[pixel];
            // Written so that NaN is refused.
            if !(x.abs() < WIDEST && y.abs() < WIDEST) {
                return None;
            }
            Some(Vector3::new(x * depth, y * depth, depth))
        };
        let points: Vec<Option<Vector3<f64>>> =
            (0..self.size[0] * self.size[1]).map(|pixel| point(pixel, &mut seen)).collect();
        Ok(Still { width: self.size[0], points, pixel_rad: self.pixel_rad() })
    }

    /// The median distance of the rays of neighbours in a row.
    fn pixel_rad(&self) -> f64 {
        let apart = |two: &[[f64; 2]]| two[1][0] - two[0][0];
        let mut steps: Vec<f64> =
            self.rays.windows(2).map(apart).filter(|step| *step > 0.0 && *step < WIDEST).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied().unwrap_or(1e-3)
    }
}

impl Still {
    pub(super) fn height(&self) -> usize {
        self.points.len() / self.width.max(1)
    }

    /// The point of a pixel.
    pub(super) fn at(&self, column: usize, row: usize) -> Option<Vector3<f64>> {
        self.points[row * self.width + column]
    }
}
