//! Claims about the depth image that a sensor makes of a view.

#![allow(clippy::unwrap_used, reason = "a set-up that fails is a test that fails")]

use chacha20::ChaCha8Rng;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::SeedableRng;
use stillpoint_rig::camera::{Pinhole, couch_from_camera};
use stillpoint_rig::head::Head;
use stillpoint_rig::noise::{NoiseModel, NoiseParams};
use stillpoint_rig::render::Renderer;
use stillpoint_rig::scene::Scene;
use stillpoint_rig::sensor::{DepthSensor, SenseError};
use stillpoint_rig::trajectory::rest_on_pad;
use stillpoint_rig::view::RenderedView;

fn pinhole() -> Pinhole {
    Pinhole::new(566.0, 566.0, 319.5, 239.5, 640, 480).unwrap()
}

fn head_on_couch() -> RenderedView {
    let pose = couch_from_camera(Vector3::new(0.0, -0.48, 0.59), [45f64.to_radians(), 0.0, 0.0]);
    let scene = Scene::treatment_couch().unwrap();
    let mut renderer = Renderer::new(pinhole(), &pose, &scene, Head::new(1.0).unwrap()).unwrap();
    renderer.render(&rest_on_pad()).unwrap().clone()
}

/// The floor alone, seen from `distance` metres along the optical axis, turned by `angle` radians.
fn floor_at(distance: f64, angle: f64) -> RenderedView {
    let scene = Scene::new(Vec::new(), 0.0);
    let turn = UnitQuaternion::from_euler_angles(core::f64::consts::PI + angle, 0.0, 0.0);
    let pose = Isometry3::from_parts(Translation3::new(0.0, 0.0, distance * angle.cos()), turn);
    let far_away = Isometry3::translation(0.0, 0.0, 50.0);
    let mut renderer = Renderer::new(pinhole(), &pose, &scene, Head::new(1.0).unwrap()).unwrap();
    renderer.render(&far_away).unwrap().clone()
}

fn sense(view: &RenderedView, params: NoiseParams, seed: u64) -> Vec<u16> {
    let mut depth = vec![u16::MAX; pinhole().pixels()];
    let mut sensor = DepthSensor::new(&pinhole(), NoiseModel::new(params).unwrap());
    sensor.sense(view, &mut ChaCha8Rng::seed_from_u64(seed), &mut depth).unwrap();
    depth
}

fn part_missing(depth: &[u16]) -> f64 {
    depth.iter().filter(|&&value| value == 0).count() as f64 / depth.len() as f64
}

#[test]
fn without_errors_the_image_is_the_depth_to_half_a_unit() {
    let view = head_on_couch();
    for (&units, &z) in sense(&view, NoiseParams::exact(), 1).iter().zip(view.depth_m()) {
        assert!((f32::from(units) * 1e-4 - z).abs() < 0.51e-4, "{units} {z}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let view = head_on_couch();
    for params in [NoiseParams::structured_light(), NoiseParams::kinect_v1(), NoiseParams::kinect_v2()] {
        assert_eq!(sense(&view, params, 3), sense(&view, params, 3));
        assert_ne!(sense(&view, params, 3), sense(&view, params, 4));
    }
}

#[test]
fn a_used_sensor_gives_what_a_fresh_one_gives() {
    let view = head_on_couch();
    let model = NoiseModel::new(NoiseParams::structured_light()).unwrap();
    let mut sensor = DepthSensor::new(&pinhole(), model);
    let mut depth = vec![0; pinhole().pixels()];
    sensor.sense(&floor_at(0.5, 0.2), &mut ChaCha8Rng::seed_from_u64(9), &mut depth).unwrap();
    sensor.sense(&view, &mut ChaCha8Rng::seed_from_u64(3), &mut depth).unwrap();
    assert_eq!(depth, sense(&view, NoiseParams::structured_light(), 3));
}

#[test]
fn the_deviation_on_a_plane_is_that_of_the_model() {
    for (params, distance, angle) in [
        (NoiseParams::structured_light(), 0.6, 0.0),
        (NoiseParams::structured_light(), 0.9, 0.8),
        (NoiseParams { disparity_step: 0.0, ..NoiseParams::kinect_v1() }, 0.7, 0.0),
        (NoiseParams { disparity_step: 0.0, ..NoiseParams::kinect_v1() }, 1.5, 0.9),
        (NoiseParams::kinect_v2(), 0.7, 0.5),
    ] {
        let view = floor_at(distance, angle);
        let model = NoiseModel::new(params).unwrap();
        let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0);
        let pixels = view.depth_m().iter().zip(view.cosine()).zip(sense(&view, params, 5));
        for ((&z, &cosine), units) in pixels.filter(|(_, units)| *units > 0) {
            let error = f64::from(units) * 1e-4 - f64::from(z);
            // In units of the deviation that the model and the quantisation (a twelfth of a square) give.
            let sigma = model.axial_sigma(f64::from(z), f64::from(cosine));
            let scaled = error / (sigma * sigma + 1e-8 / 12.0).sqrt();
            sum += scaled;
            squares += scaled * scaled;
            count += 1.0;
        }
        assert!(count > 250_000.0, "{count}");
        assert!((sum / count).abs() < 0.01, "{distance} m: mean {}", sum / count);
        assert!((squares / count - 1.0).abs() < 0.02, "{distance} m: variance {}", squares / count);
    }
}

#[test]
fn noise_of_neighbouring_pixels_is_not_correlated() {
    let view = floor_at(0.7, 0.0);
    let depth = sense(&view, NoiseParams { dropout: 0.0, ..NoiseParams::kinect_v2() }, 6);
    let (mut products, mut squares) = (0.0, 0.0);
    for pair in depth.windows(2) {
        let [a, b] = [pair[0], pair[1]].map(|units| f64::from(units) - 7000.0);
        products += a * b;
        squares += a * a;
    }
    assert!((products / squares).abs() < 0.01, "{}", products / squares);
}

#[test]
fn pixels_fail_as_often_as_the_model_says_and_whatever_their_noise() {
    let view = floor_at(0.7, 0.0);
    let params = NoiseParams { axial_floor: 1e-3, dropout: 0.3, ..NoiseParams::exact() };
    let depth = sense(&view, params, 7);
    assert!((part_missing(&depth) - 0.3).abs() < 0.005, "{}", part_missing(&depth));
    let left = depth.iter().filter(|&&units| units > 0).map(|&units| (f64::from(units) - 7000.0) / 10.0);
    let variance = left.clone().map(|x| x * x).sum::<f64>() / left.count() as f64;
    assert!((variance - 1.0).abs() < 0.02, "{variance}");
}

#[test]
fn nothing_is_measured_out_of_range_or_at_grazing_incidence() {
    let params = NoiseParams { near: 0.8, ..NoiseParams::exact() };
    assert_eq!(part_missing(&sense(&floor_at(0.7, 0.0), params, 1)), 1.0);
    let params = NoiseParams { far: 0.6, ..NoiseParams::exact() };
    assert_eq!(part_missing(&sense(&floor_at(0.7, 0.0), params, 1)), 1.0);
    let params = NoiseParams { grazing: 0.3, ..NoiseParams::exact() };
    assert_eq!(part_missing(&sense(&floor_at(0.7, 1.0), params, 1)), 1.0);
}

#[test]
fn disparity_steps_leave_few_depths() {
    let params = NoiseParams { dropout: 0.0, grazing: 1.5, ..NoiseParams::kinect_v1() };
    let mut depths = sense(&floor_at(0.7, 0.0), params, 2);
    depths.sort_unstable();
    depths.dedup();
    // Steps of z^2 / (f b) / 8 = 1.4 mm over a noise of some 1.4 mm, to four deviations and a half.
    assert!((7..12).contains(&depths.len()), "{depths:?}");
}

#[test]
fn a_camera_with_a_baseline_has_shadows_and_one_without_has_none() {
    let view = head_on_couch();
    let with = NoiseParams { baseline: 0.1, ..NoiseParams::exact() };
    assert_eq!(part_missing(&sense(&view, NoiseParams::exact(), 1)), 0.0);
    let shadow = part_missing(&sense(&view, with, 1));
    assert!((0.02..0.25).contains(&shadow), "{shadow}");
}

#[test]
fn pixels_change_at_edges_only_when_the_edges_alone_have_errors() {
    let view = head_on_couch();
    let exact = sense(&view, NoiseParams::exact(), 1);
    let params = NoiseParams { edge_dropout: 0.2, edge_swap: 0.2, edge_mix: 0.2, ..NoiseParams::exact() };
    let changed: Vec<usize> = sense(&view, params, 1)
        .iter()
        .zip(&exact)
        .enumerate()
        .filter(|(_, (a, b))| a != b)
        .map(|x| x.0)
        .collect();
    assert!(changed.len() > 1000, "{}", changed.len());
    for pixel in changed {
        let neighbours = [pixel.saturating_sub(1), pixel + 1, pixel.saturating_sub(640), pixel + 640];
        let z = view.depth_m()[pixel];
        let jumps = neighbours.into_iter().filter_map(|near| view.depth_m().get(near));
        assert!(jumps.clone().any(|&near| (near - z).abs() > 0.02 * z), "pixel {pixel}");
    }
}

#[test]
fn a_buffer_or_a_view_of_another_size_is_refused_with_both_sizes() {
    let mut sensor = DepthSensor::new(&pinhole(), NoiseModel::new(NoiseParams::exact()).unwrap());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let error = sensor.sense(&RenderedView::empty(&pinhole()), &mut rng, &mut [0; 5]).unwrap_err();
    assert_eq!(error, SenseError::BufferSize { expected: 640 * 480, found: 5 });
    let small = Pinhole::new(100.0, 100.0, 3.0, 3.0, 8, 6).unwrap();
    let error = sensor.sense(&RenderedView::empty(&small), &mut rng, &mut [0; 48]).unwrap_err();
    assert_eq!(error, SenseError::ViewSize { expected: (640, 480), found: (8, 6) });
}
