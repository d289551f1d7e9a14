//! `GreyImage` as `sensor_msgs/msg/Image` (`mono8`).

use stillpoint_samples::{GreyShape, HEADER_SIZE, Pieces};
use zerocopy::{FromBytes, IntoBytes};

use super::image::{Encoding, Image};
use super::{Decoded, Envelope, Fault, Shared};

const ENCODING: Encoding = Encoding { name: "mono8", pixel: 1 };

fn shape(sample: &Pieces<'_>) -> Option<GreyShape> {
    GreyShape::read_from_bytes(sample.meta.get(HEADER_SIZE..)?).ok()
}

fn image<'a>(s: &GreyShape, sample: &Pieces<'a>) -> Image<'a> {
    Image { time: sample.header().origin, width: s.width, height: s.height, pixels: sample.payload }
}

/// Whether the message says all that the sample says.
pub(super) fn fits(sample: &Pieces<'_>) -> bool {
    shape(sample).is_some_and(|s| s.reserved == 0 && image(&s, sample).is_grid(s.length, &ENCODING))
}

pub(super) fn encode(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let shape = shape(sample).unwrap_or_default();
    image(&shape, sample).encode(frame, &ENCODING, out);
}

pub(super) fn decode<'a>(shared: &Shared, envelope: Envelope, data: &'a [u8]) -> Result<Decoded<'a>, Fault> {
    let (Image { time, width, height, pixels }, length) = Image::decode(&ENCODING, data)?;
    let shape = GreyShape { width, height, reserved: 0, length };
    let meta = [shared.header(envelope, time, length).as_bytes(), shape.as_bytes()].concat();
    Ok(Decoded { meta: meta.into(), payload: pixels.into() })
}
