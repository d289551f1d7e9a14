//! The chain on scenes made here: what it finds, why it refuses, and that its bits do not depend on its past.

#![allow(clippy::unwrap_used)]

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use proptest::prelude::*;
use stillpoint_segment::{FaceParams, FaceSegmenter, Rejection};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const TABLE: f32 = 1.0;

/// What stands on the table: centre, radius and height over it in metres, seen from straight above.
#[derive(Debug, Clone, Copy)]
struct Post {
    centre: [f32; 2],
    radius: f32,
    height: f32,
}

const HEAD: Post = Post { centre: [0.02, -0.05], radius: 0.1, height: 0.2 };
const CUP: Post = Post { centre: [0.3, 0.1], radius: 0.05, height: 0.12 };

/// An organised cloud of a table 1 m below the camera; `true` for points on the first post.
fn scene(posts: &[Post]) -> (Vec<[f32; 3]>, Vec<bool>) {
    let mut on_first = Vec::new();
    let points = (0..WIDTH * HEIGHT)
        .map(|i| {
            let ray = [(i % WIDTH) as f32 - 159.5, (i / WIDTH) as f32 - 119.5].map(|c| c / 280.0);
            if i % 97 == 0 {
                on_first.push(false);
                return [f32::NAN; 3];
            }
            let hit = posts.iter().position(|post| {
                let z = TABLE - post.height;
                let [x, y] = [0, 1].map(|a| ray[a] * z - post.centre[a]);
                x * x + y * y < post.radius * post.radius
            });
            on_first.push(hit == Some(0));
            let z = TABLE - hit.map_or(0.0, |h| posts[h].height);
            [ray[0] * z, ray[1] * z, z]
        })
        .collect();
    (points, on_first)
}

fn params() -> FaceParams {
    FaceParams { leaf: 0.008, ..FaceParams::default() }
}

fn rng() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(11)
}

#[test]
fn face_is_every_point_of_the_largest_thing_on_the_table() {
    let (cloud, on_head) = scene(&[HEAD, CUP]);
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let face = segmenter.segment(&cloud, &mut rng()).unwrap();
    let expected: Vec<u32> = (0..cloud.len() as u32).filter(|&i| on_head[i as usize]).collect();
    assert_eq!(face.indices, expected);
    assert_eq!(face.cluster_sizes.len(), 2);
    assert!((face.plane.offset - 1.0).abs() < 1e-4 && (face.plane.normal.z + 1.0).abs() < 1e-6);
}

#[test]
fn empty_and_invalid_frames_have_too_few_voxels() {
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let refusal = Err(Rejection::TooFewVoxels { found: 0, needed: 100 });
    assert_eq!(segmenter.segment(&[], &mut rng()), refusal);
    assert_eq!(segmenter.segment(&[[f32::NAN; 3]; 1000], &mut rng()), refusal);
    assert_eq!(segmenter.segment(&[[0.0, 0.0, 9.0]; 1000], &mut rng()), refusal);
}

#[test]
fn scattered_points_have_no_plane() {
    let cloud: Vec<_> = (0..500_u32)
        .map(|i| {
            [7, 11, 13].map(|k| (i.wrapping_mul(2_654_435_761 + k * k * k) >> 8) as f32 / (1 << 24) as f32)
        })
        .collect();
    let result = FaceSegmenter::new(params()).unwrap().segment(&cloud, &mut rng()).map(|_| ());
    assert!(matches!(result, Err(Rejection::NoPlane { needed: 100, .. })), "{result:?}");
}

#[test]
fn empty_table_has_no_cluster() {
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let result = segmenter.segment(&scene(&[]).0, &mut rng());
    assert_eq!(result, Err(Rejection::NoCluster { above: 0, needed: 100 }));
}

#[test]
fn frame_after_a_refused_one_starts_afresh() {
    let (cloud, _) = scene(&[HEAD, CUP]);
    let mut used = FaceSegmenter::new(params()).unwrap();
    used.segment(&scene(&[CUP]).0, &mut rng()).unwrap();
    used.segment(&scene(&[]).0, &mut rng()).unwrap_err();
    let mut fresh = FaceSegmenter::new(params()).unwrap();
    assert_eq!(used.segment(&cloud, &mut rng()), fresh.segment(&cloud, &mut rng()));
}

#[test]
fn parameters_outside_their_range_are_refused_by_name() {
    let of = |params| FaceSegmenter::new(params).unwrap_err();
    assert_eq!(of(FaceParams { leaf: 0.0, ..params() }).name, "leaf");
    assert_eq!(of(FaceParams { range_max: f64::INFINITY, ..params() }).name, "range_max");
    assert_eq!(
        of(FaceParams { height_max: 0.05, ..params() }).to_string(),
        "height_max is 0.05; it must be greater than height_min"
    );
    assert_eq!(of(FaceParams { min_points: 2, ..params() }).name, "min_points");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_floats_give_a_face_or_a_reason(
        cloud in prop::collection::vec(prop::array::uniform3(any::<f32>()), 0..400),
        near in prop::collection::vec(prop::array::uniform3(-0.3..0.3_f32), 0..400),
        seed in any::<u64>(),
    ) {
        let params = FaceParams { min_points: 3, ..params() };
        let cloud = [cloud, near].concat();
        let mut segmenter = FaceSegmenter::new(params).unwrap();
        if let Ok(face) = segmenter.segment(&cloud, &mut ChaCha8Rng::seed_from_u64(seed)) {
            prop_assert!(!face.indices.is_empty());
            prop_assert!(face.plane.normal.norm() > 0.999 && face.plane.offset >= 0.0);
            prop_assert!(face.indices.iter().all(|&i| cloud[i as usize].iter().all(|c| c.is_finite())));
        }
    }
}
