//! Fluences into segments: nothing is lost, leaves stay where leaves can be.

use proptest::prelude::*;
use stillpoint_plan::dose::Collimator;
use stillpoint_plan::leaves::{LeafBeam, LeafMap, LeavesError, Segment, Shape, divide, within_leaves};

/// Levels of up to eight rows of nine columns.
fn levels() -> impl Strategy<Value = (usize, Vec<u32>)> {
    let size = (1_usize..9, 1_usize..10);
    size.prop_flat_map(|(rows, columns)| {
        let level = prop_oneof![Just(0_u32), 0_u32..4, 0_u32..25];
        (Just(columns), prop::collection::vec(level, rows * columns))
    })
}

/// The least units of any sequence: the largest sum of rises of a row.
fn complexity(levels: &[u32], columns: usize) -> u32 {
    let of_row = |row: &[u32]| {
        let before = std::iter::once(&0).chain(row);
        row.iter().zip(before).map(|(level, before)| level.saturating_sub(*before)).sum::<u32>()
    };
    levels.chunks(columns).map(of_row).max().unwrap_or_default()
}

fn sum(segments: &[(u32, Shape)], rows: usize, columns: usize) -> Vec<u32> {
    let mut sum = vec![0; rows * columns];
    for (units, shape) in segments {
        for (row, [from, to]) in shape.iter().enumerate() {
            sum[row * columns..][*from..*to].iter_mut().for_each(|level| *level += units);
        }
    }
    sum
}

/// Leaves of 5 mm whose edges lie on those of 10 mm bixels, and no transmission.
fn collimator() -> Collimator {
    Collimator { transmission: 0.0, ..Collimator::generic() }
}

/// Bixels of 10 mm and the weight of each, somewhere in the field.
fn fluence() -> impl Strategy<Value = (Vec<[f64; 2]>, Vec<f64>)> {
    let bixel = (-14_i32..=14, -19_i32..=19).prop_map(|(x, z)| (x, z));
    let weight = prop_oneof![Just(0.0), 0.0..2.0_f64];
    prop::collection::btree_map(bixel, weight, 1..60).prop_map(|bixels| {
        let place = |(x, z): (i32, i32)| [10.0 * f64::from(x), 10.0 * f64::from(z)];
        bixels.into_iter().map(|(at, weight)| (place(at), weight)).unzip()
    })
}

fn sequenced(
    collimator: &Collimator,
    bixels: &[[f64; 2]],
    weights: &[f64],
    count: u32,
) -> Option<(LeafMap, LeafBeam)> {
    let map = LeafMap::new(collimator, bixels, weights, 10.0).unwrap()?;
    let levels = map.levels(count).unwrap();
    let shapes: Vec<(f64, Shape)> = divide(&levels.levels, levels.columns)
        .into_iter()
        .map(|(units, shape)| (f64::from(units) * levels.unit, shape))
        .collect();
    let beam = LeafBeam::new(collimator, &map, &shapes)?;
    Some((map, beam))
}

proptest! {
    #[test]
    fn segments_sum_to_the_levels_in_the_least_units((columns, levels) in levels()) {
        let segments = divide(&levels, columns);
        prop_assert_eq!(sum(&segments, levels.len() / columns, columns), levels.clone());
        let units: u32 = segments.iter().map(|(units, _)| units).sum();
        prop_assert_eq!(units, complexity(&levels, columns));
        prop_assert!(segments.iter().all(|(units, shape)| *units > 0 && shape.iter().any(|[from, to]| from < to)));
    }

    #[test]
    fn leaves_never_overlap_and_stay_within_their_travel((bixels, weights) in fluence()) {
        let collimator = collimator();
        if let Some((_, beam)) = sequenced(&collimator, &bixels, &weights, 12) {
            for Segment { tips_mm, weight, .. } in &beam.segments {
                prop_assert!(*weight > 0.0 && tips_mm.len() == 80);
                for [left, right] in tips_mm {
                    prop_assert!(left <= right);
                    prop_assert!((-200.0..=150.0).contains(left) && (-150.0..=200.0).contains(right));
                }
            }
        }
    }

    #[test]
    fn what_passes_the_leaves_is_the_fluence_to_half_a_level((bixels, weights) in fluence()) {
        let collimator = collimator();
        let Some((map, beam)) = sequenced(&collimator, &bixels, &weights, 40) else { return Ok(()) };
        let most = 40.0 * map.levels(40).unwrap().unit;
        let (places, found) = beam.fluence(&collimator, 10.0);
        let at = |place: &[f64; 2]| places.iter().zip(&found).find(|(p, _)| *p == place).map_or(0.0, |(_, w)| *w);
        for (bixel, weight) in bixels.iter().zip(&weights) {
            prop_assert!((at(bixel) - weight).abs() <= 0.5 * most / 40.0 + 1e-9, "{bixel:?}: {} {weight}", at(bixel));
        }
        prop_assert!((found.iter().sum::<f64>() - weights.iter().sum::<f64>()).abs() <= 0.5 * most / 40.0 * weights.len() as f64);
    }
}

#[test]
fn a_row_that_was_divided_by_hand_has_the_least_units_in_two_segments() {
    // Rises of 2 and 3: five units. All of it opens for 2, then the right part for 3.
    let segments = divide(&[2, 2, 5, 5], 4);
    let units: Vec<u32> = segments.iter().map(|(units, _)| *units).collect();
    assert_eq!((units.iter().sum::<u32>(), segments.len()), (5, 2), "{segments:?}");
}

#[test]
fn jaws_follow_each_segment_as_far_as_they_go_over_the_axis() {
    let follow = Collimator { jaws_over_axis_mm: Some([20.0, 100.0]), ..Collimator::generic() };
    // Two islands on one row of leaves' columns: the farther one is beyond what a jaw along x goes over the axis.
    let (bixels, weights) = (vec![[-50.0, 0.0], [80.0, 40.0], [80.0, 50.0]], vec![1.0, 2.0, 2.0]);
    let (_, beam) = sequenced(&follow, &bixels, &weights, 2).unwrap();
    let fields: Vec<_> = beam.segments.iter().map(|segment| segment.field_mm).collect();
    assert!(fields.contains(&[[20.0, 85.0], [35.0, 55.0]]), "{fields:?}");
    assert_eq!(beam.field_mm, [[-55.0, 85.0], [-5.0, 55.0]]);
    // Jaws that stand still are around all of it, and give the same tips and weights.
    let still = Collimator { jaws_over_axis_mm: None, ..follow.clone() };
    let (_, whole) = sequenced(&still, &bixels, &weights, 2).unwrap();
    assert!(whole.segments.iter().all(|segment| segment.field_mm == beam.field_mm));
    let open =
        |beam: &LeafBeam| -> Vec<_> { beam.segments.iter().map(|s| (s.tips_mm.clone(), s.weight)).collect() };
    assert_eq!(open(&whole), open(&beam));
    // What passes closed leaves is less, what is open is the same.
    for (follows, stands) in beam.segments.iter().zip(&whole.segments) {
        for place in &bixels {
            let [a, b] = [follows, stands].map(|segment| segment.passed(&follow, *place, 10.0));
            assert!(a == b || (a == 0.0 && b == follow.transmission), "{a} {b}");
        }
    }
}

#[test]
fn leaves_transmit_between_the_jaws_and_nothing_passes_beside_them() {
    let collimator = Collimator { transmission: 0.1, ..Collimator::generic() };
    let (bixels, weights) = (vec![[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]], vec![1.0, 1.0, 1.0]);
    let (_, beam) = sequenced(&collimator, &bixels, &weights, 1).unwrap();
    assert_eq!((beam.field_mm, beam.segments.len()), ([[-5.0, 15.0], [-5.0, 15.0]], 1));
    let passed = |place| beam.segments[0].passed(&collimator, place, 10.0);
    for (place, expected) in [
        ([0.0, 0.0], 1.0),
        ([10.0, 10.0], 1.0),
        ([0.0, 10.0], 0.1),
        ([5.0, 10.0], 0.55),
        ([20.0, 0.0], 0.0),
        ([0.0, -5.0], 0.5),
    ] {
        assert!((passed(place) - expected).abs() < 1e-12, "{place:?}: {}", passed(place));
    }
}

/// One bixel of a thousand times the others once set the unit of all: they came to nothing.
#[test]
fn one_bixel_does_not_set_the_levels_of_the_others() {
    let bixels: Vec<[f64; 2]> = (0..40).map(|i| [10.0 * f64::from(i % 8), 10.0 * f64::from(i / 8)]).collect();
    let weights: Vec<f64> =
        (0..40).map(|i| if i == 7 { 1000.0 } else { 1.0 + 0.02 * f64::from(i) }).collect();
    let (_, beam) = sequenced(&collimator(), &bixels, &weights, 20).unwrap();
    let (places, found) = beam.fluence(&collimator(), 10.0);
    for (bixel, weight) in bixels.iter().zip(&weights) {
        let at =
            places.iter().zip(&found).find(|(place, _)| *place == bixel).map_or(0.0, |(_, found)| *found);
        assert!((at - weight).abs() < 0.05, "{bixel:?}: {at} {weight}");
    }
}

#[test]
fn a_leaf_over_two_rows_of_bixels_takes_their_mean() {
    // Leaves from -5 to 0 and from 0 to 5 mm over bixels of 5 mm: the middle row is from -2.5 to 2.5 mm.
    let map = LeafMap::new(&collimator(), &[[0.0, 0.0], [0.0, 5.0]], &[1.0, 3.0], 5.0).unwrap().unwrap();
    assert_eq!((map.first_pair, map.columns), (39, 1));
    assert_eq!(map.fluence, [0.5, 2.0, 1.5]);
}

#[test]
fn fluence_beyond_the_leaves_is_refused() {
    let new = |bixels: &[[f64; 2]], weights: &[f64]| LeafMap::new(&collimator(), bixels, weights, 10.0);
    assert!(matches!(new(&[[150.0, 0.0]], &[1.0]), Err(LeavesError::Beyond { .. })));
    assert!(matches!(new(&[[0.0, -200.0]], &[1.0]), Err(LeavesError::Beyond { .. })));
    assert_eq!(new(&[[150.0, 0.0]], &[0.0]), Ok(None));
    // The same check before there are weights.
    let before = |bixel: [f64; 2]| within_leaves(&collimator(), [[0.0, 0.0], bixel], 10.0);
    assert_eq!(before([150.0, 0.0]), new(&[[150.0, 0.0]], &[1.0]).map(drop));
    assert_eq!(before([0.0, -200.0]), new(&[[0.0, -200.0]], &[1.0]).map(drop));
    assert_eq!(before([-140.0, 190.0]), Ok(()));
    for weights in [&[f64::NAN][..], &[-1.0], &[f64::INFINITY], &[]] {
        assert!(matches!(new(&[[0.0, 0.0]], weights), Err(LeavesError::Weights { .. })), "{weights:?}");
    }
    let map = new(&[[0.0, 0.0]], &[1.0]).unwrap().unwrap();
    assert_eq!(map.levels(0), Err(LeavesError::Levels(0)));
}
