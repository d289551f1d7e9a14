//! A depth image as a driver program sends it. All numbers are little-endian.
//!
//! | offset | bytes | what |
//! | --- | --- | --- |
//! | 0 | 4 | `SPF1` |
//! | 4 | 4 | bytes after these eight: 64 + 2 width height |
//! | 8 | 8 | number of the image: one more than that of the image before |
//! | 16 | 8 | acquisition, ns since the epoch |
//! | 24 | 32 | focal lengths fx and fy, principal point cx and cy, px, `f64` each |
//! | 56 | 8 | depth of one count, m, `f64` |
//! | 64 | 4 | width, pixels in a row |
//! | 68 | 4 | height, rows |
//! | 72 | 2 width height | counts, `u16`, row by row from the top left; 0 is no reading |

use stillpoint_samples::Intrinsics;

use crate::checks;
use crate::depth;

/// First bytes of a frame.
pub const BEGINNING: [u8; 4] = *b"SPF1";
/// Bytes before the counts.
pub const HEADER: usize = 72;
/// Bytes of which the length does not tell.
const BEFORE: usize = 8;
/// The largest depth of one count, m.
const UNIT_MOST: f64 = 0.1;

/// Why a frame is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DriverRefusal {
    /// It does not begin as frames do.
    #[error("it does not begin with `SPF1`: the driver speaks another protocol or version")]
    Foreign,
    /// It has more pixels than are taken.
    #[error("it has more pixels than `max_pixels`")]
    TooLong,
    /// The driver was gone before all of it was there.
    #[error("the driver closed its connection within it")]
    Cut,
    /// Its length is not that of its width and height.
    #[error("its length is not 64 bytes and 2 for each pixel of its width and height")]
    Length,
    /// It has no pixels.
    #[error("its width or its height is zero")]
    Empty,
    /// Its intrinsics are not those of a camera.
    #[error("its focal lengths or its principal point are not those of a camera with this width and height")]
    Camera,
    /// Its unit is not one of depth.
    #[error("the depth of its count is not above 0 and at most 0.1 m")]
    Unit,
    /// It has no time.
    #[error("its time of acquisition is zero: set `stamps: arrival`")]
    NoStamp,
    /// It was acquired after it arrived.
    #[error("its time of acquisition is farther ahead of the clock than `clock_ahead`")]
    Ahead,
}

impl DriverRefusal {
    /// All of them, in their order.
    pub const ALL: [Self; 9] = [
        Self::Foreign,
        Self::TooLong,
        Self::Cut,
        Self::Length,
        Self::Empty,
        Self::Camera,
        Self::Unit,
        Self::NoStamp,
        Self::Ahead,
    ];

    /// Name of its count.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Foreign => "refused_foreign",
            Self::TooLong => "refused_too_long",
            Self::Cut => "refused_cut",
            Self::Length => "refused_length",
            Self::Empty => "refused_empty",
            Self::Camera => "refused_camera",
            Self::Unit => "refused_unit",
            Self::NoStamp => "refused_no_stamp",
            Self::Ahead => "refused_ahead",
        }
    }
}

/// A frame that was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriverFrame<'a> {
    /// Number of the image.
    pub number: u64,
    /// Acquisition, ns since the epoch; 0 where the driver does not know.
    pub acquired: u64,
    /// The camera and the size.
    pub intrinsics: Intrinsics,
    counts: &'a [u8],
}

impl<'a> DriverFrame<'a> {
    /// Reads a frame of at most `max_pixels`.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn parse(bytes: &'a [u8], max_pixels: usize) -> Result<Self, DriverRefusal> {
        let begun = bytes.len().min(BEGINNING.len());
        if bytes[..begun] != BEGINNING[..begun] {
            return Err(DriverRefusal::Foreign);
        }
        let small = |at: usize| bytes.get(at..)?.first_chunk().map(|b| u32::from_le_bytes(*b));
        let large = |at: usize| bytes.get(at..)?.first_chunk().map(|b| u64::from_le_bytes(*b));
        let length = small(4).ok_or(DriverRefusal::Cut)? as usize;
        if length > HEADER - BEFORE + 2 * max_pixels {
            return Err(DriverRefusal::TooLong);
        }
        if length < HEADER - BEFORE {
            return Err(DriverRefusal::Length);
        }
        let (header, counts) = bytes.split_at_checked(HEADER).ok_or(DriverRefusal::Cut)?;
        let whole = |at: usize| large(at).ok_or(DriverRefusal::Cut);
        let real = |at: usize| whole(at).map(f64::from_bits);
        let size = |at: usize| small(at).ok_or(DriverRefusal::Cut);
        let (width, height) = (size(64)?, size(68)?);
        let pixels = u64::from(width) * u64::from(height);
        if pixels.saturating_mul(2) != (length + BEFORE - HEADER) as u64 {
            return Err(DriverRefusal::Length);
        }
        if counts.len() + header.len() < length + BEFORE {
            return Err(DriverRefusal::Cut);
        }
        if pixels == 0 {
            return Err(DriverRefusal::Empty);
        }
        let [fx, fy, cx, cy, depth_unit] = [real(24)?, real(32)?, real(40)?, real(48)?, real(56)?];
        let camera = depth::Intrinsics { fx, fy, cx, cy, metres_per_count: depth_unit };
        if !(depth_unit > 0.0 && depth_unit <= UNIT_MOST) {
            return Err(DriverRefusal::Unit);
        }
        checks::camera(&camera, width as usize, height as usize).map_err(|_| DriverRefusal::Camera)?;
        let length = pixels as u32;
        let intrinsics = Intrinsics { fx, fy, cx, cy, depth_unit, width, height, reserved: 0, length };
        Ok(Self {
            number: whole(8)?,
            acquired: whole(16)?,
            intrinsics,
            counts: &counts[..2 * pixels as usize],
        })
    }

    /// The counts, row by row.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = u16> + 'a {
        self.counts.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A frame of 3 x 2 pixels.
    fn frame() -> Vec<u8> {
        let mut bytes = Vec::from(BEGINNING);
        bytes.extend((64_u32 + 12).to_le_bytes());
        bytes.extend([7_u64, 1_000].map(u64::to_le_bytes).as_flattened());
        bytes.extend([2.0, 3.0, 1.0, 0.5, 1e-3_f64].map(f64::to_le_bytes).as_flattened());
        bytes.extend([3_u32, 2].map(u32::to_le_bytes).as_flattened());
        bytes.extend((1..=6_u16).map(u16::to_le_bytes).collect::<Vec<_>>().as_flattened());
        bytes
    }

    #[test]
    fn a_frame_is_read_as_it_was_sent() {
        let bytes = frame();
        let read = DriverFrame::parse(&bytes, 6).unwrap();
        assert_eq!((read.number, read.acquired), (7, 1_000));
        let camera = read.intrinsics;
        assert_eq!((camera.width, camera.height, camera.length), (3, 2, 6));
        assert_eq!(
            [camera.fx, camera.fy, camera.cx, camera.cy, camera.depth_unit],
            [2.0, 3.0, 1.0, 0.5, 1e-3]
        );
        assert_eq!(read.counts().collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn a_frame_that_is_wrong_is_refused_with_its_cause() {
        let refused = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = frame();
            change(&mut bytes);
            DriverFrame::parse(&bytes, 6).unwrap_err()
        };
        let put = |at: usize, value: f64| {
            move |b: &mut Vec<u8>| b[at..at + 8].copy_from_slice(&value.to_le_bytes())
        };
        assert_eq!(refused(&|b| b[3] = b'2'), DriverRefusal::Foreign);
        assert_eq!(refused(&|b| b.truncate(80)), DriverRefusal::Cut);
        assert_eq!(refused(&|b| b.truncate(2)), DriverRefusal::Cut);
        assert_eq!(refused(&|b| b[4] = 78), DriverRefusal::TooLong);
        assert_eq!(refused(&|b| b[64] = 2), DriverRefusal::Length);
        assert_eq!(refused(&|b| b[67] = 255), DriverRefusal::Length);
        assert_eq!(refused(&|b| (b[4], b[64]) = (64, 0)), DriverRefusal::Empty);
        assert_eq!(refused(&put(24, f64::NAN)), DriverRefusal::Camera);
        assert_eq!(refused(&put(40, 7.0)), DriverRefusal::Camera);
        for unit in [0.0, -1e-3, 1.0, f64::NAN] {
            assert_eq!(refused(&put(56, unit)), DriverRefusal::Unit);
        }
    }

    proptest! {
        #[test]
        fn bytes_of_any_kind_are_read_or_refused(noise in prop::collection::vec(any::<u8>(), 0..200), at in 0..84_usize, value: u8) {
            let _ = DriverFrame::parse(&noise, 6);
            let mut bytes = frame();
            bytes[at] = value;
            if let Ok(read) = DriverFrame::parse(&bytes, 6) {
                prop_assert_eq!(read.counts().len(), 6);
            }
        }
    }
}
