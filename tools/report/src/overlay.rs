//! A depth image as a relief, with the face, the supporting plane and its hull upon it.

use stillpoint_samples::{BytesError, DepthImage, Pieces, PlaneElement, PointCloud, Sample};

use super::picture::Indexed;

/// Shades of each colour.
const SHADES: u8 = 48;
/// First shades of what is nothing, plane, face; and the colour of the hull.
const BARE: u8 = 0;
const PLANE: u8 = SHADES;
const FACE: u8 = 2 * SHADES;
const HULL: u8 = 3 * SHADES;
/// The colour of the outline of a reference.
const OUTLINE: u8 = HULL + 1;
/// Depths that belong to one surface lie this close together, m.
const SURFACE: f32 = 0.02;
/// Pixels of an image at most: those of a larger one are no image of a depth camera.
const MOST_PIXELS: usize = 1 << 24;

/// Depths of a camera without distortion.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: usize,
    pub height: usize,
    /// Depth along the optical axis, m, row by row; 0 where there is none.
    pub depth: Vec<f32>,
    /// Focal lengths and principal point, px.
    pub focal: [f64; 2],
    /// Column and row of the principal point, px.
    pub centre: [f64; 2],
}

/// An image with its detections.
#[derive(Clone, Debug)]
pub struct PictureView {
    /// When it was acquired, ns.
    pub origin: u64,
    pub image: Image,
    /// Points of the face, m, in the image's frame.
    pub face: Vec<[f32; 3]>,
    pub plane: Option<PlaneElement>,
    /// Corners of the hull, m, in the image's frame.
    pub hull: Vec<[f32; 3]>,
    /// Area within the hull, m2.
    pub hull_area: Option<f64>,
    /// Why there is no face.
    pub rejection: Option<String>,
    /// Number of the reference that the face became, if it did.
    pub captured: Option<u32>,
}

/// Why a sample is not an image that can be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    #[error(transparent)]
    Bytes(#[from] BytesError),
    #[error("the cloud is not organised as a camera grid, so it cannot be drawn")]
    NotOrganised,
    #[error("its points are not those of a camera")]
    NotOfACamera,
    #[error("{width} x {height} does not match an image of {pixels} pixels")]
    Size { width: u32, height: u32, pixels: usize },
}

impl Image {
    /// Of a depth image sample.
    ///
    /// # Errors
    /// Its bytes are none, or its sizes do not fit its pixels.
    pub fn of_depth(bytes: &[u8]) -> Result<Self, ImageError> {
        let view = Pieces::split(DepthImage::KIND, bytes).and_then(|p| p.view::<DepthImage>());
        let view = view?;
        let b = view.body;
        let (width, height) = sizes(b.width, b.height, view.elements.len())?;
        let unit = b.depth_unit as f32;
        let depth = view.elements.iter().map(|d| f32::from(*d) * unit).collect();
        Ok(Self { width, height, depth, focal: [b.fx, b.fy], centre: [b.cx, b.cy] })
    }

    /// Of an organised cloud in its camera's frame: the camera is found from the points.
    ///
    /// # Errors
    /// Its bytes are none, it is not organised, or its points are no camera's.
    pub fn of_cloud(bytes: &[u8]) -> Result<Self, ImageError> {
        let view = Pieces::split(PointCloud::KIND, bytes).and_then(|p| p.view::<PointCloud>());
        let view = view?;
        let (width, height) = sizes(view.body.width, view.body.height, view.elements.len())?;
        if height < 2 {
            return Err(ImageError::NotOrganised);
        }
        let points = view.elements.iter().map(|p| p.xyz);
        let depth = points.clone().map(|p| if p[2].is_finite() && p[2] > 0.0 { p[2] } else { 0.0 }).collect();
        let line = |axis: usize| {
            let place = |i: usize| if axis == 0 { i % width } else { i / width };
            let seen =
                points.clone().enumerate().filter(|(_, p)| p.iter().all(|c| c.is_finite()) && p[2] > 0.0);
            fit(seen.map(|(i, p)| (f64::from(p[axis]) / f64::from(p[2]), place(i) as f64)))
        };
        let lines = line(0).zip(line(1)).ok_or(ImageError::NotOfACamera)?;
        let ((fx, cx), (fy, cy)) = lines;
        Ok(Self { width, height, depth, focal: [fx, fy], centre: [cx, cy] })
    }

    /// Pixel coordinates of a point in front of the camera.
    pub fn project(&self, p: [f32; 3]) -> Option<[f64; 2]> {
        let [x, y, z] = p.map(f64::from);
        let at = [self.focal[0] * x / z + self.centre[0], self.focal[1] * y / z + self.centre[1]];
        (z > 0.0 && at.iter().all(|c| c.is_finite())).then_some(at)
    }

    /// The point that a pixel sees, m; `None` where there is no depth.
    fn point(&self, x: usize, y: usize) -> Option<[f64; 3]> {
        let z = f64::from(self.depth[x + self.width * y]);
        let along = |pixel: usize, axis: usize| (pixel as f64 - self.centre[axis]) / self.focal[axis] * z;
        (z > 0.0).then(|| [along(x, 0), along(y, 1), z])
    }

    /// Depths, each the mean of those about it that lie on its surface, along its row and then along its column: the noise
    /// of a relief goes with it.
    fn smoothed(&self) -> Vec<f32> {
        let along_rows = smoothed_along(&self.depth, self.width, 1);
        smoothed_along(&along_rows, self.height, self.width)
    }

    /// The shade of each pixel, lit from the upper left; 0 where there is no depth.
    fn relief(&self) -> Vec<u8> {
        let smooth = self.smoothed();
        let at = |x: usize, y: usize| smooth[x + self.width * y];
        let mut shades = vec![0; smooth.len()];
        for y in 0..self.height {
            for x in 0..self.width {
                let z = at(x, y);
                if z <= 0.0 {
                    continue;
                }
                let slope = |a: (usize, usize), b: (usize, usize), focal: f64| {
                    let (near, far) = (at(a.0, a.1), at(b.0, b.1));
                    let pixels = (b.0 - a.0 + b.1 - a.1) as f32;
                    let is_surface =
                        near > 0.0 && far > 0.0 && (far - near).abs() < 2.0 * SURFACE && pixels > 0.0;
                    if is_surface { (far - near) / (pixels * z / focal as f32) } else { 0.0 }
                };
                let (left, right) = (x.saturating_sub(1), (x + 1).min(self.width - 1));
                let (up, down) = (y.saturating_sub(1), (y + 1).min(self.height - 1));
                let (sx, sy) =
                    (slope((left, y), (right, y), self.focal[0]), slope((x, up), (x, down), self.focal[1]));
                let light = (0.72 + 0.45 * sx + 0.45 * sy) / (1.0 + sx * sx + sy * sy).sqrt();
                let shade = (light * f32::from(SHADES)) as i32;
                shades[x + self.width * y] = shade.clamp(4, i32::from(SHADES) - 1) as u8;
            }
        }
        shades
    }
}

/// Depths, each the mean of those on its surface among the two before and after it on a line of `count` pixels that are
/// `step` apart.
fn smoothed_along(depth: &[f32], count: usize, step: usize) -> Vec<f32> {
    const REACH: usize = 2;
    let mut smooth = vec![0.0; depth.len()];
    for (at, (own, mean)) in depth.iter().zip(&mut smooth).enumerate().filter(|(_, (own, _))| **own > 0.0) {
        let place = at / step % count;
        let (first, last) = (place.saturating_sub(REACH), (place + REACH).min(count - 1));
        let (mut sum, mut number) = (0.0, 0.0);
        for z in depth[at - (place - first) * step..=at + (last - place) * step].iter().step_by(step) {
            if *z > 0.0 && (z - own).abs() < SURFACE {
                sum += z;
                number += 1.0;
            }
        }
        *mean = sum / number;
    }
    smooth
}

fn sizes(width: u32, height: u32, pixels: usize) -> Result<(usize, usize), ImageError> {
    let (w, h) = (width as usize, height as usize);
    match w.checked_mul(h) {
        Some(n) if n == pixels && n > 0 && n <= MOST_PIXELS => Ok((w, h)),
        _ => Err(ImageError::Size { width, height, pixels }),
    }
}

/// The line y = a x + b nearest to points, with a above 0.
fn fit(points: impl Iterator<Item = (f64, f64)>) -> Option<(f64, f64)> {
    let (mut n, mut sx, mut sy, mut sxx, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (x, y) in points {
        n += 1.0;
        sx += x;
        sy += y;
        sxx += x * x;
        sxy += x * y;
    }
    let a = (n * sxy - sx * sy) / (n * sxx - sx * sx);
    (a.is_finite() && a > 0.0).then(|| (a, (sy - a * sx) / n))
}

/// The picture of an image with what was found in it. A face that became a reference has an outline.
pub fn paint(view: &PictureView) -> Indexed {
    let image = &view.image;
    let (width, height) = (image.width, image.height);
    let shades = image.relief();
    let mut picture = Indexed { width, height, pixels: shades.clone(), colours: colours() };
    if let Some(plane) = &view.plane {
        let tolerance = (3.0 * plane.rms).clamp(0.002, 0.02);
        for (pixel, shade) in shades.iter().enumerate().filter(|(_, s)| **s > 0) {
            let Some(p) = image.point(pixel % width, pixel / width) else { continue };
            let [a, b, c] = plane.normal;
            if (a * p[0] + b * p[1] + c * p[2] + plane.offset).abs() < tolerance {
                picture.pixels[pixel] = PLANE + shade;
            }
        }
    }
    for point in &view.face {
        let Some([x, y]) = image.project(*point).map(|at| at.map(f64::round)) else { continue };
        if (0.0..width as f64).contains(&x) && (0.0..height as f64).contains(&y) {
            let pixel = x as usize + width * y as usize;
            picture.pixels[pixel] = FACE + shades[pixel].max(4);
        }
    }
    if view.captured.is_some() {
        outline(&mut picture);
    }
    let corners: Vec<[f64; 2]> = view.hull.iter().filter_map(|c| image.project(*c)).collect();
    // A hull with a corner behind the camera has no outline in the image.
    if corners.len() == view.hull.len() && corners.len() > 2 {
        for (i, corner) in corners.iter().enumerate() {
            picture.line(*corner, corners[(i + 1) % corners.len()], HULL);
        }
    }
    picture
}

/// Draws a line about what is painted as a face. Gaps of a few pixels within it are no edge.
fn outline(picture: &mut Indexed) {
    const GAP: i64 = 2;
    let (width, height) = (picture.width as i64, picture.height as i64);
    let pixels = picture.pixels.clone();
    let is_face = |x: i64, y: i64| {
        let inside = (0..width).contains(&x) && (0..height).contains(&y);
        inside && (FACE..HULL).contains(&pixels[(x + width * y) as usize])
    };
    for y in 0..height {
        for x in 0..width {
            let is_near = |dx: i64, dy: i64| (1..=GAP).any(|step| is_face(x + step * dx, y + step * dy));
            let sides = [(1, 0), (-1, 0), (0, 1), (0, -1)];
            if !is_face(x, y) && sides.iter().any(|(dx, dy)| is_near(*dx, *dy) && !is_near(-dx, -dy)) {
                picture.paint(x, y, OUTLINE);
            }
        }
    }
}

fn colours() -> Vec<[u8; 3]> {
    let shade = |i: u8| f32::from(i) / f32::from(SHADES - 1);
    let ramp = |from: [f32; 3], to: [f32; 3]| {
        (0..SHADES).map(move |i| std::array::from_fn(|k| (from[k] + shade(i) * (to[k] - from[k])) as u8))
    };
    let bare = ramp([0.0; 3], [235.0; 3]);
    let plane = ramp([0.0, 10.0, 50.0], [120.0, 190.0, 255.0]);
    let face = ramp([60.0, 20.0, 0.0], [255.0, 190.0, 90.0]);
    debug_assert!(BARE == 0 && HULL as usize == 3 * SHADES as usize);
    bare.chain(plane).chain(face).chain([[0, 214, 130], [255, 64, 96]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_samples::{AlignedBytes, CloudShape, HEADER_SIZE, Intrinsics, PlaneElement, Point};
    use zerocopy::IntoBytes;

    /// A sample of these bytes.
    fn sample(body: &[u8], elements: &[u8], count: u32) -> AlignedBytes {
        let mut head = vec![0; HEADER_SIZE];
        head[28..].copy_from_slice(&count.to_le_bytes());
        AlignedBytes::joined(&[&head, body].concat(), elements)
    }

    const FOCAL: f64 = 80.0;

    fn flat(width: u32, height: u32, counts: u16) -> AlignedBytes {
        let body = Intrinsics {
            fx: FOCAL,
            fy: FOCAL,
            cx: 31.5,
            cy: 23.5,
            depth_unit: 1e-3,
            width,
            height,
            reserved: 0,
            length: width * height,
        };
        sample(body.as_bytes(), vec![counts; (width * height) as usize].as_bytes(), width * height)
    }

    #[test]
    fn what_was_found_stands_where_the_camera_sees_it() {
        let image = Image::of_depth(&flat(64, 48, 500)).unwrap();
        // The face is a square of 20 pixels about the middle of the image, 10 mm nearer than the plane.
        let across = |pixels: f64| (pixels / FOCAL * 0.49) as f32;
        let face = (-10..10).flat_map(|y| (-10..10).map(move |x| (x, y)));
        let face =
            face.map(|(x, y)| [across(f64::from(x) + 0.5), across(f64::from(y) + 0.5), 0.49]).collect();
        let side = (25.0 / FOCAL * 0.5) as f32;
        let plane = PlaneElement {
            normal: [0.0, 0.0, -1.0],
            offset: 0.5,
            rms: 0.001,
            inliers: 0,
            points: 0,
            kept: 0,
            hypotheses: 0,
        };
        let view = PictureView {
            origin: 0,
            image,
            face,
            plane: Some(plane),
            hull: vec![[-side, -side, 0.5], [side, -side, 0.5], [side, side, 0.5], [-side, side, 0.5]],
            hull_area: None,
            rejection: None,
            captured: None,
        };
        let picture = paint(&view);
        let count = |from: u8, to: u8| picture.pixels.iter().filter(|p| (from..to).contains(*p)).count();
        assert_eq!(count(FACE, HULL), 400);
        // Of the outline the upper and lower sides lie outside: two sides, two pixels wide.
        assert_eq!(count(HULL, 255), 2 * 2 * 48);
        assert_eq!(count(PLANE, FACE), 64 * 48 - 400 - 2 * 2 * 48);
        assert_eq!(picture.colours.len(), usize::from(OUTLINE) + 1);
        assert_eq!(count(OUTLINE, 255), 0);
        // The outline of a reference of 20 x 20 pixels lies just outside, two pixels wide.
        let reference = paint(&PictureView { captured: Some(1), ..view });
        let count = |of: u8| reference.pixels.iter().filter(|p| **p == of).count();
        assert_eq!(count(OUTLINE), 4 * 2 * 20);
        assert_eq!(reference.pixels.iter().filter(|p| (FACE..HULL).contains(p)).count(), 400);
    }

    #[test]
    fn a_camera_is_found_from_its_cloud() {
        let points: Vec<Point> = (0..48)
            .flat_map(|y| (0..64).map(move |x| (x, y)))
            .map(|(x, y)| {
                let z = 0.5 + 0.002 * f64::from(x);
                let along = |pixel: i32, centre: f64| ((f64::from(pixel) - centre) / FOCAL * z) as f32;
                Point { xyz: [along(x, 31.5), along(y, 23.5), z as f32] }
            })
            .collect();
        let body = CloudShape { width: 64, height: 48, reserved: 0, length: 64 * 48 };
        let image = Image::of_cloud(&sample(body.as_bytes(), points.as_bytes(), 64 * 48)).unwrap();
        assert!((image.focal[0] - FOCAL).abs() < 1e-2 && (image.centre[1] - 23.5).abs() < 1e-2);
        let body = CloudShape { width: 64 * 48, height: 1, ..body };
        let row = Image::of_cloud(&sample(body.as_bytes(), points.as_bytes(), 64 * 48));
        assert!(row.unwrap_err().to_string().contains("not organised as a camera grid"));
    }

    #[test]
    fn sizes_that_lie_are_refused() {
        let good = flat(64, 48, 1);
        let mut bad = good.clone();
        let width_at = HEADER_SIZE + 40;
        bad[width_at..width_at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(Image::of_depth(&bad).unwrap_err().to_string().contains("3072 pixels"));
        assert!(Image::of_depth(&good[..good.len() - 2]).is_err());
    }
}
