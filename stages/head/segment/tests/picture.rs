//! Pictures of what was segmented, for people to look at.

#![allow(clippy::unwrap_used)]

use std::path::PathBuf;

/// Draws a frame into the folder that `$STILLPOINT_PICTURES` names, if it names one: green where head and face agree,
/// red where the face is too much, blue where it lacks; the rest by its relief.
pub fn draw(name: &str, cloud: &[[f32; 3]], width: usize, head: &[bool], face: &[u32]) {
    let Some(folder) = std::env::var_os("STILLPOINT_PICTURES").map(PathBuf::from) else { return };
    let mut in_face = vec![false; cloud.len()];
    for &i in face {
        in_face[i as usize] = true;
    }
    let mut picture = Vec::new();
    for i in 0..cloud.len() {
        let z = cloud[i][2];
        let next = cloud.get(i + 1).map_or(z, |p| p[2]);
        let light = if z.is_finite() { (0.6 + (next - z) / 0.006).clamp(0.2, 1.0) } else { 0.0 };
        let colour = match (head[i], in_face[i]) {
            (true, true) => [80.0, 220.0, 80.0],
            (false, true) => [255.0, 60.0, 60.0],
            (true, false) => [80.0, 110.0, 255.0],
            (false, false) => [170.0; 3],
        };
        picture.extend(colour.map(|c: f32| (c * light) as u8));
    }
    let file = std::fs::File::create(folder.join(format!("{name}.png"))).unwrap();
    let mut encoder = png::Encoder::new(file, width as u32, (cloud.len() / width) as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&picture).unwrap();
}
