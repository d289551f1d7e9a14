//! Depth images: what is decoded, what is refused, and where the points lie.

#![allow(clippy::unwrap_used)]

use stillpoint_ingest::INVALID_POINT;
use stillpoint_ingest::depth::{DepthError, Intrinsics, decode_png, deproject};

fn png(width: u32, height: u32, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

fn depth_png(width: u32, height: u32, counts: &[u16]) -> Vec<u8> {
    let data: Vec<u8> = counts.iter().flat_map(|c| c.to_be_bytes()).collect();
    png(width, height, png::ColorType::Grayscale, png::BitDepth::Sixteen, &data)
}

const CAMERA: Intrinsics = Intrinsics { fx: 500.0, fy: 400.0, cx: 0.5, cy: 1.0, metres_per_count: 1e-4 };

#[test]
fn sixteen_bit_counts_survive_the_png() {
    let counts = [0, 1, 255, 256, 40_000, 65_535];
    let image = decode_png(&depth_png(3, 2, &counts)).unwrap();
    assert_eq!((image.width, image.height, image.counts.as_slice()), (3, 2, counts.as_slice()));
}

#[test]
fn other_pixel_types_are_refused_by_name() {
    let eight = png(2, 1, png::ColorType::Grayscale, png::BitDepth::Eight, &[1, 2]);
    assert_eq!(
        decode_png(&eight).unwrap_err().to_string(),
        "a depth image is 16-bit greyscale, this one is 8-bit greyscale"
    );
    let colour = png(1, 1, png::ColorType::Rgb, png::BitDepth::Sixteen, &[0; 6]);
    assert!(matches!(decode_png(&colour), Err(DepthError::PixelType { bits: 16, colour: "colour" })));
}

#[test]
fn every_cut_of_a_png_is_refused() {
    let whole = depth_png(8, 8, &[1234; 64]);
    // The last chunk is empty and adds nothing: without it the pixels are whole.
    let last_chunk = 12;
    for length in 0..whole.len() - last_chunk - 4 {
        assert!(decode_png(&whole[..length]).is_err(), "cut at {length} of {}", whole.len());
    }
}

/// The checksum of PNG chunks.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xedb8_8320 } else { c >> 1 })
    })
}

#[test]
fn enormous_image_is_refused_before_memory_is_taken() {
    let mut bytes = depth_png(1, 1, &[1]);
    // The header chunk's name, width and height stand at bytes 12 to 24, its checksum at 29 to 33.
    bytes[16..24].copy_from_slice(&[0x00, 0x10, 0, 0, 0x00, 0x10, 0, 0]);
    let checksum = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
    let error = decode_png(&bytes).unwrap_err();
    assert!(
        matches!(error, DepthError::TooLarge { width: 0x10_0000, height: 0x10_0000 })
            || matches!(error, DepthError::Png(png::DecodingError::LimitsExceeded)),
        "{error}"
    );
}

#[test]
fn points_lie_on_their_pixels_rays() {
    let mut points = [[0.0; 3]; 6];
    deproject(&[10_000, 0, 20_000, 1, 2, 3], 3, 2, &CAMERA, &mut points).unwrap();
    let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(points[0], [-0.001, -0.0025, 1.0]), "{:?}", points[0]);
    assert_eq!(points[1].map(f32::to_bits), INVALID_POINT.map(f32::to_bits));
    assert!(near(points[2], [0.006, -0.005, 2.0]), "{:?}", points[2]);
    assert_eq!(points[3][1], 0.0);
}

#[test]
fn buffers_of_another_length_are_refused_and_untouched() {
    let mut points = [[7.0; 3]; 5];
    let error = deproject(&[1; 6], 3, 2, &CAMERA, &mut points).unwrap_err();
    assert_eq!(error.to_string(), "3 x 2 pixels need 6 points, there are 5");
    assert_eq!(points, [[7.0; 3]; 5]);
}
