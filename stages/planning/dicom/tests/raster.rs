//! Contours to masks: holes, channels, planes between slices.

use proptest::prelude::*;
use stillpoint_dicom::{Contour, ContourKind, rasterise};
use stillpoint_patient::Grid;

use crate::fixture::rectangle;

const GRID: Grid = Grid { counts: [20, 16, 6], spacing_mm: [1.0, 1.5, 2.0], origin_mm: [-9.5, -10.0, 50.0] };

fn contour(z_mm: f64, xy_mm: Vec<[f64; 2]>) -> Contour {
    Contour { z_mm, xy_mm, kind: ContourKind::Closed }
}

/// Slices with voxels of the mask, and how many each has.
fn slices(contours: &[Contour]) -> Vec<(usize, usize)> {
    let mask = rasterise(&GRID, contours).mask;
    let count = |z| mask.indices().filter(|&i| GRID.voxel(i)[2] == z).count();
    (0..6).map(|z| (z, count(z))).filter(|(_, n)| *n > 0).collect()
}

const OUTER: [f64; 4] = [-6.0, 6.0, -7.0, 8.0];
const INNER: [f64; 4] = [-2.0, 3.0, -3.0, 2.0];

#[test]
fn a_contour_within_a_contour_is_a_hole_and_one_within_that_an_island() {
    let (outer, inner) = (contour(50.0, rectangle(OUTER)), contour(50.0, rectangle(INNER)));
    let count = |contours: &[Contour]| rasterise(&GRID, contours).mask.count();
    let (whole, hole) = (count(std::slice::from_ref(&outer)), count(std::slice::from_ref(&inner)));
    assert_eq!((whole, hole), (12 * 10, 5 * 3));
    assert_eq!(count(&[outer.clone(), inner.clone()]), whole - hole);
    assert_eq!(count(&[inner.clone(), outer.clone()]), whole - hole);
    let island = contour(50.0, rectangle([-1.0, 1.0, -1.5, 0.5]));
    let islanded = count(&[outer, inner, island.clone()]);
    assert_eq!(islanded, whole - hole + count(&[island]));
}

#[test]
fn a_keyhole_is_the_same_as_a_hole() {
    let [a, b, c, d] = rectangle(OUTER)[..] else { panic!() };
    let [e, f, g, h] = rectangle(INNER)[..] else { panic!() };
    // Out along the rim, through a channel of no width to the hole, around it the other way, and back.
    let keyhole = contour(50.0, vec![a, b, c, d, a, e, h, g, f, e]);
    let two = [contour(50.0, rectangle(OUTER)), contour(50.0, rectangle(INNER))];
    assert_eq!(rasterise(&GRID, &[keyhole]).mask, rasterise(&GRID, &two).mask);
}

#[test]
fn a_slice_takes_the_nearest_plane_within_half_their_distance_and_the_lower_of_two_as_near() {
    let at = |planes: &[(f64, f64)]| {
        let contours: Vec<_> =
            planes.iter().map(|&(z, x)| contour(z, rectangle([-6.0, x, -7.0, 8.0]))).collect();
        slices(&contours)
    };
    // Slices lie at 50, 52, ..., 60; widths of 1 and 2 voxels tell the planes apart.
    assert_eq!(at(&[(52.0, -5.0), (54.0, -4.0)]), [(1, 10), (2, 20)], "a plane on each slice");
    assert_eq!(at(&[(52.9, -5.0)]), [(1, 10)], "a plane between slices goes to the nearest");
    assert_eq!(at(&[(53.0, -5.0)]), [(2, 10)], "halfway it goes to the upper slice alone");
    assert_eq!(
        at(&[(50.0, -5.0), (54.0, -4.0)]),
        [(0, 10), (1, 10), (2, 20), (3, 20)],
        "planes on every other slice"
    );
    assert_eq!(
        at(&[(50.0, -5.0), (52.0, -5.0), (58.0, -4.0)]),
        [(0, 10), (1, 10), (4, 20)],
        "a gap stays a gap"
    );
    assert_eq!(
        at(&[(50.0, -5.0), (60.2, -4.0)]),
        [(0, 10), (1, 10), (2, 10), (3, 20), (4, 20), (5, 20)],
        "planes as far apart as 20 mm touch"
    );
    assert_eq!(at(&[(50.0, -5.0), (71.0, -4.0)]), [(0, 10)], "planes farther apart stand for a slice each");
    assert_eq!(
        at(&[(51.9, -4.0), (52.3, -5.0), (52.8, -5.0)]),
        [(1, 20)],
        "of planes closer than slices the nearest"
    );
    let drawn = rasterise(
        &GRID,
        &[contour(52.0, rectangle(OUTER)), contour(52.9, rectangle(OUTER)), contour(80.0, rectangle(OUTER))],
    )
    .drawn;
    assert_eq!((drawn.skipped, drawn.beyond.high_mm), (1, 19.0));
}

/// Voxels of the slice at 50 mm that are inside these rectangles' contours.
fn count(kind: ContourKind, rectangles: &[[f64; 4]]) -> usize {
    let contours: Vec<_> =
        rectangles.iter().map(|r| Contour { z_mm: 50.0, xy_mm: rectangle(*r), kind }).collect();
    rasterise(&GRID, &contours).mask.count()
}

#[test]
fn closed_contours_that_overlap_or_touch_are_united() {
    let (left, right) = ([-6.0, 1.0, -7.0, 8.0], [-2.0, 6.0, -4.0, 5.0]);
    let (a, b) = (count(ContourKind::Closed, &[left]), count(ContourKind::Closed, &[right]));
    let both = count(ContourKind::Closed, &[[-2.0, 1.0, -4.0, 5.0]]);
    assert_eq!(count(ContourKind::Closed, &[left, right]), a + b - both);
    assert_eq!(count(ContourKind::Xor, &[left, right]), a + b - 2 * both, "PS3.3, C.8.8.6.3");
    let neighbour = [1.0, 6.0, -7.0, 8.0];
    assert_eq!(count(ContourKind::Closed, &[left, neighbour]), a + count(ContourKind::Closed, &[neighbour]));
}

#[test]
fn identical_contours_count_once_however_they_are_written() {
    let corners = rectangle(OUTER);
    let once = rasterise(&GRID, &[contour(50.0, corners.clone())]).mask;
    let mut backwards = corners.clone();
    backwards.reverse();
    let mut turned = corners.clone();
    turned.rotate_left(1);
    let finer = corners.iter().zip(corners.iter().cycle().skip(1));
    let finer: Vec<_> = finer.flat_map(|(a, b)| [*a, [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]]).collect();
    let rounded = corners.iter().map(|[x, y]| [x + 0.004, y - 0.004]).collect();
    for duplicates in [corners.clone(), backwards, turned, finer, rounded] {
        let rastered = rasterise(&GRID, &[contour(50.0, corners.clone()), contour(50.0, duplicates)]);
        assert_eq!((rastered.mask, rastered.drawn.repeated), (once.clone(), 1));
    }
    assert_eq!(count(ContourKind::Xor, &[OUTER, OUTER]), 0, "the standard's exclusive or");
}

#[test]
fn a_hole_is_cut_out_of_the_contours_that_it_lies_in_alone() {
    // Two contours overlap; a hole lies in the first alone, and another in both.
    let (first, second) = ([-8.0, 4.0, -8.0, 8.0], [0.0, 8.0, -8.0, 8.0]);
    let whole = count(ContourKind::Closed, &[first, second]);
    let in_first = [-6.0, -2.0, -4.0, 5.0];
    let hole = count(ContourKind::Closed, &[in_first]);
    assert_eq!(count(ContourKind::Closed, &[first, second, in_first]), whole - hole);
    let in_both = [1.0, 3.0, -4.0, 5.0];
    let hole = count(ContourKind::Closed, &[in_both]);
    assert_eq!(count(ContourKind::Closed, &[first, second, in_both]), whole - hole);
    let across = [-2.0, 2.0, -4.0, 5.0];
    let rest = count(ContourKind::Closed, &[[-2.0, 0.0, -4.0, 5.0]]);
    assert_eq!(
        count(ContourKind::Closed, &[first, second, across]),
        whole - rest,
        "the second contour holds a part of the first one's hole"
    );
}

#[test]
fn the_drawn_volume_is_that_of_the_polygons() {
    let planes: Vec<_> = (0..6).map(|z| contour(50.0 + 2.0 * f64::from(z), rectangle(OUTER))).collect();
    let drawn = rasterise(&GRID, &planes).drawn;
    assert!((drawn.drawn_cm3 - 12.0 * 15.0 * 12.0 / 1000.0).abs() < 1e-9, "{drawn:?}");
    assert_eq!(drawn.beyond.volume_cm3, 0.0);
}

#[test]
fn contours_beyond_the_images_are_cut_at_their_edge() {
    let all = rasterise(&GRID, &[contour(50.0, rectangle([-1e5, 1e5, -1e5, 1e5]))]);
    assert_eq!(all.mask.count(), 20 * 16);
    assert!(rasterise(&GRID, &[contour(50.0, rectangle([50.0, 60.0, 0.0, 5.0]))]).mask.is_empty());
    for few in [vec![], vec![[0.0, 0.0]], vec![[0.0, 0.0], [3.0, 3.0]]] {
        assert!(rasterise(&GRID, &[contour(50.0, few)]).mask.is_empty());
    }
}

/// Whether a point is inside, by the angle that the polygon turns around it: another method than crossings of rows.
fn winds(polygon: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let angle = |[px, py]: [f64; 2]| (py - y).atan2(px - x);
    let turn = |a: [f64; 2], b: [f64; 2]| {
        (angle(b) - angle(a) + 3.0 * std::f64::consts::PI).rem_euclid(2.0 * std::f64::consts::PI)
            - std::f64::consts::PI
    };
    polygon.iter().zip(polygon.iter().cycle().skip(1)).map(|(&a, &b)| turn(a, b)).sum::<f64>()
        / std::f64::consts::TAU
}

proptest! {
    #[test]
    fn the_voxels_of_a_star_are_those_that_it_winds_around(
        radii in prop::collection::vec(1.0..9.0_f64, 3..20), turn in 0.0..1.0_f64, centre in prop::array::uniform2(-2.0..2.0_f64),
    ) {
        let n = radii.len() as f64;
        let corner = |(i, r): (usize, &f64)| {
            let angle = std::f64::consts::TAU * (i as f64 + turn) / n;
            [centre[0] + r * angle.cos(), centre[1] + r * angle.sin()]
        };
        let polygon: Vec<_> = radii.iter().enumerate().map(corner).collect();
        let mask = rasterise(&GRID, &[contour(50.0, polygon.clone())]).mask;
        for index in 0..20 * 16 {
            let [x, y, _] = GRID.centre_mm(GRID.voxel(index));
            prop_assert_eq!(mask.contains(index), winds(&polygon, [x, y]).abs() > 0.5);
        }
    }
}

/// Boxes of a body with a hole and of an island, each on planes of its own, and the same on one plane.
fn jittered(jitter: &[f64], slices: usize, hole: bool) -> [Vec<Contour>; 2] {
    let boxes = [OUTER, INNER, [7.0, 10.0, -7.0, -1.0], [7.0, 10.0, 2.0, 8.0]];
    let (mut moved, mut plain) = (Vec::new(), Vec::new());
    for slice in 0..slices {
        for (place, corners) in boxes.iter().enumerate().filter(|(place, _)| hole || *place != 1) {
            let z_mm = 50.0 + 2.0 * slice as f64;
            let off = jitter[(4 * slice + place) % jitter.len()];
            moved.push(contour(z_mm + off, rectangle(*corners)));
            plain.push(contour(z_mm, rectangle(*corners)));
        }
    }
    [moved, plain]
}

proptest! {
    #[test]
    fn islands_and_holes_keep_their_volume_wherever_their_planes_jitter(
        jitter in prop::collection::vec(-0.25..0.25_f64, 1..24), slices in 2..6_usize,
    ) {
        let [moved, plain] = jittered(&jitter, slices, true);
        let (moved, plain) = (rasterise(&GRID, &moved), rasterise(&GRID, &plain));
        prop_assert_eq!(&moved.mask, &plain.mask);
        prop_assert_eq!(moved.drawn.skipped, 0);
        prop_assert!((moved.drawn.drawn_cm3 - plain.drawn.drawn_cm3).abs() < 0.15 * plain.drawn.drawn_cm3);
    }

    #[test]
    fn islands_that_lie_apart_keep_their_volume_on_planes_of_their_own(
        offset in prop::collection::vec(-0.99..0.99_f64, 3), slices in 3..6_usize,
    ) {
        // Each island's planes are shifted as one: half a slice is as likely as a hundredth.
        let jitter: Vec<f64> = vec![offset[0], 0.0, offset[1], offset[2]];
        let [moved, plain] = jittered(&jitter, slices, false);
        let volume = |contours: &[Contour]| rasterise(&GRID, contours).mask.count() as f64;
        // A shifted island may lose its first or last slice to the end of the images; it never loses more.
        let due = volume(&plain);
        prop_assert!(volume(&moved) >= due * (slices - 1) as f64 / slices as f64, "{} of {due}", volume(&moved));
    }

    #[test]
    fn planes_finer_than_the_slices_are_no_jitter(step in 0.25..1.0_f64) {
        // A cone: were two of its planes one, the smaller contour were a hole in the larger.
        let cone: Vec<Contour> = (0..24)
            .map(|place| {
                let half = 8.0 - 0.3 * f64::from(place);
                contour(50.0 + step * f64::from(place), rectangle([-half, half, -half, half]))
            })
            .collect();
        let mask = rasterise(&GRID, &cone).mask;
        let middle = [10, 7];
        let last = ((step * 23.0) / 2.0) as usize;
        for z in 0..=last.min(5) {
            prop_assert!(mask.contains(GRID.index([middle[0], middle[1], z])), "slice {z} has a hole");
        }
    }
}
