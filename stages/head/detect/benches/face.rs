//! Time of a detection: on the reference photograph, where it is there, and on noise, which has no
//! face but much to reject.
//!
//! `cargo bench -p stillpoint-detect`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use stillpoint_detect::{DetectParams, FaceDetector, Top};
use stillpoint_testing::reference;

fn detect(criterion: &mut Criterion) {
    let mut detector = match FaceDetector::new() {
        Ok(detector) => detector,
        Err(error) => return eprintln!("no model: {error}"),
    };
    let mut group = criterion.benchmark_group("detect.face");
    group.sample_size(20);
    // A linear congruential generator is noise enough.
    let noise: Vec<u8> = (0..640 * 480_u32).map(|i| (i.wrapping_mul(1_103_515_245) >> 16) as u8).collect();
    let params = DetectParams { top: Top::Up, smallest: 40, largest: 240, least_score: 2.0 };
    group.bench_function("noise, 640 x 480, from 40 px", |b| {
        b.iter(|| detector.find(black_box(&noise), 640, &params).len());
    });
    let Some(root) = reference::folder("perception/real") else { return };
    let file = std::fs::read(root.join("ensenso_ir_face_1.png"));
    let image = file
        .map_err(|e| e.to_string())
        .and_then(|bytes| stillpoint_ingest::grey::decode_png(&bytes).map_err(|e| e.to_string()));
    match image {
        Ok(image) => {
            let params = DetectParams { top: Top::Left, smallest: 80, largest: 640, least_score: 2.0 };
            group.bench_function("photograph, 1280 x 1024, from 80 px", |b| {
                b.iter(|| detector.find(black_box(&image.pixels), image.width, &params).len());
            });
        }
        Err(error) => eprintln!("the photograph is not timed: {error}"),
    }
    group.finish();
}

criterion_group!(benches, detect);
criterion_main!(benches);
