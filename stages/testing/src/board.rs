//! Grey images of a checkerboard on a couch, as an infrared camera would take them.
//!
//! Each pixel is the mean of rays over its area. Light falls off from the camera and across the image; the lens blurs; each
//! reading has noise that grows with the root of the brightness.

use nalgebra::{Isometry3, Point3, Vector3};

/// Rays of a pixel, and the step of their rows: none is above another, so that edges along the pixels are not rounded.
const RAYS: [usize; 2] = [25, 7];
/// Brightness of black, white, couch and floor.
const SHADES: [f64; 4] = [0.06, 0.85, 0.4, 0.15];
/// Half of the couch's width, its head end, and the height of the floor, m.
const COUCH: [f64; 3] = [0.265, 0.35, -0.85];

/// A camera, px; the middle of the first pixel is 0.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Focal lengths along a row and a column.
    pub focal: [f64; 2],
    /// Column and row of the principal point.
    pub middle: [f64; 2],
}

impl Camera {
    /// A camera with square pixels and its principal point in the middle.
    pub fn new(size: [usize; 2], focal: f64) -> Self {
        Self { size, focal: [focal; 2], middle: size.map(|count| 0.5 * (count as f64 - 1.0)) }
    }
}

/// A board: an odd number of inner corners along its x axis, of which the black end is first, and an even number along y.
#[derive(Clone, Copy, Debug)]
pub struct Checkerboard {
    pub corners: [usize; 2],
    /// Side of a square, m.
    pub square: f64,
    /// From its middle to the couch.
    pub couch_from_board: Isometry3<f64>,
}

impl Checkerboard {
    /// The shade at a place of its plane, m; `None` outside of its white margin, which is a square wide.
    fn shade(&self, x: f64, y: f64) -> Option<f64> {
        let [columns, rows] = self.corners.map(|count| count as f64 + 1.0);
        let (column, row) = (x / self.square + 0.5 * columns, y / self.square + 0.5 * rows);
        let is_in = |margin: f64| {
            (-margin..columns + margin).contains(&column) && (-margin..rows + margin).contains(&row)
        };
        if !is_in(1.0) {
            return None;
        }
        let is_black = is_in(0.0) && (column.floor() as i64 + row.floor() as i64) % 2 == 0;
        Some(SHADES[usize::from(!is_black)])
    }
}

/// How an image is taken.
#[derive(Clone, Copy, Debug)]
pub struct Exposure {
    /// Standard deviation of the blur of the lens, px.
    pub blur: f64,
    /// Change of the light from the left edge of the image to the right, as a part of its mean.
    pub slope: f64,
    /// Counts of a brightness of 1 at the middle of the couch.
    pub counts: f64,
    /// Electrons of one count: noise is the root of them.
    pub electrons: f64,
    /// Noise of the reading, counts.
    pub reading: f64,
    /// The greatest count.
    pub most: u16,
}

impl Default for Exposure {
    /// Eight bits and a brightness that varies by 40 %.
    fn default() -> Self {
        Self { blur: 0.6, slope: 0.4, counts: 200.0, electrons: 20.0, reading: 1.0, most: 255 }
    }
}

/// The light that falls on each pixel without noise, counts, row by row.
pub fn light(
    camera: &Camera,
    couch_from_camera: &Isometry3<f64>,
    board: &Checkerboard,
    exposure: &Exposure,
) -> Vec<f64> {
    let [width, height] = camera.size;
    let board_from_camera = board.couch_from_board.inverse() * couch_from_camera;
    let full = couch_from_camera.translation.vector.norm_squared();
    let ray = |u: f64, v: f64| {
        let direction = Vector3::new(
            (u - camera.middle[0]) / camera.focal[0],
            (v - camera.middle[1]) / camera.focal[1],
            1.0,
        );
        let (on_board, turned) =
            (board_from_camera.translation.vector, board_from_camera.rotation * direction);
        let along = -on_board.z / turned.z;
        let at = on_board + along * turned;
        let (shade, along) = match board.shade(at.x, at.y) {
            Some(shade) if along > 0.0 => (shade, along),
            _ => beneath(couch_from_camera, &direction),
        };
        let slope = 1.0 + exposure.slope * (u / width as f64 - 0.5);
        exposure.counts * shade * slope * full / (along * along * direction.norm_squared())
    };
    let [rays, stride] = RAYS;
    let part = |step: usize| (step as f64 + 0.5) / rays as f64 - 0.5;
    let pixel = |place: usize| {
        let (u, v) = ((place % width) as f64, (place / width) as f64);
        let sum: f64 = (0..rays).map(|step| ray(u + part(step), v + part(step * stride % rays))).sum();
        sum / rays as f64
    };
    let sharp: Vec<f64> = (0..width * height).map(pixel).collect();
    blurred(&sharp, camera.size, exposure.blur)
}

/// Shade of couch or floor, and the way along the ray.
fn beneath(couch_from_camera: &Isometry3<f64>, direction: &Vector3<f64>) -> (f64, f64) {
    let (from, turned) = (couch_from_camera.translation.vector, couch_from_camera.rotation * direction);
    let [half, head, floor] = COUCH;
    let along = -from.z / turned.z;
    let at = Point3::from(from + along * turned);
    if along > 0.0 && at.x.abs() < half && at.y < head {
        return (SHADES[2], along);
    }
    let along = (floor - from.z) / turned.z;
    if along > 0.0 { (SHADES[3], along) } else { (SHADES[3], 10.0) }
}

fn blurred(image: &[f64], [width, height]: [usize; 2], sigma: f64) -> Vec<f64> {
    if sigma <= 0.0 {
        return image.to_vec();
    }
    let reach = (4.0 * sigma).ceil() as isize;
    let weight = |off: isize| libm::exp(-0.5 * (off as f64 / sigma) * (off as f64 / sigma));
    let weights: Vec<f64> = (-reach..=reach).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    let along = |image: &[f64], [right, down]: [isize; 2]| -> Vec<f64> {
        let pixel = |place: usize| {
            let (x, y) = ((place % width) as isize, (place / width) as isize);
            let at = |off: isize| {
                let column = (x + off * right).clamp(0, width as isize - 1) as usize;
                let row = (y + off * down).clamp(0, height as isize - 1) as usize;
                image[row * width + column]
            };
            (-reach..=reach).zip(&weights).map(|(off, weight)| weight * at(off)).sum::<f64>() / sum
        };
        (0..image.len()).map(pixel).collect()
    };
    along(&along(image, [1, 0]), [0, 1])
}

/// An image of this light, with the noise of a seed: sums of four uniform numbers, which is nearly normal.
pub fn taken(light: &[f64], exposure: &Exposure, seed: u64) -> Vec<u16> {
    let mut state = seed;
    // SplitMix64 (Steele, Lea, Flood, OOPSLA 2014).
    let mut word = move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = state;
        word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        word ^ (word >> 31)
    };
    let mut pixel = |light: f64| {
        let drawn = word();
        let sum: u32 = (0..4).map(|part| (drawn >> (16 * part)) as u32 & 0xffff).sum();
        // The sum has the variance 4 / 12.
        let normal = (f64::from(sum) / 65_536.0 - 2.0) * 3_f64.sqrt();
        let sigma = (light.max(0.0) / exposure.electrons + exposure.reading * exposure.reading).sqrt();
        (light + sigma * normal).round().clamp(0.0, f64::from(exposure.most)) as u16
    };
    light.iter().map(|light| pixel(*light)).collect()
}

/// A grey PNG of 8 bits, or of 16 if a count needs them.
pub fn png(pixels: &[u16], [width, height]: [usize; 2], most: u16) -> Vec<u8> {
    let is_deep = most > 255;
    let bytes: Vec<u8> =
        pixels.iter().flat_map(|pixel| pixel.to_be_bytes().into_iter().skip(usize::from(!is_deep))).collect();
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(if is_deep { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&bytes));
    written.map(|()| file).unwrap_or_default()
}
