//! `GreyImage` as `sensor_msgs/msg/Image` (`mono8`).

use stillpoint_samples::{GreyShape, HEAD_SIZE, Pieces};
use zerocopy::{FromBytes, IntoBytes};

use super::cdr::{Reader, Writer};
use super::{Decoded, Envelope, Fault, Shared};

fn shape(sample: &Pieces<'_>) -> Option<GreyShape> {
    GreyShape::read_from_bytes(sample.meta.get(HEAD_SIZE..)?).ok()
}

/// Whether the message says all that the sample says.
pub(super) fn fits(sample: &Pieces<'_>) -> bool {
    shape(sample).is_some_and(|s| {
        s.reserved == 0
            && u64::from(s.width) * u64::from(s.height) == u64::from(s.length)
            && u32::try_from(sample.payload.len()).is_ok()
    })
}

pub(super) fn encode(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let shape = shape(sample).unwrap_or_default();
    let mut w = Writer::new(out);
    w.header(sample.head().stamp, frame);
    w.u32(shape.height);
    w.u32(shape.width);
    w.text("mono8");
    w.u8(0);
    w.u32(shape.width);
    w.bytes(sample.payload);
}

pub(super) fn decode<'a>(shared: &Shared, envelope: Envelope, data: &'a [u8]) -> Result<Decoded<'a>, Fault> {
    let mut r = Reader::new(data)?;
    let stamp = r.header()?;
    let (height, width) = (r.u32()?, r.u32()?);
    let encoding = r.text()?;
    let (_big_endian, _step) = (r.u8()?, r.u32()?);
    let pixels = r.bytes()?;
    let count = u64::from(width) * u64::from(height);
    if encoding != "mono8" || pixels.len() as u64 != count {
        let encoding = encoding.escape_debug();
        return Err(format!("{} bytes of `{encoding}` are not {width} x {height} grey pixels", pixels.len()));
    }
    let length = u32::try_from(count).map_err(|_| format!("{count} pixels are too many"))?;
    let shape = GreyShape { width, height, reserved: 0, length };
    let meta = [shared.head(envelope, stamp, length).as_bytes(), shape.as_bytes()].concat();
    Ok(Decoded { meta: meta.into(), payload: pixels.into() })
}
