//! Time of a pose, and of the lesser ways to one (centroid, summit, forehead, three points): the rig's head at 640x480 with the noise of a structured-light camera, its face cut out by label.
//!
//! `cargo bench -p stillpoint-track`

use std::hint::black_box;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Vector3, vector};
use stillpoint_rig::camera::{Pinhole, couch_from_camera};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{DEPTH_UNIT_M, NoiseModel, NoiseParams};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::{Label, Scene};
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_rig::trajectory::{Motion, Trajectory, rest_on_pad};
use stillpoint_track::forehead::{FaceArea, ForeheadFinder, HeadTop};
use stillpoint_track::summit::SummitFinder;
use stillpoint_track::{HeadTracker, centroid};

const FRAMES: u64 = 20;

/// The faces of a head that moves by a script, 10 a second.
fn faces() -> Result<Vec<Vec<Vector3<f64>>>, Box<dyn std::error::Error>> {
    let pinhole = Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 480)?;
    let view_from = couch_from_camera(vector![0.0, -0.48, 0.59], [45f64.to_radians(), 0.0, 0.0]);
    let mut renderer = Renderer::new(pinhole, &view_from, &Scene::treatment_couch()?, Head::new(1.0)?)?;
    let mut sensor = DepthSensor::new(&pinhole, NoiseModel::new(NoiseParams::structured_light())?);
    let script = Trajectory::new(Motion::Nods, 7, rest_on_pad());
    let mut counts = vec![0; pinhole.pixels()];
    let mut faces = Vec::new();
    for frame in 0..FRAMES {
        let view = renderer.render(&script.couch_from_head(frame as f64 * 0.1))?;
        sensor.sense(view, &mut ChaCha8Rng::seed_from_u64(frame), &mut counts)?;
        let shown = (0..pinhole.pixels()).filter(|&i| view.label()[i] == Label::Head as u8 && counts[i] > 0);
        let point = |i: usize| pinhole.direction(i % 640, i / 640) * (f64::from(counts[i]) * DEPTH_UNIT_M);
        let face: Vec<_> = shown.map(point).collect();
        if face.len() < 5000 {
            return Err(format!("frame {frame} shows {} points of the head", face.len()).into());
        }
        faces.push(face);
    }
    Ok(faces)
}

fn head(criterion: &mut Criterion) {
    let faces = match faces() {
        Ok(faces) => faces,
        Err(error) => return eprintln!("no faces to track: {error}"),
    };
    let mut group = criterion.benchmark_group("track.head");
    group.sample_size(20);
    group.bench_function("capture", |b| b.iter(|| HeadTracker::default().capture(black_box(&faces[0]), 0)));
    let mut followed = HeadTracker::default();
    let mut frame = 0;
    if let Err(error) = followed.capture(&faces[0], 0) {
        return eprintln!("no reference: {error}");
    }
    group.bench_function("frame", |b| {
        b.iter(|| {
            frame += 1;
            followed.track(black_box(&faces[frame % faces.len()]), frame as u64 * 100_000_000).is_ok()
        });
    });
    let mut lost = HeadTracker::default();
    if let Err(error) = lost.capture(&faces[0], 0) {
        return eprintln!("no reference: {error}");
    }
    group.bench_function("frame after a loss", |b| {
        b.iter(|| {
            lost.lose();
            lost.track(black_box(&faces[5]), 0).is_ok()
        });
    });
    group.bench_function("three points", |b| b.iter(|| followed.three_points(black_box(&faces[5]))));
    group.finish();
    let face: Vec<[f32; 3]> = faces[5].iter().map(|p| [p.x as f32, p.y as f32, p.z as f32]).collect();
    lesser(criterion, &face);
}

/// The ways to a position, on a face; the forehead on a grid that the face fills.
fn lesser(criterion: &mut Criterion, face: &[[f32; 3]]) {
    criterion.bench_function("track.centroid", |b| b.iter(|| centroid(black_box(face).iter().copied())));
    // The camera looks along z: what is nearest to it is highest.
    let towards: Vec<[f32; 3]> = face.iter().map(|[x, y, z]| [*x, *y, -z]).collect();
    let mut summit = SummitFinder::default();
    criterion.bench_function("track.summit", |b| b.iter(|| summit.find(black_box(&towards), 0.01, 0.008)));
    let width = face.len().isqrt();
    let side = width as f64;
    let area = FaceArea { left: 0.0, top: 0.0, width: side, height: side };
    let mut forehead = ForeheadFinder::default();
    criterion.bench_function("track.forehead", |b| {
        b.iter(|| forehead.find(black_box(&face[..width * width]), width, &area, HeadTop::Up));
    });
}

criterion_group!(benches, head);
criterion_main!(benches);
