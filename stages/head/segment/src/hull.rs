//! Convex hull of points on a plane (Andrew's monotone chain), and which points stand over it.

use crate::plane::{Plane, vector};
use nalgebra::Vector3;

/// A convex outline on a plane, with its buffers; after the first frame, [`build`](Self::build) allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct ConvexHull {
    axes: (Vector3<f64>, Vector3<f64>),
    /// The plane's point nearest to the origin.
    foot: Vector3<f64>,
    points: Vec<[f64; 2]>,
    /// Counter-clockwise, without repeats.
    corners: Vec<[f64; 2]>,
    /// The distance to each edge from its inner side is a u + b v + c.
    lines: Vec<[f64; 3]>,
}

/// Twice the signed area of the triangle `a`, `b`, `c`: positive where `c` is left of the way from `a` to `b`.
#[inline]
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Twice the area of a triangle, m2, below which its points count as in line where points are left out.
const ON_EDGE: f64 = 1e-9;

impl ConvexHull {
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The hull of `points` (finite, in metres) projected along the normal onto `plane`.
    pub fn build(&mut self, plane: &Plane, points: impl IntoIterator<Item = [f32; 3]>) {
        self.axes = plane.axes();
        self.foot = -plane.offset * plane.normal;
        self.points.clear();
        let axes = self.axes;
        self.points.extend(points.into_iter().map(|p| project(&axes, p)));
        leave_out_inner(&mut self.points);
        self.points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        self.corners.clear();
        chain(&mut self.corners, self.points.iter().copied());
        // The last corner of a chain is the first of the next one.
        self.corners.pop();
        let lower = self.corners.len();
        chain_from(&mut self.corners, lower, self.points.iter().rev().copied());
        self.corners.pop();
        self.lines.clear();
        if self.corners.len() >= 3 {
            let next = self.corners.iter().cycle().skip(1);
            self.lines.extend(self.corners.iter().zip(next).map(|(from, to)| {
                let (du, dv) = (to[0] - from[0], to[1] - from[1]);
                let length = (du * du + dv * dv).sqrt();
                [-dv / length, du / length, (dv * from[0] - du * from[1]) / length]
            }));
        }
    }

    /// Clears the outline and keeps the memory.
    pub fn clear(&mut self) {
        self.corners.clear();
        self.lines.clear();
    }

    /// Distance in metres from `point`, projected along the normal, to the nearest edge's line: negative outside, and
    /// where the hull contains nothing.
    #[must_use]
    pub fn margin(&self, point: [f32; 3]) -> f64 {
        let [u, v] = project(&self.axes, point);
        if self.lines.is_empty() {
            return f64::NEG_INFINITY;
        }
        self.lines.iter().map(|[a, b, c]| a * u + b * v + c).fold(f64::INFINITY, f64::min)
    }

    /// Whether `point`, projected along the normal, lies within the hull or on its edge.
    #[must_use]
    pub fn contains(&self, point: [f32; 3]) -> bool {
        let p = project(&self.axes, point);
        let Some(&last) = self.corners.last() else { return false };
        let mut from = last;
        self.corners.len() >= 3
            && self.corners.iter().all(|&to| {
                let left = turn(from, to, p) >= 0.0;
                from = to;
                left
            })
    }

    /// Area in square metres.
    #[must_use]
    pub fn area(&self) -> f64 {
        let Some(&first) = self.corners.first() else { return 0.0 };
        self.corners.windows(2).map(|edge| turn(first, edge[0], edge[1])).sum::<f64>() / 2.0
    }

    /// The corner of this number as a point of the plane, in metres in the frame of the points.
    ///
    /// # Panics
    /// Where there is no such corner.
    #[must_use]
    pub fn corner_in_space(&self, number: usize) -> [f32; 3] {
        let [u, v] = self.corners[number];
        (self.foot + u * self.axes.0 + v * self.axes.1).map(|c| c as f32).into()
    }

    /// Corners in metres along the plane's two axes, counter-clockwise as seen from the normal's side.
    #[must_use]
    pub fn corners(&self) -> &[[f64; 2]] {
        &self.corners
    }
}

#[inline]
fn project(axes: &(Vector3<f64>, Vector3<f64>), point: [f32; 3]) -> [f64; 2] {
    let point = vector(point);
    [axes.0.dot(&point), axes.1.dot(&point)]
}

/// Leaves out points that lie within the octagon of those farthest along eight directions: they are no corners, and most
/// points are such (Akl and Toussaint, 1978).
fn leave_out_inner(points: &mut Vec<[f64; 2]>) {
    const DIRECTIONS: [[f64; 2]; 8] = [
        [1.0, 0.0],
        [1.0, 1.0],
        [0.0, 1.0],
        [-1.0, 1.0],
        [-1.0, 0.0],
        [-1.0, -1.0],
        [0.0, -1.0],
        [1.0, -1.0],
    ];
    let Some(&first) = points.first() else { return };
    let (mut farthest, mut distances) = ([first; 8], [f64::NEG_INFINITY; 8]);
    for &point in points.iter() {
        for (k, [a, b]) in DIRECTIONS.into_iter().enumerate() {
            let distance = a * point[0] + b * point[1];
            if distance > distances[k] {
                (farthest[k], distances[k]) = (point, distance);
            }
        }
    }
    // Where two directions have one farthest point, its edge has no inner side; the others enclose the same points.
    let edges: [_; 8] = std::array::from_fn(|k| (farthest[k], farthest[(k + 1) % 8]));
    if edges.iter().all(|(from, to)| from == to) {
        return;
    }
    points.retain(|&p| edges.iter().any(|&(from, to)| from != to && turn(from, to, p) <= ON_EDGE));
}

fn chain(corners: &mut Vec<[f64; 2]>, points: impl Iterator<Item = [f64; 2]>) {
    chain_from(corners, 0, points);
}

/// Appends the chain of sorted points that turns left at every corner, leaving the first `retained` corners alone.
fn chain_from(corners: &mut Vec<[f64; 2]>, retained: usize, points: impl Iterator<Item = [f64; 2]>) {
    for point in points {
        while let [.., a, b] = corners[retained..] {
            if turn(a, b, point) > 0.0 {
                break;
            }
            corners.pop();
        }
        corners.push(point);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn facing() -> Plane {
        Plane { normal: Vector3::new(0.0, 0.0, -1.0), offset: 1.0 }
    }

    fn hull(points: &[[f32; 2]]) -> ConvexHull {
        let mut hull = ConvexHull::new();
        hull.build(&facing(), points.iter().map(|&[x, y]| [x, y, 1.0]));
        hull
    }

    #[test]
    fn hull_of_a_filled_square_is_its_four_corners() {
        let filled: Vec<_> = (0..121).map(|i| [(i % 11) as f32, (i / 11) as f32]).collect();
        let hull = hull(&filled);
        assert_eq!(hull.corners().len(), 4);
        assert_eq!(hull.area(), 100.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn corners_are_those_of_all_points(
            points in prop::collection::vec(prop::array::uniform2(-1.0..1.0_f64), 1..200),
            steps in 1..20_u8,
        ) {
            // Rounded to a few steps, many points are in line or the same.
            let round = |c: f64| (c * f64::from(steps)).round() / f64::from(steps);
            let points: Vec<[f64; 2]> = points.into_iter().map(|p| p.map(round)).collect();
            let hull = hull(&points.iter().map(|p| p.map(|c| c as f32)).collect::<Vec<_>>());
            let mut few: Vec<_> = points.clone();
            leave_out_inner(&mut few);
            let corners = |points: &[[f64; 2]]| {
                let mut points = points.to_vec();
                points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
                let mut corners = Vec::new();
                chain(&mut corners, points.iter().copied());
                let lower = corners.len();
                chain_from(&mut corners, lower, points.iter().rev().copied());
                corners
            };
            prop_assert_eq!(corners(&few), corners(&points));
            prop_assert!(hull.corners().len() <= few.len());
        }
    }

    #[test]
    fn corners_in_space_are_the_points_themselves() {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let hull = hull(&square);
        let corners: Vec<[f32; 3]> = (0..4).map(|k| hull.corner_in_space(k)).collect();
        assert!(square.iter().all(|&[x, y]| corners.contains(&[x, y, 1.0])), "{corners:?}");
    }

    #[test]
    fn points_over_the_hull_are_inside_at_any_height() {
        let hull = hull(&[[0.0, 0.0], [2.0, 0.0], [0.0, 2.0], [0.5, 0.5]]);
        assert_eq!(hull.corners().len(), 3);
        assert!(hull.contains([0.4, 0.4, 0.2]));
        assert!(hull.contains([1.0, 0.0, 0.9]), "an edge belongs to the hull");
        assert!(!hull.contains([1.5, 1.5, 0.2]));
        assert!(!hull.contains([f32::NAN; 3]));
    }

    #[test]
    fn margin_is_the_distance_to_the_nearest_edge() {
        let hull = hull(&[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]);
        assert!((hull.margin([0.5, 1.0, 0.3]) - 0.5).abs() < 1e-6);
        assert!((hull.margin([1.0, 2.25, 0.3]) + 0.25).abs() < 1e-6);
        assert_eq!(ConvexHull::new().margin([0.0, 0.0, 1.0]), f64::NEG_INFINITY);
    }

    #[test]
    fn too_few_points_and_points_in_line_contain_nothing() {
        for points in [&[][..], &[[0.0, 0.0]], &[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]] {
            assert!(!hull(points).contains([1.0, 1.0, 1.0]), "{points:?}");
            assert_eq!(hull(points).area(), 0.0);
        }
    }
}
