//! Depth images as ROS 2 records them, `sensor_msgs/msg/Image` and `sensor_msgs/msg/CompressedImage` in CDR: a message's
//! bytes in, points out.
//!
//! As REP 118 has it, `16UC1` is in millimetres with 0 for no measurement, `32FC1` is in metres with NaN for none. Of
//! compressed images, PNG of 16-bit pixels is read, with or without the header of 12 bytes of `compressedDepth`, and RVL
//! with it. `mono16` may be brightness: it is depth where the unit of its counts is stated.

use stillpoint_cdr::{CdrError, Reader};
use thiserror::Error;

use crate::INVALID_POINT;
use crate::checks::quoted;
use crate::depth::{DepthError, MAX_PIXELS, decode_png};
use crate::rvl::{self, RvlError};

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
    /// Its pixels may be brightness or depths.
    #[error(
        "its pixels are `mono16`, which may be brightness: if they are depths, set `depth_unit`, such as `1 mm`"
    )]
    Brightness,
    /// The unit of counts is stated, and its pixels are no counts.
    #[error("its pixels are 32FC1, which is in metres: remove `depth_unit`")]
    NoCounts,
    /// It is neither a PNG nor RVL.
    #[error("its format is `{0}`, and its bytes are not PNG; depth is read as PNG, as RVL or uncompressed")]
    Format(String),
    /// Its quantised depths lack the numbers of the quantisation.
    #[error(
        "its format is `{0}`, and the header of `compressedDepth` with its quantisation of 32FC1 is missing"
    )]
    NoQuantisation(String),
    /// Its RVL cannot be unpacked.
    #[error(transparent)]
    Rvl(#[from] RvlError),
    /// Its PNG cannot be decoded.
    #[error(transparent)]
    Png(#[from] DepthError),
    /// The header of `compressedDepth` cannot be.
    #[error("its depths are quantised by {a} and {b}, which are not numbers of `compressedDepth`")]
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
    /// Of 16-bit pixels, m.
    metres_per_count: f64,
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
    /// Counts.
    Packed(Packed<'a>),
    /// Depth is `a / (count - b)`, m.
    Inverse {
        packed: Packed<'a>,
        a: f32,
        b: f32,
    },
}

/// 16-bit pixels that are compressed.
#[derive(Debug, Clone, Copy)]
enum Packed<'a> {
    Png(&'a [u8]),
    Rvl(&'a [u8]),
}

impl Packed<'_> {
    fn unpack(self) -> Result<rvl::Unpacked, DepthMessageError> {
        Ok(match self {
            Self::Png(png) => {
                let image = decode_png(png)?;
                (image.counts, image.width, image.height)
            }
            Self::Rvl(bytes) => rvl::unpack(bytes, MAX_PIXELS)?,
        })
    }
}

impl<'a> DepthMessage<'a> {
    /// Reads a `sensor_msgs/msg/Image` and checks its sizes. Nothing is copied. `depth_unit` is the depth of a count, m,
    /// where it is stated: then `mono16` is depth, too.
    ///
    /// # Errors
    /// What is wrong with the message.
    pub fn parse(bytes: &'a [u8], depth_unit: Option<f64>) -> Result<Self, DepthMessageError> {
        let mut r = Reader::in_either_order(bytes).map_err(of("the encapsulation"))?;
        r.foreign_header().map_err(of("the header"))?;
        let height = r.u32().map_err(of("height"))?;
        let width = r.u32().map_err(of("width"))?;
        let encoding = r.text().map_err(of("encoding"))?;
        let big_endian = r.u8().map_err(of("is_bigendian"))? != 0;
        let step = r.u32().map_err(of("step"))?;
        let data = r.bytes().map_err(of("the data"))?;
        let metres = in_metres(encoding, depth_unit)?;
        let pixel = if metres { 4 } else { 2 };
        let row = u64::from(width) * u64::from(pixel);
        let end = u64::from(height.saturating_sub(1)) * u64::from(step) + row;
        let is_empty = width == 0 || height == 0;
        if is_empty || u64::from(step) < row && height > 1 || end > data.len() as u64 {
            return Err(DepthMessageError::Data { width, height, pixel, step, found: data.len() });
        }
        let pixels = Pixels::Plain { width, height, step, big_endian, metres, data };
        Ok(Self { pixels, metres_per_count: depth_unit.unwrap_or(MILLIMETRE) })
    }

    /// Reads a `sensor_msgs/msg/CompressedImage`; its pixels are not unpacked yet. `depth_unit` as of
    /// [`parse`](Self::parse).
    ///
    /// # Errors
    /// What is wrong with the message.
    pub fn parse_compressed(bytes: &'a [u8], depth_unit: Option<f64>) -> Result<Self, DepthMessageError> {
        let mut r = Reader::in_either_order(bytes).map_err(of("the encapsulation"))?;
        r.foreign_header().map_err(of("the header"))?;
        let format = r.text().map_err(of("format"))?;
        let data = r.bytes().map_err(of("the data"))?;
        let metres_per_count = depth_unit.unwrap_or(MILLIMETRE);
        // The encoding of the image before its compression stands first; some programs leave it out.
        let first = format.split(';').next().unwrap_or_default().trim();
        if data.starts_with(PNG) {
            // Of other encodings, the type of the pixels decides.
            if ["32FC1", "mono16"].contains(&first) && in_metres(first, depth_unit)? {
                return Err(DepthMessageError::NoQuantisation(quoted(format)));
            }
            return Ok(Self { pixels: Pixels::Packed(Packed::Png(data)), metres_per_count });
        }
        let (head, behind) = data.split_at_checked(DEPTH_HEADER).unwrap_or((data, &[]));
        let packed = if behind.starts_with(PNG) {
            Packed::Png(behind)
        } else if format.split_ascii_whitespace().any(|word| word == "rvl") {
            Packed::Rvl(behind)
        } else {
            return Err(DepthMessageError::Format(quoted(format)));
        };
        if !in_metres(first, depth_unit)? {
            return Ok(Self { pixels: Pixels::Packed(packed), metres_per_count });
        }
        let number = |at: usize| f32::from_le_bytes(head[at..].first_chunk().copied().unwrap_or_default());
        let (a, b) = (number(4), number(8));
        if !a.is_finite() || !b.is_finite() || a <= 0.0 {
            return Err(DepthMessageError::Quantisation { a, b });
        }
        Ok(Self { pixels: Pixels::Inverse { packed, a, b }, metres_per_count })
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
                let unit = (!metres).then_some(self.metres_per_count);
                for (number, (point, ray)) in points.iter_mut().zip(rays).enumerate() {
                    let at = number / columns * step;
                    *point = on_ray(*ray, plain(data, at, number % columns, unit, big_endian));
                }
            }
            Pixels::Packed(packed) => {
                let (counts, width, height) = packed.unpack()?;
                check(width, height)?;
                for ((point, ray), count) in points.iter_mut().zip(rays).zip(&counts) {
                    *point = on_ray(*ray, f64::from(*count) * self.metres_per_count);
                }
            }
            Pixels::Inverse { packed, a, b } => {
                let (counts, width, height) = packed.unpack()?;
                check(width, height)?;
                for ((point, ray), count) in points.iter_mut().zip(rays).zip(&counts) {
                    let depth = if *count == 0 { 0.0 } else { a / (f32::from(*count) - b) };
                    *point = on_ray(*ray, f64::from(depth));
                }
            }
        }
        Ok(())
    }
}

/// Whether pixels of an encoding are in metres, not in counts.
fn in_metres(encoding: &str, depth_unit: Option<f64>) -> Result<bool, DepthMessageError> {
    match (encoding, depth_unit) {
        ("16UC1", _) | ("mono16", Some(_)) => Ok(false),
        ("mono16", None) => Err(DepthMessageError::Brightness),
        ("32FC1", None) => Ok(true),
        ("32FC1", Some(_)) => Err(DepthMessageError::NoCounts),
        (other, _) => Err(DepthMessageError::Encoding(quoted(other))),
    }
}

/// The depth of a pixel, m: of a float where no unit of counts is given.
fn plain(data: &[u8], row: usize, column: usize, unit: Option<f64>, big_endian: bool) -> f64 {
    let Some(unit) = unit else {
        let raw = data.get(row + 4 * column..).and_then(|b| b.first_chunk()).copied().unwrap_or_default();
        return f64::from(if big_endian { f32::from_be_bytes(raw) } else { f32::from_le_bytes(raw) });
    };
    let raw = data.get(row + 2 * column..).and_then(|b| b.first_chunk()).copied().unwrap_or_default();
    f64::from(if big_endian { u16::from_be_bytes(raw) } else { u16::from_le_bytes(raw) }) * unit
}

/// What is behind the camera, at it, or infinitely far is no measurement.
fn on_ray([x, y]: [f64; 2], z: f64) -> [f32; 3] {
    if z > 0.0 && z.is_finite() { [(x * z) as f32, (y * z) as f32, z as f32] } else { INVALID_POINT }
}

fn of(what: &'static str) -> impl Fn(CdrError) -> DepthMessageError {
    move |fault| DepthMessageError::Cdr { what, fault }
}
