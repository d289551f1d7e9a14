//! The chain on scenes made here: what it finds, why it refuses, and that its bits do not depend on its past.

#![allow(clippy::unwrap_used)]

use chacha20::ChaCha8Rng;
use chacha20::rand_core::SeedableRng;
use proptest::prelude::*;
use stillpoint_segment::mlesac::Origin;
use stillpoint_segment::{Cloud, FaceParams, FaceSegmenter, Rejection, Rule};

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
    FaceParams { leaf: 0.008, height_min: 0.06, rule: Rule::Largest, ..FaceParams::default() }
}

fn image(points: &[[f32; 3]]) -> Cloud<'_> {
    Cloud { points, width: WIDTH }
}

fn loose(points: &[[f32; 3]]) -> Cloud<'_> {
    Cloud { points, width: 0 }
}

fn rng() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(11)
}

#[test]
fn face_is_every_point_of_the_largest_thing_on_the_table() {
    let (cloud, on_head) = scene(&[HEAD, CUP]);
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let seen = segmenter.segment(image(&cloud), &mut rng());
    let expected: Vec<u32> = (0..cloud.len() as u32).filter(|&i| on_head[i as usize]).collect();
    assert_eq!(seen.face, Ok(&expected[..]));
    assert_eq!(seen.clusters.len(), 2);
    let plane = seen.plane.unwrap().plane;
    assert!((plane.offset - 1.0).abs() < 1e-4 && (plane.normal.z + 1.0).abs() < 1e-6);
}

#[test]
fn empty_and_invalid_frames_have_too_few_voxels() {
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let refusal = Err(Rejection::TooFewVoxels { found: 0, needed: 100 });
    assert_eq!(segmenter.segment(loose(&[]), &mut rng()).face, refusal);
    assert_eq!(segmenter.segment(loose(&[[f32::NAN; 3]; 1000]), &mut rng()).face, refusal);
}

#[test]
fn a_frame_beyond_the_range_says_how_far_it_is_and_whether_it_may_be_in_millimetres() {
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let mut message = |z: f32| {
        let rejection = segmenter.segment(loose(&[[0.0, 0.0, z]; 1000]), &mut rng()).face.unwrap_err();
        assert_eq!(rejection.code(), 1);
        let text = rejection.to_string();
        // The sample of a rejection has 96 bytes for it.
        assert!(text.len() <= 96, "{text}");
        text
    };
    let far = message(9.0);
    assert!(far.ends_with("the nearest point is at 9.0 m: raise `range_max`"), "{far}");
    let unit = message(430.0);
    assert!(unit.ends_with("the nearest point is at 430.0 m: are these millimetres?"), "{unit}");
}

#[test]
fn scattered_points_have_no_plane() {
    let cloud: Vec<_> = (0..500_u32)
        .map(|i| {
            [7, 11, 13].map(|k| (i.wrapping_mul(2_654_435_761 + k * k * k) >> 8) as f32 / (1 << 24) as f32)
        })
        .collect();
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let seen = segmenter.segment(loose(&cloud), &mut rng());
    assert!(matches!(seen.face, Err(Rejection::NoPlane { needed: 100, .. })), "{:?}", seen.face);
    assert!(seen.plane.is_none() && seen.hull.corners().is_empty());
}

#[test]
fn empty_table_has_no_cluster() {
    let mut segmenter = FaceSegmenter::new(params()).unwrap();
    let cloud = scene(&[]).0;
    assert_eq!(
        segmenter.segment(image(&cloud), &mut rng()).face,
        Err(Rejection::NoCluster { above: 0, needed: 100 })
    );
}

/// A table below the camera with a ball of 90 mm in its middle, which is `height` over the table; of its image the columns
/// from `cut` on are seen.
fn ball(height: f32, cut: usize) -> Vec<[f32; 3]> {
    let radius = 0.09;
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let ray = [(i % WIDTH) as f32 - 159.5, (i / WIDTH) as f32 - 119.5].map(|c| c / 280.0);
            let (a, b) = (ray[0] * ray[0] + ray[1] * ray[1] + 1.0, TABLE - height);
            let root = b * b - a * (b * b - radius * radius);
            let z = if root > 0.0 { ((b - root.sqrt()) / a).min(TABLE) } else { TABLE };
            if z < TABLE && i % WIDTH < cut { [f32::NAN; 3] } else { [ray[0] * z, ray[1] * z, z] }
        })
        .collect()
}

#[test]
fn a_frame_without_a_head_says_what_is_amiss() {
    let params = FaceParams { rule: Rule::Head, height_min: 0.03, ..params() };
    let why = |cloud: &[[f32; 3]]| {
        let mut segmenter = FaceSegmenter::new(params).unwrap();
        let seen = segmenter.segment(image(cloud), &mut rng()).face.map(<[u32]>::len);
        seen.map_err(|why| {
            let text = why.to_string();
            // The sample of a rejection has 96 bytes for it.
            assert!(text.len() <= 96, "{text}");
            text
        })
    };
    assert!(why(&ball(0.1, 0)).is_ok_and(|points| points > 1000));
    let flat = why(&scene(&[HEAD, CUP]).0).unwrap_err();
    assert!(flat.contains("none as round as a head"), "{flat}");
    let low = why(&ball(0.03, 0)).unwrap_err();
    assert!(low.contains("mm up, a head's") && low.contains("lower what lies around it"), "{low}");
    let hidden = why(&ball(0.1, 172)).unwrap_err();
    assert!(hidden.contains("% of its side, a head 35: uncover it"), "{hidden}");
}

#[test]
fn frame_after_a_refused_one_starts_afresh() {
    let (cloud, _) = scene(&[HEAD, CUP]);
    let mut used = FaceSegmenter::new(params()).unwrap();
    used.segment(image(&scene(&[CUP]).0), &mut rng()).face.unwrap();
    used.segment(loose(&[]), &mut rng()).face.unwrap_err();
    let mut fresh = FaceSegmenter::new(params()).unwrap();
    let (after, first) = (used.segment(image(&cloud), &mut rng()), fresh.segment(image(&cloud), &mut rng()));
    // Only the plane remembers: it was proved, not searched.
    assert_eq!(
        (after.face, after.above, after.clusters.len()),
        (first.face, first.above, first.clusters.len())
    );
    assert_eq!(after.plane.unwrap().origin, Origin::Retained);
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
        let seen = segmenter.segment(loose(&cloud), &mut ChaCha8Rng::seed_from_u64(seed));
        if let Ok(face) = seen.face {
            prop_assert!(!face.is_empty());
            let plane = seen.plane.unwrap().plane;
            prop_assert!(plane.normal.norm() > 0.999 && plane.offset >= 0.0);
            prop_assert!(face.iter().all(|&i| cloud[i as usize].iter().all(|c| c.is_finite())));
        }
    }
}
