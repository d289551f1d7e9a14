//! Depth images as ROS 2 records them, `sensor_msgs/msg/Image` and `sensor_msgs/msg/CompressedImage` in CDR: a message's
//! bytes in, points out.
//!
//! As REP 118 has it, `16UC1` is in millimetres with 0 for no measurement, `32FC1` is in metres with NaN for none. Of
//! compressed images, PNG of 16-bit pixels is read, with or without the header of 12 bytes of `compressedDepth`.

use stillpoint_cdr::{CdrError, Reader};
use thiserror::Error;

use crate::INVALID_POINT;
use crate::depth::{DepthError, decode_png};

const MILLIMETRE: f64 = 1e-3;
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Bytes before the PNG of `compressedDepth`: a format and two numbers of the quantisation.
const DEPTH_HEADER: usize = 12;

/// Why bytes are no depth image.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum DepthMessageError {
    /// The message is not CDR, or damaged.
    #[error("{fault} ({what})")]
    Cdr {
        /// The part of the message.
        what: &'static str,
        /// What is wrong with it.
        fault: CdrError,
    },
    /// Its pixels are no depths.
    #[error("its pixels are `{0}`; a depth image has 16UC1 (mm) or 32FC1 (m)")]
    Encoding(String),
    /// It is not a PNG.
    #[error("its format is `{0}`, and its bytes are no PNG; depth is read as PNG or uncompressed")]
    Format(String),
    /// Its PNG cannot be decoded.
    #[error(transparent)]
    Png(#[from] DepthError),
    /// The header of `compressedDepth` cannot be.
    #[error("its depths are quantised by {a} and {b}, which are no numbers of `compressedDepth`")]
    Quantisation {
        /// `depthQuantA`.
        a: f32,
        /// `depthQuantB`.
        b: f32,
    },
    /// Rows overlap, or there is less data than the sizes say.
    #[error("{width} x {height} pixels of {pixel} bytes in rows of {step} do not fit {found} bytes of data")]
    Data {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes of a pixel.
        pixel: u32,
        /// Bytes from row to row.
        step: u32,
        /// Bytes there.
        found: usize,
    },
    /// It has another size than its camera.
    #[error("it has {width} x {height} pixels, its CameraInfo {of_camera:?}")]
    Size {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// The same of the camera.
        of_camera: [u32; 2],
    },
}

/// A depth image that is still in its message.
#[derive(Debug, Clone, Copy)]
pub struct DepthMessage<'a> {
    pixels: Pixels<'a>,
}

#[derive(Debug, Clone, Copy)]
enum Pixels<'a> {
    Plain {
        width: u32,
        height: u32,
        step: u32,
        big_endian: bool,
        metres: bool,
        data: &'a [u8],
    },
    /// Millimetres.
    Png(&'a [u8]),
    /// Depth is `a / (count - b)`, m.
    InversePng {
        png: &'a [u8],
        a: f32,
        b: f32,
    },
}

impl<'a> DepthMessage<'a> {
    /// Reads a `sensor_msgs/msg/Image` and checks its sizes. Nothing is copied.
    ///
    /// # Errors
    /// What is wrong with the message.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, DepthMessageError> {
        let mut r = Reader::in_either_order(bytes).map_err(of("the encapsulation"))?;
        r.header().map_err(of("the header"))?;
        let height = r.u32().map_err(of("height"))?;
        let width = r.u32().map_err(of("width"))?;
        let encoding = r.text().map_err(of("encoding"))?;
        let big_endian = r.u8().map_err(of("is_bigendian"))? != 0;
        let step = r.u32().map_err(of("step"))?;
        let data = r.bytes().map_err(of("the data"))?;
        let (metres, pixel) = match encoding {
            "16UC1" => (false, 2),
            "32FC1" => (true, 4),
            other => return Err(DepthMessageError::Encoding(other.to_owned())),
        };
        let row = u64::from(width) * u64::from(pixel);
        let end = u64::from(height.saturating_sub(1)) * u64::from(step) + row;
        let is_empty = width == 0 || height == 0;
        if is_empty || u64::from(step) < row && height > 1 || end > data.len() as u64 {
            return Err(DepthMessageError::Data { width, height, pixel, step, found: data.len() });
        }
        Ok(Self { pixels: Pixels::Plain { width, height, step, big_endian, metres, data } })
    }

    /// Reads a `sensor_msgs/msg/CompressedImage`; its PNG is not decoded yet.
    ///
    /// # Errors
    /// What is wrong with the message.
    pub fn parse_compressed(bytes: &'a [u8]) -> Result<Self, DepthMessageError> {
        let mut r = Reader::in_either_order(bytes).map_err(of("the encapsulation"))?;
        r.header().map_err(of("the header"))?;
        let format = r.text().map_err(of("format"))?;
        let data = r.bytes().map_err(of("the data"))?;
        if data.starts_with(PNG) {
            return Ok(Self { pixels: Pixels::Png(data) });
        }
        let (head, png) = data.split_at_checked(DEPTH_HEADER).unwrap_or((data, &[]));
        if !png.starts_with(PNG) {
            return Err(DepthMessageError::Format(format.to_owned()));
        }
        // The encoding of the image before its compression stands first.
        match format.split(';').next().unwrap_or_default().trim() {
            "16UC1" => Ok(Self { pixels: Pixels::Png(png) }),
            "32FC1" => {
                let number =
                    |at: usize| f32::from_le_bytes(head[at..].first_chunk().copied().unwrap_or_default());
                let (a, b) = (number(4), number(8));
                if !a.is_finite() || !b.is_finite() || a <= 0.0 {
                    return Err(DepthMessageError::Quantisation { a, b });
                }
                Ok(Self { pixels: Pixels::InversePng { png, a, b } })
            }
            other => Err(DepthMessageError::Encoding(other.to_owned())),
        }
    }

    /// The points of all pixels, row by row, on the rays of its camera, m: those without a measurement are
    /// [`INVALID_POINT`].
    ///
    /// # Errors
    /// A PNG that cannot be decoded, or another size than the camera's.
    pub fn points_into(
        &self,
        of_camera: [u32; 2],
        rays: &[[f64; 2]],
        points: &mut [[f32; 3]],
    ) -> Result<(), DepthMessageError> {
        let check = |width: usize, height: usize| match [width, height] == of_camera.map(|n| n as usize)
            && rays.len() == width * height
            && points.len() == rays.len()
        {
            true => Ok(()),
            false => Err(DepthMessageError::Size { width, height, of_camera }),
        };
        match self.pixels {
            Pixels::Plain { width, height, step, big_endian, metres, data } => {
                check(width as usize, height as usize)?;
                let (columns, step) = (width as usize, step as usize);
                for (number, (point, ray)) in points.iter_mut().zip(rays).enumerate() {
                    let at = number / columns * step;
                    *point = on_ray(*ray, plain(data, at, number % columns, metres, big_endian));
                }
            }
            Pixels::Png(png) => {
                let image = decode_png(png)?;
                check(image.width, image.height)?;
                for ((point, ray), count) in points.iter_mut().zip(rays).zip(&image.counts) {
                    *point = on_ray(*ray, f64::from(*count) * MILLIMETRE);
                }
            }
            Pixels::InversePng { png, a, b } => {
                let image = decode_png(png)?;
                check(image.width, image.height)?;
                for ((point, ray), count) in points.iter_mut().zip(rays).zip(&image.counts) {
                    let depth = if *count == 0 { 0.0 } else { a / (f32::from(*count) - b) };
                    *point = on_ray(*ray, f64::from(depth));
                }
            }
        }
        Ok(())
    }
}

/// The depth of a pixel, m.
fn plain(data: &[u8], row: usize, column: usize, metres: bool, big_endian: bool) -> f64 {
    if metres {
        let raw = data.get(row + 4 * column..).and_then(|b| b.first_chunk()).copied().unwrap_or_default();
        f64::from(if big_endian { f32::from_be_bytes(raw) } else { f32::from_le_bytes(raw) })
    } else {
        let raw = data.get(row + 2 * column..).and_then(|b| b.first_chunk()).copied().unwrap_or_default();
        f64::from(if big_endian { u16::from_be_bytes(raw) } else { u16::from_le_bytes(raw) }) * MILLIMETRE
    }
}

/// What is behind the camera, at it, or infinitely far is no measurement.
fn on_ray([x, y]: [f64; 2], z: f64) -> [f32; 3] {
    if z > 0.0 && z.is_finite() { [(x * z) as f32, (y * z) as f32, z as f32] } else { INVALID_POINT }
}

fn of(what: &'static str) -> impl Fn(CdrError) -> DepthMessageError {
    move |fault| DepthMessageError::Cdr { what, fault }
}
