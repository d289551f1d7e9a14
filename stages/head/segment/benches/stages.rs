//! Time of each stage of the chain on a frame of the virtual rig, and of the whole.
//!
//! `cargo bench -p stillpoint-segment`

use std::hint::black_box;

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use stillpoint_ingest::depth::{Intrinsics, deproject};
use stillpoint_rig::camera::{Pinhole, couch_from_camera};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{NoiseModel, NoiseParams};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::sensor::DepthSensor;
use stillpoint_rig::setting::Setting;
use stillpoint_segment::cluster::EuclideanClusters;
use stillpoint_segment::hull::ConvexHull;
use stillpoint_segment::mlesac::{Beneath, Mlesac, MlesacParams};
use stillpoint_segment::mls::{MlsParams, MovingLeastSquares};
use stillpoint_segment::outliers::{OutlierFilter, OutlierParams};
use stillpoint_segment::voxel::VoxelGrid;
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, Plane, Rule};

/// The cloud of an adult's head in a setting, as a Kinect of the first kind sees it from the feet, with other noise for
/// each number.
fn cloud(setting: Setting, number: u64) -> Vec<[f32; 3]> {
    let made = || -> Result<Vec<[f32; 3]>, Box<dyn std::error::Error>> {
        let camera = Pinhole::new(575.8, 575.8, 319.5, 239.5, 640, 480)?;
        let pose = couch_from_camera(Vector3::new(0.0, -0.50, 0.66), [45_f64.to_radians(), 0.0, 0.0]);
        let mut renderer = Renderer::new(camera, &pose, &setting.scene(1.0)?, Head::new(1.0)?)?;
        let view = renderer.render(&setting.rest(1.0))?;
        let mut depth = vec![0; camera.pixels()];
        let mut rng = ChaCha8Rng::seed_from_u64(number);
        DepthSensor::new(&camera, NoiseModel::new(NoiseParams::kinect_v1())?)
            .sense(view, &mut rng, &mut depth)?;
        let intrinsics = Intrinsics { fx: 575.8, fy: 575.8, cx: 319.5, cy: 239.5, metres_per_count: 1e-4 };
        let mut points = vec![[0.0; 3]; depth.len()];
        deproject(&depth, 640, 480, &intrinsics, &mut points)?;
        Ok(points)
    };
    made().unwrap_or_else(|error| {
        eprintln!("the frame cannot be made: {error}");
        std::process::exit(1)
    })
}

fn stages(criterion: &mut Criterion) {
    let points = cloud(Setting::Pads, 1);
    let params = FaceParams::default();
    let mut grid = VoxelGrid::new();
    criterion.bench_function("voxel", |b| {
        b.iter(|| {
            grid.downsample(Cloud { points: black_box(&points), width: 640 }, params.leaf, params.range_max)
        });
    });
    let voxels = grid.centroids().to_vec();
    let search = MlesacParams {
        tolerance: params.plane_tolerance,
        iterations: params.iterations,
        beneath: Beneath::Outliers,
    };
    let mut mlesac = Mlesac::new();
    let found = mlesac.find(&voxels, None, &search, &mut ChaCha8Rng::seed_from_u64(1));
    let plane = found.map_or(Plane { normal: Vector3::z(), offset: 0.0 }, |fit| fit.plane);
    for (name, prior) in [("plane", None), ("plane, with a prior", Some(&plane))] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        criterion
            .bench_function(name, |b| b.iter(|| mlesac.find(black_box(&voxels), prior, &search, &mut rng)));
    }
    let on: Vec<_> =
        voxels.iter().copied().filter(|&p| plane.height(p).abs() <= params.plane_tolerance).collect();
    let mut hull = ConvexHull::new();
    criterion.bench_function("hull", |b| b.iter(|| hull.build(&plane, black_box(&on).iter().copied())));
    let above: Vec<_> = voxels.iter().copied().filter(|&p| plane.height(p) > params.height_min).collect();
    let mut clusters = EuclideanClusters::new();
    criterion.bench_function("cluster", |b| {
        b.iter(|| clusters.find(black_box(&above), params.cluster_tolerance, params.min_points));
    });
    let mut outliers = OutlierFilter::new();
    let outlier_params = OutlierParams { neighbours: 30, deviations: 2.0, cell: 0.01 };
    let mut mls = MovingLeastSquares::new();
    let mls_params = MlsParams { neighbours: 30, deviations: 1.0, tolerance: 0.01, cell: 0.01 };
    let mut slow = criterion.benchmark_group("optional");
    slow.sample_size(10);
    slow.bench_function("outliers", |b| {
        b.iter(|| outliers.keep(black_box(&voxels), &outlier_params).len());
    });
    slow.bench_function("moving least squares", |b| {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        b.iter(|| mls.smooth(black_box(&voxels), &mls_params, &mut rng).len());
    });
    slow.finish();
}

fn chain(criterion: &mut Criterion) {
    for setting in [Setting::Pads, Setting::Patient] {
        // Two by turns: the same frame again is not searched.
        let clouds = [cloud(setting, 1), cloud(setting, 2)];
        for rule in [Rule::Largest, Rule::Head] {
            let Ok(mut segmenter) = FaceSegmenter::new(FaceParams { rule, ..FaceParams::default() }) else {
                continue;
            };
            let mut rng = ChaCha8Rng::seed_from_u64(1);
            let mut frame = 0;
            criterion.bench_function(&format!("chain, {setting:?}, {rule:?}"), |b| {
                b.iter(|| {
                    frame += 1;
                    let cloud = Cloud { points: black_box(&clouds[frame % 2]), width: 640 };
                    segmenter.segment(cloud, &mut rng).face.map_or(0, <[u32]>::len)
                });
            });
        }
    }
}

criterion_group!(benches, stages, chain);
criterion_main!(benches);
