//! `DepthImage` as `sensor_msgs/msg/Image`, as REP 118 has it: `16UC1` where a count is a millimetre, else `32FC1` in metres.
//! Its intrinsics are in the channel's metadata, exact, and in a `sensor_msgs/msg/CameraInfo` beside it for viewers.

use std::collections::BTreeMap;

use stillpoint_samples::{HEADER_SIZE, Intrinsics, Pieces};
use zerocopy::{FromBytes, IntoBytes};

use super::image::{Encoding, Image};
use super::{Decoded, Envelope, Fault, Shared};

const ENCODING: Encoding = Encoding { name: "16UC1", pixel: size_of::<u16>() as u32 };
const METRES: Encoding = Encoding { name: "32FC1", pixel: size_of::<f32>() as u32 };
const MILLIMETRE: f64 = 1e-3;
/// Lengths of a count, m, at which every count comes back from metres: a float of 32 bits tells 65535 counts apart.
const UNITS: core::ops::RangeInclusive<f64> = 1e-9..=1e6;

pub(super) fn intrinsics(sample: &Pieces<'_>) -> Option<Intrinsics> {
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

/// The intrinsics as texts that read back exactly. `None`: they do not, the image is no grid, or counts are no millimetres.
pub(super) fn millimetres(sample: &Pieces<'_>) -> Option<BTreeMap<String, String>> {
    extra(sample, &ENCODING, |unit| unit.to_bits() == MILLIMETRE.to_bits())
}

/// The intrinsics as texts that read back exactly. `None`: they do not, the image is no grid, or counts do not come back
/// from metres.
pub(super) fn metres(sample: &Pieces<'_>) -> Option<BTreeMap<String, String>> {
    extra(sample, &METRES, |unit| UNITS.contains(&unit))
}

fn extra(
    sample: &Pieces<'_>,
    encoding: &Encoding,
    fits: impl Fn(f64) -> bool,
) -> Option<BTreeMap<String, String>> {
    let i = intrinsics(sample)?;
    let is_short = u64::from(i.length) * u64::from(encoding.pixel) <= u64::from(u32::MAX);
    let grid = i.reserved == 0 && is_short && image(&i, sample).is_grid(i.length, encoding);
    let mut extra = BTreeMap::new();
    for (name, value) in numbers(&i) {
        let text = value.to_string();
        // A NaN has more bits than its text.
        text.parse::<f64>().ok().filter(|back| back.to_bits() == value.to_bits())?;
        extra.insert(name.to_owned(), text);
    }
    (grid && fits(i.depth_unit)).then_some(extra)
}

fn image<'a>(i: &Intrinsics, sample: &Pieces<'a>) -> Image<'a> {
    Image { time: sample.header().origin, width: i.width, height: i.height, pixels: sample.payload }
}

pub(super) fn encode(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let i = intrinsics(sample).unwrap_or_default();
    image(&i, sample).encode(frame, &ENCODING, out);
}

/// A pixel without a measurement, a count of zero, is NaN.
pub(super) fn encode_metres(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let i = intrinsics(sample).unwrap_or_default();
    let counts = sample.payload.chunks_exact(2).map(|c| u16::from_le_bytes([c[0], c[1]]));
    let pixels: Vec<u8> = counts.flat_map(|count| length(count, i.depth_unit).to_le_bytes()).collect();
    Image { pixels: &pixels, ..image(&i, sample) }.encode(frame, &METRES, out);
}

fn length(count: u16, unit: f64) -> f32 {
    if count == 0 { f32::NAN } else { (f64::from(count) * unit) as f32 }
}

pub(super) fn decode<'a>(shared: &Shared, envelope: Envelope, data: &'a [u8]) -> Result<Decoded<'a>, Fault> {
    let (image, length) = Image::decode(&ENCODING, data)?;
    Ok(Decoded { meta: meta(shared, envelope, &image, length)?.0.into(), payload: image.pixels.into() })
}

pub(super) fn decode_metres(
    shared: &Shared,
    envelope: Envelope,
    data: &[u8],
) -> Result<Decoded<'static>, Fault> {
    let (image, count) = Image::decode(&METRES, data)?;
    let (meta, unit) = meta(shared, envelope, &image, count)?;
    let mut payload = Vec::with_capacity(2 * count as usize);
    for pixel in image.pixels.chunks_exact(4) {
        let metres = f32::from_le_bytes([pixel[0], pixel[1], pixel[2], pixel[3]]);
        let found = if metres.is_nan() { 0.0 } else { (f64::from(metres) / unit).round() };
        let count = found as u16;
        if f64::from(count) != found || !metres.is_nan() && length(count, unit).to_bits() != metres.to_bits()
        {
            return Err(Fault::Depth { metres, unit });
        }
        payload.extend_from_slice(&count.to_le_bytes());
    }
    Ok(Decoded { meta: meta.into(), payload: payload.into() })
}

/// Header and body of an image of `length` pixels, and the length of a count, m.
fn meta(
    shared: &Shared,
    envelope: Envelope,
    image: &Image<'_>,
    length: u32,
) -> Result<(Vec<u8>, f64), Fault> {
    let mut i = Intrinsics { width: image.width, height: image.height, length, ..Intrinsics::default() };
    for (to, (name, _)) in [&mut i.fx, &mut i.fy, &mut i.cx, &mut i.cy, &mut i.depth_unit]
        .into_iter()
        .zip(numbers(&Intrinsics::default()))
    {
        let text = shared.extra.get(name).ok_or(Fault::Unstated(name))?;
        *to = text.parse().map_err(|_| Fault::Number { name, text: text.clone() })?;
    }
    let header = shared.header(envelope, image.time, length);
    Ok(([header.as_bytes(), i.as_bytes()].concat(), i.depth_unit))
}
