//! The reference data of perception: rendered and measured scenes with labels, and what PCL 1.13 found in them.

// For tests alone: what is not as the reference data has it fails them.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use serde_json::Value;

/// The label of a head's pixels.
pub const HEAD: u8 = 4;
/// The measured clouds of which PCL found a plane; that of `person` is a wall.
pub const MEASURED: [&str; 5] = [
    "person",
    "table_scene_mug_stereo_textured",
    "milk_cartoon_all_small_clorox",
    "mOSD_learn0",
    "mOSD_test60",
];

pub fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// The labels of an image's pixels, in rows.
pub fn labels(path: &Path) -> Vec<u8> {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Grayscale, png::BitDepth::Eight));
    bytes
}

/// Unit normal and offset, toward the camera, of the plane that PCL's MLESAC found in `input` with voxels of 5 mm.
pub fn pcl_plane(reference: &Value, input: &str) -> ([f64; 3], f64) {
    let of_input = |r: &&Value| {
        r["input"] == input && r["method"] == "mlesac" && r["params"]["voxel_leaf_m"].as_f64() == Some(0.005)
    };
    plane(&reference["results"].as_array().unwrap().iter().find(of_input).unwrap()["plane"])
}

/// Unit normal and offset, toward the camera, of a plane by its four coefficients.
pub fn plane(coefficients: &Value) -> ([f64; 3], f64) {
    let [a, b, c, offset] = [0, 1, 2, 3].map(|i| coefficients[i].as_f64().unwrap());
    let length = (a * a + b * b + c * c).sqrt().copysign(offset);
    ([a / length, b / length, c / length], offset.abs())
}
