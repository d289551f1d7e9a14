//! What following a head takes from the heap from frame to frame.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use stillpoint_track::forehead::{FaceArea, ForeheadFinder, HeadTop};
use stillpoint_track::summit::SummitFinder;
use stillpoint_track::{HeadTracker, centroid};

use crate::shapes::{camera_from_body, head};

/// A head that goes to and fro, 2 mm and 1 degree from frame to frame.
fn faces() -> Vec<Vec<Vector3<f64>>> {
    let pose = |k: usize| {
        let away = if k < 3 { k } else { 6 - k } as f64;
        let mut pose: Isometry3<f64> = camera_from_body();
        pose.translation.vector += Vector3::new(2e-3, 0.0, 1e-3) * away;
        pose.rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.02, 0.0) * away) * pose.rotation;
        pose
    };
    (0..6).map(|k| head(&pose(k))).collect()
}

#[test]
fn frames_like_earlier_ones_take_no_memory() {
    let faces = faces();
    let mut tracker = HeadTracker::default();
    tracker.capture(&faces[0], 0).unwrap();
    for frame in 1..30 {
        let face = &faces[frame % faces.len()];
        let taken = allocation_counter::measure(|| {
            assert!(tracker.track(face, frame as u64 * 100_000_000).is_ok());
            std::hint::black_box(tracker.three_points(face));
        });
        assert!(frame <= faces.len() || taken.count_total == 0, "frame {frame}: {taken:?}");
    }
}

#[test]
fn the_search_after_a_loss_takes_less_than_a_kilobyte() {
    let faces = faces();
    let mut tracker = HeadTracker::default();
    tracker.capture(&faces[0], 0).unwrap();
    for frame in 1..30 {
        tracker.lose();
        let face = &faces[frame % faces.len()];
        let taken = allocation_counter::measure(|| {
            assert!(tracker.track(face, frame as u64 * 100_000_000).is_ok());
        });
        // The best starts and where they end.
        let is_little = taken.count_total <= 2 && taken.bytes_total < 1024;
        assert!(frame <= faces.len() || is_little, "frame {frame}: {taken:?}");
    }
}

#[test]
fn lesser_ways_to_a_position_take_no_memory() {
    let faces = faces();
    let (mut summit, mut forehead) = (SummitFinder::default(), ForeheadFinder::default());
    for round in 0..2 {
        for face in &faces {
            let face: Vec<[f32; 3]> = face.iter().map(|p| [p.x as f32, p.y as f32, -p.z as f32]).collect();
            let width = face.len().isqrt();
            let side = width as f64;
            let area = FaceArea { left: 0.0, top: 0.0, width: side, height: side };
            let taken = allocation_counter::measure(|| {
                assert!(centroid(face.iter().copied()).is_some());
                assert!(summit.find(&face, 0.01, 0.008).is_some());
                assert!(forehead.find(&face[..width * width], width, &area, HeadTop::Up).is_some());
            });
            assert!(round == 0 || taken.count_total == 0, "{taken:?}");
        }
    }
}
