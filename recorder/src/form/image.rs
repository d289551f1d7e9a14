//! `sensor_msgs/msg/Image` of one channel, rows without a gap between them.

use super::Fault;
use stillpoint_cdr::{Reader, Writer};

/// How pixels are written: the message's name for it, and bytes of one.
pub(super) struct Encoding {
    pub name: &'static str,
    pub pixel: u32,
}

/// An image.
pub(super) struct Image<'a> {
    /// The time in its header, ns.
    pub time: u64,
    pub width: u32,
    pub height: u32,
    pub pixels: &'a [u8],
}

impl<'a> Image<'a> {
    /// Whether the message says all of an image that claims `length` pixels.
    pub fn is_grid(&self, length: u32, encoding: &Encoding) -> bool {
        u64::from(self.width) * u64::from(self.height) == u64::from(length)
            && self.width.checked_mul(encoding.pixel).is_some()
            && u32::try_from(self.pixels.len()).is_ok()
    }

    pub fn encode(&self, frame: &str, encoding: &Encoding, out: &mut Vec<u8>) {
        let mut w = Writer::new(out);
        w.header(self.time, frame);
        w.u32(self.height);
        w.u32(self.width);
        w.text(encoding.name);
        w.u8(0);
        w.u32(self.width.wrapping_mul(encoding.pixel));
        w.bytes(self.pixels);
    }

    /// The image of a message, and how many pixels it has.
    pub fn decode(encoding: &Encoding, data: &'a [u8]) -> Result<(Self, u32), Fault> {
        let mut r = Reader::new(data)?;
        let time = r.header()?;
        let (height, width) = (r.u32()?, r.u32()?);
        let name = r.text()?;
        let (big_endian, _step) = (r.u8()?, r.u32()?);
        let pixels = r.bytes()?;
        let count = u64::from(width) * u64::from(height);
        let size = count.saturating_mul(u64::from(encoding.pixel));
        if name != encoding.name || big_endian != 0 || pixels.len() as u64 != size {
            let (name, bytes, expected) = (name.to_owned(), pixels.len(), encoding.name);
            return Err(Fault::Pixels { bytes, name, width, height, expected });
        }
        let length = u32::try_from(count).map_err(|_| Fault::TooMany { count, items: "pixels" })?;
        Ok((Self { time, width, height, pixels }, length))
    }
}
