//! PLY files: what is read, what is refused, and the operator.

#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use stillpoint_ingest::INVALID_POINT;
use stillpoint_ingest::ply::{PlyError, read};
use stillpoint_operator::Registry;
use stillpoint_operator::files::MemoryFiles;
use stillpoint_samples::PointCloud;
use stillpoint_testing::run;

const POINTS: [[f32; 3]; 3] = [[0.5, -1.25, 2.0], [f32::NAN, 0.0, 1.0], [0.0, 0.25, 430.0]];

/// A file as MeshLab writes it: other properties between the coordinates, another element before, faces behind.
fn ply(format: &str) -> Vec<u8> {
    let header = format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement camera 1\nproperty float view\nelement vertex 3\n\
         property float x\nproperty uchar red\nproperty float y\nproperty double z\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    if format == "ascii" {
        bytes.extend_from_slice(b"1.5\n");
        for [x, y, z] in POINTS {
            // Text has no word for what is no number.
            let x = if x.is_nan() { "1e39".to_owned() } else { x.to_string() };
            bytes.extend_from_slice(format!("{x} 200 {y} {z}\n").as_bytes());
        }
        bytes.extend_from_slice(b"3 0 1 2\n");
        return bytes;
    }
    let little = format == "binary_little_endian";
    let turned = |mut number: Vec<u8>| {
        if !little {
            number.reverse();
        }
        number
    };
    bytes.extend(turned(1.5_f32.to_le_bytes().to_vec()));
    for [x, y, z] in POINTS {
        bytes.extend(turned(x.to_le_bytes().to_vec()));
        bytes.push(200);
        bytes.extend(turned(y.to_le_bytes().to_vec()));
        bytes.extend(turned(f64::from(z).to_le_bytes().to_vec()));
    }
    bytes.push(3);
    (0..3_i32).for_each(|corner| bytes.extend(turned(corner.to_le_bytes().to_vec())));
    bytes
}

#[test]
fn vertices_are_read_from_all_formats() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let points = read(&ply(format)).unwrap();
        assert_eq!((points[0], points[2]), (POINTS[0], POINTS[2]), "{format}");
        assert_eq!(points[1].map(f32::to_bits), INVALID_POINT.map(f32::to_bits), "{format}");
        assert_eq!(points.len(), 3);
    }
}

#[test]
fn what_is_no_cloud_is_refused_before_memory_is_taken() {
    let text = |text: &str| read(text.as_bytes()).unwrap_err();
    assert!(matches!(text("solid"), PlyError::NoPly(_)));
    let faces =
        text("ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int i\nend_header\n3 0 1 2\n");
    assert!(matches!(faces, PlyError::NoVertices));
    let flat = text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n",
    );
    assert!(matches!(flat, PlyError::NoVertices));
    let many = text("ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n");
    assert!(matches!(many, PlyError::TooMany { count: 99_999_999_999, .. }), "{many}");
    let endless = text("ply\nformat binary_little_endian 1.0\nelement nothing 9999999999\nend_header\n");
    assert!(matches!(endless, PlyError::TooMany { most: 0, .. }), "{endless}");
    let listed = text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float x\nproperty float y\nproperty float z\nend_header\n1 2 3 4\n",
    );
    assert!(matches!(listed, PlyError::NoVertices), "{listed}");
}

#[test]
fn millimetres_are_asked_about_and_then_read() {
    let far = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 430\n10 0 500\n";
    let files = MemoryFiles { files: [("c/0.ply".to_string(), far.as_bytes().to_vec())].into() };
    let sent = |params: &str| {
        let text = format!(
            "stillpoint: 1\nname: x\nframes: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}\noperators:\n  \
             it: {{ use: ingest.ply, every: 100 ms, frame: camera, params: {{ files: c{params} }} }}\n"
        );
        let run = run(&text, &Registry::new(&[stillpoint_ingest::STAGES]), &files, 300)?;
        let samples = run.samples::<PointCloud>("it.cloud");
        Ok::<_, String>(
            samples.iter().map(|c| c.elements.iter().map(|p| p.xyz).collect()).collect::<Vec<Vec<_>>>(),
        )
    };
    let asked = sent("").unwrap_err();
    assert!(
        asked.contains("c/0.ply: its nearest point is 430 m from the origin (allowed: at most 20 m): are these millimetres?"),
        "{asked}"
    );
    assert_eq!(sent(", unit: mm").unwrap(), [vec![[0.0, 0.0, 0.43], [0.01, 0.0, 0.5]]]);
    let few = sent(", unit: mm, max_points: 1").unwrap_err();
    assert!(few.contains("it has 2 points: raise `max_points`"), "{few}");
}

proptest! {
    #[test]
    fn broken_files_are_refused_without_a_panic(which in 0..3_usize, at in 0..400_usize, byte in any::<u8>(), keep in 0..400_usize) {
        let mut bytes = ply(["ascii", "binary_little_endian", "binary_big_endian"][which]);
        if let Some(place) = bytes.get_mut(at) {
            *place = byte;
        }
        bytes.truncate(keep.max(100));
        let _ = read(&bytes);
    }
}
