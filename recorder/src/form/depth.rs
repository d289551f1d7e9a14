//! `DepthImage` as `sensor_msgs/msg/Image` (`16UC1`). Its intrinsics are in the channel's metadata, exact, and in a
//! `sensor_msgs/msg/CameraInfo` beside it for viewers.

use std::collections::BTreeMap;

use stillpoint_samples::{HEADER_SIZE, Intrinsics, Pieces};
use zerocopy::{FromBytes, IntoBytes};

use super::image::{Encoding, Image};
use super::{Decoded, Envelope, Fault, Shared};
use stillpoint_cdr::Writer;

const ENCODING: Encoding = Encoding { name: "16UC1", pixel: size_of::<u16>() as u32 };

fn intrinsics(sample: &Pieces<'_>) -> Option<Intrinsics> {
    Intrinsics::read_from_bytes(sample.meta.get(HEADER_SIZE..)?).ok()
}

fn numbers(i: &Intrinsics) -> [(&'static str, f64); 5] {
    [
        ("stillpoint.fx_px", i.fx),
        ("stillpoint.fy_px", i.fy),
        ("stillpoint.cx_px", i.cx),
        ("stillpoint.cy_px", i.cy),
        ("stillpoint.depth_unit_m", i.depth_unit),
    ]
}

/// The intrinsics as texts that read back exactly. `None`: they do not, or the image is no grid.
pub(super) fn extra(sample: &Pieces<'_>) -> Option<BTreeMap<String, String>> {
    let i = intrinsics(sample)?;
    let grid = i.reserved == 0 && image(&i, sample).is_grid(i.length, &ENCODING);
    let mut extra = BTreeMap::new();
    for (name, value) in numbers(&i) {
        let text = value.to_string();
        // A NaN has more bits than its text.
        text.parse::<f64>().ok().filter(|back| back.to_bits() == value.to_bits())?;
        extra.insert(name.to_owned(), text);
    }
    grid.then_some(extra)
}

fn image<'a>(i: &Intrinsics, sample: &Pieces<'a>) -> Image<'a> {
    Image { stamp: sample.header().stamp, width: i.width, height: i.height, pixels: sample.payload }
}

pub(super) fn encode(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let i = intrinsics(sample).unwrap_or_default();
    image(&i, sample).encode(frame, &ENCODING, out);
}

pub(super) fn decode<'a>(shared: &Shared, envelope: Envelope, data: &'a [u8]) -> Result<Decoded<'a>, Fault> {
    let (Image { stamp, width, height, pixels }, length) = Image::decode(&ENCODING, data)?;
    let mut i = Intrinsics { width, height, length, ..Intrinsics::default() };
    for (to, (name, _)) in [&mut i.fx, &mut i.fy, &mut i.cx, &mut i.cy, &mut i.depth_unit]
        .into_iter()
        .zip(numbers(&Intrinsics::default()))
    {
        let text = shared.extra.get(name).ok_or_else(|| format!("its channel does not say `{name}`"))?;
        *to = text.parse().map_err(|_| format!("`{name}` is `{}`, no number", text.escape_debug()))?;
    }
    let meta = [shared.header(envelope, stamp, length).as_bytes(), i.as_bytes()].concat();
    Ok(Decoded { meta: meta.into(), payload: pixels.into() })
}

/// Appends the `sensor_msgs/msg/CameraInfo` of a depth image.
pub(crate) fn camera_info(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let i = intrinsics(sample).unwrap_or_default();
    let mut w = Writer::new(out);
    w.header(sample.header().stamp, frame);
    w.u32(i.height);
    w.u32(i.width);
    w.text("plumb_bob");
    w.u32(5);
    w.f64s(&[0.0; 5]);
    w.f64s(&[i.fx, 0.0, i.cx, 0.0, i.fy, i.cy, 0.0, 0.0, 1.0]);
    w.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    w.f64s(&[i.fx, 0.0, i.cx, 0.0, 0.0, i.fy, i.cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    w.u32(0);
    w.u32(0);
    // No region of interest: zeros mean the whole image.
    for _ in 0..4 {
        w.u32(0);
    }
    w.u8(0);
}
