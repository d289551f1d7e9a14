//! A grey image, smoothed and sampled.

use nalgebra::Vector2;

use super::error::BoardError;

/// Most pixels of an image.
const MOST_PIXELS: usize = 1 << 24;

/// A grey image, row by row from the top left; whole coordinates are the centres of pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub(super) width: usize,
    pub(super) height: usize,
    pixels: Vec<f32>,
}

impl Picture {
    /// An image of columns and rows with the brightness of each pixel, in any unit.
    ///
    /// # Errors
    /// The pixels are not those of the size, or a brightness is not finite.
    pub fn new([width, height]: [usize; 2], pixels: Vec<f32>) -> Result<Self, BoardError> {
        let is_sized = width.checked_mul(height) == Some(pixels.len()) && pixels.len() <= MOST_PIXELS;
        if !is_sized || width < 16 || height < 16 || pixels.iter().any(|pixel| !pixel.is_finite()) {
            return Err(BoardError::Picture { width, height, pixels: pixels.len() });
        }
        Ok(Self { width, height, pixels })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The brightness of a pixel; outside of the image, of the nearest.
    pub(super) fn at(&self, x: isize, y: isize) -> f64 {
        let (x, y) = (x.clamp(0, self.width as isize - 1), y.clamp(0, self.height as isize - 1));
        f64::from(self.pixels[y as usize * self.width + x as usize])
    }

    /// The brightness between pixels.
    pub(super) fn sample(&self, at: Vector2<f64>) -> f64 {
        let (column, row) = (at.x.floor(), at.y.floor());
        let (right, down) = (at.x - column, at.y - row);
        let (x, y) = (column as isize, row as isize);
        let above = (1.0 - right) * self.at(x, y) + right * self.at(x + 1, y);
        let below = (1.0 - right) * self.at(x, y + 1) + right * self.at(x + 1, y + 1);
        (1.0 - down) * above + down * below
    }

    /// The gradient of the brightness at a pixel.
    pub(super) fn gradient(&self, x: isize, y: isize) -> Vector2<f64> {
        0.5 * Vector2::new(self.at(x + 1, y) - self.at(x - 1, y), self.at(x, y + 1) - self.at(x, y - 1))
    }

    /// Second derivatives at a pixel: along x, across, along y.
    pub(super) fn curvature(&self, x: isize, y: isize) -> [f64; 3] {
        let middle = 2.0 * self.at(x, y);
        let diagonal = self.at(x + 1, y + 1) + self.at(x - 1, y - 1);
        let other = self.at(x + 1, y - 1) + self.at(x - 1, y + 1);
        [
            self.at(x + 1, y) + self.at(x - 1, y) - middle,
            0.25 * (diagonal - other),
            self.at(x, y + 1) + self.at(x, y - 1) - middle,
        ]
    }

    /// The image under a Gaussian of this standard deviation, px.
    pub(super) fn smooth(&self, sigma: f64) -> Self {
        let reach = (3.0 * sigma).ceil() as usize;
        let part = |tap: usize| (tap as f64 - reach as f64) / sigma;
        let weights: Vec<f64> = (0..=2 * reach).map(|tap| libm::exp(-0.5 * part(tap) * part(tap))).collect();
        let sum: f64 = weights.iter().sum();
        let weights: Vec<f32> = weights.iter().map(|weight| (weight / sum) as f32).collect();
        let mut along = Vec::with_capacity(self.pixels.len());
        let mut padded = vec![0.0; self.width + 2 * reach];
        for row in self.pixels.chunks_exact(self.width) {
            padded[..reach].fill(row[0]);
            padded[reach..reach + self.width].copy_from_slice(row);
            padded[reach + self.width..].fill(row[self.width - 1]);
            let under = |window: &[f32]| -> f32 {
                window.iter().zip(&weights).map(|(pixel, weight)| pixel * weight).sum()
            };
            along.extend(padded.windows(weights.len()).map(under));
        }
        let mut pixels = vec![0.0; self.pixels.len()];
        for (row, out) in pixels.chunks_exact_mut(self.width).enumerate() {
            for (tap, weight) in weights.iter().enumerate() {
                let from = (row + tap).saturating_sub(reach).min(self.height - 1) * self.width;
                for (out, pixel) in out.iter_mut().zip(&along[from..from + self.width]) {
                    *out += weight * pixel;
                }
            }
        }
        Self { width: self.width, height: self.height, pixels }
    }

    /// Share of the pixels that have the greatest brightness.
    pub(super) fn brightest(&self) -> f64 {
        let most = self.pixels.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        self.pixels.iter().filter(|pixel| **pixel == most).count() as f64 / self.pixels.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_a_quadric_are_its_own() {
        let of = |x: f32, y: f32| 0.5 * x * x - 2.0 * x * y + 0.25 * y * y + 3.0 * x;
        let pixels = (0..32 * 16).map(|place| of((place % 32) as f32, (place / 32) as f32)).collect();
        let picture = Picture::new([32, 16], pixels).unwrap();
        assert_eq!(picture.curvature(7, 9), [1.0, -2.0, 0.5]);
        assert_eq!(picture.gradient(7, 9), Vector2::new(7.0 - 18.0 + 3.0, -14.0 + 4.5));
        assert_eq!(picture.sample(Vector2::new(7.5, 9.0)), 0.5 * (picture.at(7, 9) + picture.at(8, 9)));
        // Smoothing adds a constant, sigma^2 / 2 times the Laplacian, away from the edges.
        let smooth = picture.smooth(1.0);
        assert!((smooth.at(15, 8) - picture.at(15, 8) - 0.75).abs() < 0.02, "{}", smooth.at(15, 8));
        assert!(Picture::new([32, 16], vec![0.0; 500]).is_err());
        assert!(Picture::new([16, 16], vec![f32::NAN; 256]).is_err());
    }
}
