//! Depth images: 16-bit greyscale PNG in, organised points in the camera's frame out.

use crate::INVALID_POINT;
use std::io::Cursor;
use thiserror::Error;

/// Pixels that a depth image may have at most; a larger one is refused before memory is taken for it.
pub const MAX_PIXELS: usize = 1 << 24;

/// A depth image, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DepthImage {
    /// Depth along the optical axis in counts of [`Intrinsics::metres_per_count`]; 0 is no measurement.
    pub counts: Vec<u16>,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// A pinhole camera without distortion, and the unit of its depth.
///
/// Whole pixel coordinates are pixel centres: the image spans -0.5 to width - 0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length along a row, in pixels.
    pub fx: f64,
    /// Focal length along a column, in pixels.
    pub fy: f64,
    /// Column of the principal point, in pixels.
    pub cx: f64,
    /// Row of the principal point, in pixels.
    pub cy: f64,
    /// Metres per count of the depth image.
    pub metres_per_count: f64,
}

/// Why a depth image cannot be decoded or deprojected.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DepthError {
    /// The PNG is damaged or not one.
    #[error("the depth image is not a readable PNG: {0}")]
    Png(#[from] png::DecodingError),
    /// The PNG has another pixel type.
    #[error("a depth image is 16-bit greyscale, this one is {bits}-bit {colour}")]
    PixelType {
        /// Bits per channel.
        bits: u8,
        /// What the pixels are.
        colour: &'static str,
    },
    /// The PNG is too large.
    #[error("the depth image has {width} x {height} pixels, at most {MAX_PIXELS} in all are read")]
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Image, width, height and points do not fit together.
    #[error("{width} x {height} pixels need {expected} {what}, there are {found}")]
    Length {
        /// `depths` or `points`.
        what: &'static str,
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Elements needed.
        expected: usize,
        /// Elements there.
        found: usize,
    },
}

/// Decodes a 16-bit greyscale PNG.
///
/// # Errors
/// A damaged PNG, another pixel type, or more than [`MAX_PIXELS`].
pub fn decode_png(bytes: &[u8]) -> Result<DepthImage, DepthError> {
    let limits = png::Limits { bytes: 4 * MAX_PIXELS };
    let mut reader = png::Decoder::new_with_limits(Cursor::new(bytes), limits).read_info()?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    if (info.color_type, info.bit_depth) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        let colour = colour_name(info.color_type);
        return Err(DepthError::PixelType { bits: info.bit_depth as u8, colour });
    }
    let pixels = u64::from(width) * u64::from(height);
    if pixels > MAX_PIXELS as u64 {
        return Err(DepthError::TooLarge { width, height });
    }
    let mut big_endian = vec![0_u8; pixels as usize * 2];
    reader.next_frame(&mut big_endian)?;
    let counts = big_endian.as_chunks().0.iter().map(|&pair| u16::from_be_bytes(pair)).collect();
    Ok(DepthImage { counts, width: width as usize, height: height as usize })
}

/// What pixels of a type are called.
pub(crate) fn colour_name(colour: png::ColorType) -> &'static str {
    match colour {
        png::ColorType::Grayscale => "greyscale",
        png::ColorType::GrayscaleAlpha => "greyscale with alpha",
        png::ColorType::Indexed => "palette",
        png::ColorType::Rgb => "colour",
        png::ColorType::Rgba => "colour with alpha",
    }
}

/// Deprojects `counts` (row-major, `width * height` depths) into `points` of the same length, in metres, in the
/// camera's frame: x right, y down, z forward. A depth of 0 becomes [`INVALID_POINT`].
///
/// x = (u - cx) z / fx, y = (v - cy) z / fy.
///
/// # Errors
/// A slice of another length; `points` is then unchanged.
pub fn deproject(
    counts: &[u16],
    width: usize,
    height: usize,
    camera: &Intrinsics,
    points: &mut [[f32; 3]],
) -> Result<(), DepthError> {
    let expected = width.saturating_mul(height);
    for (what, found) in [("depths", counts.len()), ("points", points.len())] {
        if found != expected {
            return Err(DepthError::Length { what, width, height, expected, found });
        }
    }
    if expected == 0 {
        return Ok(());
    }
    let (inv_fx, inv_fy) = (1.0 / camera.fx, 1.0 / camera.fy);
    for (v, (row, out)) in counts.chunks_exact(width).zip(points.chunks_exact_mut(width)).enumerate() {
        let y_over_z = (v as f64 - camera.cy) * inv_fy;
        for (u, (&count, point)) in row.iter().zip(out).enumerate() {
            let z = f64::from(count) * camera.metres_per_count;
            let x_over_z = (u as f64 - camera.cx) * inv_fx;
            *point = if count == 0 {
                INVALID_POINT
            } else {
                [(x_over_z * z) as f32, (y_over_z * z) as f32, z as f32]
            };
        }
    }
    Ok(())
}
