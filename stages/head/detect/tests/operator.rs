//! `ingest.grey`, `detect.face` and `track.forehead` as operators of a pipeline.

#![allow(clippy::unwrap_used, clippy::panic)]

use stillpoint_operator::Registry;
use stillpoint_operator::files::{DiskFiles, MemoryFiles};
use stillpoint_samples::{FaceBoxes, GreyImage, GreyShape, PointCloud, Pose, Rejection};
use stillpoint_testing::reference;
use stillpoint_testing::{Bench, Run, feed, run};

fn registry() -> Registry {
    Registry::new(&[
        feed::STAGES,
        stillpoint_ingest::STAGES,
        stillpoint_detect::STAGES,
        stillpoint_track::STAGES,
    ])
}

const HEAD: &str = "
stillpoint: 1
name: faces
frames: { camera: { parent: couch, at: [0 m, 0 m, 1 m] } }
operators:
";

fn grey_png(width: u32, height: u32, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    bytes
}

fn depth_png(width: u32, height: u32, count: u16) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let pixels: Vec<u8> = (0..width * height).flat_map(|_| count.to_be_bytes()).collect();
    encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
    bytes
}

fn files(list: &[(&str, Vec<u8>)]) -> MemoryFiles {
    MemoryFiles { files: list.iter().map(|(n, b)| ((*n).to_string(), b.clone())).collect() }
}

#[test]
fn grey_files_become_images_and_an_image_without_a_face_says_so() {
    let files = files(&[("i/0.png", grey_png(3, 2, &[1, 2, 3, 4, 5, 6])), ("i/1.png", grey_png(1, 1, &[9]))]);
    let text = format!(
        "{HEAD}  grey: {{ use: ingest.grey, every: 100 ms, frame: camera, params: {{ files: i }} }}\n  \
         face: {{ use: detect.face, inputs: {{ image: grey.image }} }}\n"
    );
    let run: Run = run(&text, &registry(), &files, 500).unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    let images = run.samples::<GreyImage>("grey.image");
    assert_eq!(images.len(), 2);
    assert_eq!(
        (images[0].body.width, images[0].body.height, images[0].elements),
        (3, 2, &[1, 2, 3, 4, 5, 6][..])
    );
    let faces = run.samples::<FaceBoxes>("face.faces");
    assert_eq!(faces.iter().map(|f| (f.body.width, f.elements.len())).collect::<Vec<_>>(), [(3, 0), (1, 0)]);
}

#[test]
fn other_files_are_refused_with_what_they_are() {
    let text = format!(
        "{HEAD}  grey: {{ use: ingest.grey, every: 100 ms, frame: camera, params: {{ files: i }} }}\n"
    );
    let refused =
        |bytes| run(&text, &registry(), &files(&[("i/0.png", bytes)]), 100).map(|_| ()).unwrap_err();
    let error = refused(depth_png(2, 1, 7));
    assert!(
        error.contains("i/0.png: a grey image is 8-bit greyscale, this one is 16-bit greyscale"),
        "{error}"
    );
    let error = refused(vec![1, 2, 3]);
    assert!(error.contains("i/0.png: the grey image is not a readable PNG"), "{error}");
}

#[test]
fn an_image_whose_size_lies_fails_its_activation() {
    let text = format!(
        "{HEAD}  grey: {{ use: ingest.grey, every: 100 ms, frame: camera, params: {{ files: i.png }} }}\n  \
         face: {{ use: detect.face, inputs: {{ image: grey.image }} }}\n"
    );
    let files = files(&[("i.png", grey_png(1, 1, &[9]))]);
    let stages = [stillpoint_ingest::STAGES, stillpoint_detect::STAGES].concat();
    let mut bench = Bench::new(&text, "face", &stages, &files).unwrap();
    let shape = GreyShape { width: 5, height: 5, reserved: 0, length: 9 };
    let left = bench.feed::<GreyImage>(0, &shape, &[0; 9], 0);
    assert!(left.fault.unwrap().contains("5 x 5 pixels came with 9"));
}

#[test]
fn a_frame_without_a_face_has_no_forehead_and_says_so() {
    let files = files(&[("d.png", depth_png(60, 60, 8000)), ("i.png", grey_png(60, 60, &[7; 3600]))]);
    let text = format!(
        "{HEAD}  cloud: {{ use: ingest.depth, every: 100 ms, frame: camera, params: {{ files: d.png, at_end: repeat, camera: {{ fx: 60 px, fy: 60 px, cx: 30 px, cy: 30 px, depth_unit: 0.1 mm }} }} }}\n  \
         grey: {{ use: ingest.grey, every: 100 ms, frame: camera, params: {{ files: i.png, at_end: repeat }} }}\n  \
         face: {{ use: detect.face, inputs: {{ image: grey.image }} }}\n  \
         forehead: {{ use: track.forehead, inputs: {{ cloud: cloud.cloud, faces: face.faces }} }}\n"
    );
    let run = run(&text, &registry(), &files, 500).unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    let rejections = run.samples::<Rejection>("forehead.rejection");
    assert!(rejections.len() >= 4);
    let first = rejections[0].first().unwrap();
    assert_eq!((first.code, first.reason()), (1, "the image shows no face"));
    assert!(run.bytes("forehead.position").is_empty());
}

#[test]
fn the_photographs_forehead_has_the_distance_of_its_pixels() {
    let Some(root) = reference::folder("perception/real") else { return };
    // A photograph, and a made depth image of the same size: 0.8 m everywhere.
    let folder = std::env::temp_dir().join(format!("stillpoint-forehead-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("depth.png"), depth_png(1280, 1024, 8000)).unwrap();
    let photograph = root.join("ensenso_ir_face_1.png");
    std::fs::copy(photograph, folder.join("grey.png")).unwrap();
    let text = format!(
        "{HEAD}  cloud: {{ use: ingest.depth, every: 100 ms, frame: camera, params: {{ files: depth.png, max_pixels: 1310720, camera: {{ fx: 1200 px, fy: 1200 px, cx: 640 px, cy: 512 px, depth_unit: 0.1 mm }} }} }}\n  \
         grey: {{ use: ingest.grey, every: 100 ms, frame: camera, params: {{ files: grey.png }} }}\n  \
         face: {{ use: detect.face, inputs: {{ image: grey.image }}, params: {{ top: left, smallest: 80, largest: 640 }} }}\n  \
         forehead: {{ use: track.forehead, inputs: {{ cloud: cloud.cloud, faces: face.faces }} }}\n"
    );
    let run = run(&text, &registry(), &DiskFiles::next_to(&folder.join("faces.yaml")), 300).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(run.failed(), [] as [&str; 0]);
    assert_eq!(run.samples::<PointCloud>("cloud.cloud").len(), 1);
    let positions = run.samples::<Pose>("forehead.position");
    let pose = positions[0].first().unwrap();
    eprintln!("forehead at {:?}", pose.position);
    assert!((pose.position[2] - 0.8).abs() < 1e-6);
    assert!((pose.covariance[14].sqrt() - 1e-3).abs() < 1e-6 && pose.covariance[0].is_infinite());
}
