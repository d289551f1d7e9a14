//! Time from a depth image of 640x480 to its cloud, and from a PCD file of as many points.
//!
//! `cargo bench -p stillpoint-ingest`

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use stillpoint_ingest::depth::{Intrinsics, decode_png, deproject};
use stillpoint_ingest::pcd;

const SIZE: [usize; 2] = [640, 480];
const CAMERA: Intrinsics = Intrinsics { fx: 566.0, fy: 566.0, cx: 319.5, cy: 239.5, metres_per_count: 1e-4 };

/// A slanted, rippled surface at 0.6 to 0.9 m; every eleventh pixel was not measured.
fn counts() -> Vec<u16> {
    let count = |i: usize| {
        let (u, v) = (i % SIZE[0], i / SIZE[0]);
        let count = 6000 + 4 * u as u16 + (v * v % 97) as u16 + (u * 7919 % 31) as u16;
        if i.is_multiple_of(11) { 0 } else { count }
    };
    (0..SIZE[0] * SIZE[1]).map(count).collect()
}

fn png(counts: &[u16]) -> Result<Vec<u8>, png::EncodingError> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, SIZE[0] as u32, SIZE[1] as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let bytes: Vec<u8> = counts.iter().flat_map(|count| count.to_be_bytes()).collect();
    encoder.write_header()?.write_image_data(&bytes)?;
    Ok(file)
}

fn clouds(criterion: &mut Criterion) {
    let counts = counts();
    let mut points = vec![[0.0; 3]; counts.len()];
    criterion.bench_function("depth image to cloud", |b| {
        b.iter(|| deproject(black_box(&counts), SIZE[0], SIZE[1], &CAMERA, &mut points).is_ok());
    });
    match png(&counts) {
        Ok(file) => {
            criterion.bench_function("depth image from a PNG", |b| {
                b.iter(|| decode_png(black_box(&file)).is_ok());
            });
        }
        Err(error) => eprintln!("no PNG: {error}"),
    }
    let binary = pcd::write_binary(&points, SIZE[0]);
    let ascii = pcd::write_ascii(&points, SIZE[0]).into_bytes();
    let mut group = criterion.benchmark_group("pcd");
    group.sample_size(10);
    for (name, file) in [("binary", &binary), ("ascii", &ascii)] {
        group.bench_function(name, |b| b.iter(|| pcd::read(black_box(file)).is_ok()));
    }
    group.finish();
}

criterion_group!(benches, clouds);
criterion_main!(benches);
