//! Grey images: 8-bit greyscale PNG in, pixels out.

use crate::depth::MAX_PIXELS;
use std::io::Cursor;
use thiserror::Error;

/// A grey image, row-major; 0 is black.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GreyImage {
    /// Brightness of each pixel.
    pub pixels: Vec<u8>,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// Why a grey image cannot be decoded.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GreyError {
    /// The PNG is damaged or not one.
    #[error("the grey image is not a readable PNG: {0}")]
    Png(#[from] png::DecodingError),
    /// The PNG has another pixel type.
    #[error("a grey image is 8-bit greyscale, this one is {bits}-bit {colour}: convert it")]
    PixelType {
        /// Bits per channel.
        bits: u8,
        /// What the pixels are.
        colour: &'static str,
    },
    /// The PNG is too large.
    #[error("the grey image has {width} x {height} pixels, at most {MAX_PIXELS} in all are read")]
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// Decodes an 8-bit greyscale PNG.
///
/// # Errors
/// A damaged PNG, another pixel type, or more than [`MAX_PIXELS`].
pub fn decode_png(bytes: &[u8]) -> Result<GreyImage, GreyError> {
    let limits = png::Limits { bytes: 4 * MAX_PIXELS };
    let mut reader = png::Decoder::new_with_limits(Cursor::new(bytes), limits).read_info()?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    if (info.color_type, info.bit_depth) != (png::ColorType::Grayscale, png::BitDepth::Eight) {
        let colour = crate::depth::colour_name(info.color_type);
        return Err(GreyError::PixelType { bits: info.bit_depth as u8, colour });
    }
    let count = u64::from(width) * u64::from(height);
    if count > MAX_PIXELS as u64 {
        return Err(GreyError::TooLarge { width, height });
    }
    let mut pixels = vec![0_u8; count as usize];
    reader.next_frame(&mut pixels)?;
    Ok(GreyImage { pixels, width: width as usize, height: height as usize })
}
