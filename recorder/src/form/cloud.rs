//! `PointCloud` as `sensor_msgs/msg/PointCloud2`: the points' bytes are its data.

use stillpoint_samples::{CloudShape, HEADER_SIZE, Pieces, Point};
use zerocopy::{FromBytes, IntoBytes};

use super::{Decoded, Envelope, Fault, Shared};
use stillpoint_cdr::{Reader, Writer};

const POINT: u32 = size_of::<Point>() as u32;
/// `PointField.FLOAT32`.
const FLOAT32: u8 = 7;

fn shape(sample: &Pieces<'_>) -> Option<CloudShape> {
    CloudShape::read_from_bytes(sample.meta.get(HEADER_SIZE..)?).ok()
}

/// Whether the message says all that the sample says.
pub(super) fn fits(sample: &Pieces<'_>) -> bool {
    shape(sample).is_some_and(|s| {
        s.reserved == 0
            && u64::from(s.width) * u64::from(s.height) == u64::from(s.length)
            && s.width.checked_mul(POINT).is_some()
            && u32::try_from(sample.payload.len()).is_ok()
    })
}

pub(super) fn encode(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let shape = shape(sample).unwrap_or_default();
    let mut w = Writer::new(out);
    w.header(sample.header().origin, frame);
    w.u32(shape.height);
    w.u32(shape.width);
    w.u32(3);
    for (name, offset) in [("x", 0), ("y", 4), ("z", 8)] {
        w.text(name);
        w.u32(offset);
        w.u8(FLOAT32);
        w.u32(1);
    }
    w.u8(0);
    w.u32(POINT);
    w.u32(shape.width.wrapping_mul(POINT));
    w.bytes(sample.payload);
    // Not dense: an invalid point is NaN.
    w.u8(0);
}

pub(super) fn decode<'a>(shared: &Shared, envelope: Envelope, data: &'a [u8]) -> Result<Decoded<'a>, Fault> {
    let mut r = Reader::new(data)?;
    let stamp = r.header()?;
    let (height, width) = (r.u32()?, r.u32()?);
    let fields = r.u32()?;
    if fields != 3 {
        return Err(Fault::Fields(fields));
    }
    for _ in 0..3 {
        r.text()?;
        r.u32()?;
        r.u8()?;
        r.u32()?;
    }
    r.u8()?;
    let (step, _row) = (r.u32()?, r.u32()?);
    let points = r.bytes()?;
    let count = u64::from(width) * u64::from(height);
    if step != POINT || points.len() as u64 != count.saturating_mul(u64::from(POINT)) {
        return Err(Fault::Points { bytes: points.len(), width, height, size: POINT });
    }
    let length = u32::try_from(count).map_err(|_| Fault::TooMany { count, items: "points" })?;
    let header = shared.header(envelope, stamp, length);
    let shape = CloudShape { width, height, reserved: 0, length };
    let meta = [header.as_bytes(), shape.as_bytes()].concat();
    Ok(Decoded { meta: meta.into(), payload: points.into() })
}
