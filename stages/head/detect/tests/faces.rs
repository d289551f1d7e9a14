//! Faces in images: the photograph of the reference where its data is there, and patterns without a face.
//!
//! The project has no picture of a face of its own: the rig
//! shows depth.

#![allow(clippy::unwrap_used, clippy::panic)]

use proptest::prelude::*;
use stillpoint_detect::{DetectParams, Face, FaceDetector, Top};
use stillpoint_ingest::grey::{GreyImage, decode_png};
use stillpoint_testing::reference;

const PARAMS: DetectParams = DetectParams { top: Top::Up, smallest: 40, largest: 240, least_score: 2.0 };

fn find(image: &[u8], width: usize, params: &DetectParams) -> Vec<Face> {
    FaceDetector::new().unwrap().find(image, width, params)
}

fn photograph(root: &std::path::Path) -> GreyImage {
    decode_png(&std::fs::read(root.join("real/ensenso_ir_face_1.png")).unwrap()).unwrap()
}

/// Left, top, width, height.
type Edges = [f64; 4];

fn iou(a: Edges, b: Edges) -> f64 {
    let overlap = |i: usize| ((a[i] + a[i + 2]).min(b[i] + b[i + 2]) - a[i].max(b[i])).max(0.0);
    let both = overlap(0) * overlap(1);
    both / (a[2] * a[3] + b[2] * b[3] - both)
}

fn edges(face: &Face) -> Edges {
    let area = face.area;
    [f64::from(area.left), f64::from(area.top), f64::from(area.width), f64::from(area.height)]
}

#[test]
fn the_face_of_the_reference_photograph_is_where_haar_cascades_find_it() {
    let Some(root) = reference::folder("perception") else { return };
    let image = photograph(&root);
    let reference: serde_json::Value =
        serde_json::from_slice(&std::fs::read(root.join("haar_reference.json")).unwrap()).unwrap();
    // The reference's image is half as large and turned by 270 degrees counter-clockwise: the head's top is at the left.
    let params = DetectParams { top: Top::Left, smallest: 80, largest: 640, ..PARAMS };
    let faces = find(&image.pixels, image.width, &params);
    eprintln!("{faces:?}");
    let found = edges(&faces[0]);
    let mut compared = 0;
    for result in reference["results"].as_array().unwrap() {
        let cascade = result["cascade"].as_str().unwrap();
        let is = result["image"] == "ensenso_ir_face_1.png" && result["rot_ccw"] == 270;
        if !is || !cascade.contains("frontalface_alt") {
            continue;
        }
        let boxes = result["boxes"].as_array().unwrap().iter().map(|one| -> Edges {
            let [x, y, w, h] = [0, 1, 2, 3].map(|i| 2.0 * one[i].as_f64().unwrap());
            [y, image.height as f64 - x - w, h, w]
        });
        let best = boxes.map(|one| iou(found, one)).fold(0.0, f64::max);
        eprintln!("{cascade}: IoU {best:.3}");
        assert!(best > 0.5, "{cascade}: {best} {found:?}");
        compared += 1;
    }
    assert_eq!(compared, 4);
}

#[test]
fn the_face_moves_with_its_pixels_and_is_not_found_upside_down() {
    let Some(root) = reference::folder("perception") else { return };
    let image = photograph(&root);
    let params = DetectParams { top: Top::Left, smallest: 80, largest: 640, ..PARAMS };
    let first = find(&image.pixels, image.width, &params)[0];
    // 80 columns and 40 rows less. Windows go by steps, so the box is not the very same.
    let cropped: Vec<u8> =
        image.pixels.chunks_exact(image.width).skip(40).flat_map(|row| row[80..].iter().copied()).collect();
    let moved = find(&cropped, image.width - 80, &params)[0];
    let [a, b] = [edges(&first), edges(&moved)];
    assert!(iou(a, [b[0] + 80.0, b[1] + 40.0, b[2], b[3]]) > 0.6, "{a:?} {b:?}");
    for top in [Top::Right, Top::Up, Top::Down] {
        let other = find(&image.pixels, image.width, &DetectParams { top, ..params });
        assert!(other.iter().all(|face| iou(edges(face), a) < 0.5 || face.score < first.score), "{other:?}");
    }
    assert_eq!(find(&image.pixels, image.width, &params)[0], first);
}

/// Brightness of a pixel by its column and row.
type Pattern<'p> = &'p dyn Fn(usize, usize) -> u8;

#[test]
fn patterns_are_no_faces() {
    let (width, height) = (320, 240);
    let patterns: [(&str, Pattern<'_>); 5] = [
        ("black", &|_, _| 0),
        ("white", &|_, _| 255),
        ("slope", &|u, v| ((u + v) / 3) as u8),
        ("checkers", &|u, v| if (u / 16 + v / 16) % 2 == 0 { 30 } else { 220 }),
        ("ball", &|u, v| {
            let (x, y) = (u as f64 - 160.0, v as f64 - 120.0);
            (6400.0 - x * x - y * y).max(0.0).sqrt() as u8 * 3
        }),
    ];
    for (name, pattern) in patterns {
        let image: Vec<u8> = (0..width * height).map(|i| pattern(i % width, i / width)).collect();
        let faces = find(&image, width, &PARAMS);
        assert!(faces.is_empty(), "{name}: {faces:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn images_of_any_size_and_content_are_looked_through(
        width in 0..130_usize,
        height in 0..130_usize,
        noise in prop::collection::vec(any::<u8>(), 1..400),
        top in 0..4_usize,
        smallest in 40..130_u32,
    ) {
        let image: Vec<u8> = (0..width * height).map(|i| noise[i * 7 % noise.len()]).collect();
        let top = [Top::Up, Top::Right, Top::Down, Top::Left][top];
        let params = DetectParams { top, smallest, largest: 4 * smallest, least_score: 0.1 };
        for face in find(&image, width, &params) {
            prop_assert!(face.score.is_finite() && face.area.width <= 4000);
        }
    }
}
