//! Which voxels a straight line crosses, and over what lengths.
//!
//! Siddon, Med. Phys. 12 (1985) 252: the crossings with the three families of planes cut the line into segments, one
//! for each voxel. Here the nearest crossing of the three is taken step by step, each computed from its plane's number,
//! so that rounding errors do not add up along the line.

use stillpoint_patient::Grid;

/// A stretch of a line inside one voxel. `begin` and `end` are parts of the way from the line's start to its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Segment {
    /// Place of the voxel in a volume's values.
    pub voxel: usize,
    pub begin: f64,
    pub end: f64,
}

/// Segments of the line between two points (mm), in order along it. Segments of no length are left out.
pub(crate) fn segments(grid: &Grid, from_mm: [f64; 3], to_mm: [f64; 3]) -> Segments {
    let mut line = Segments { axes: [Axis::default(); 3], voxel: 0, at: 0.0, end: 1.0 };
    let mut stride = 1;
    for (axis, a) in line.axes.iter_mut().enumerate() {
        let (count, spacing) = (grid.counts[axis], grid.spacing_mm[axis]);
        let low = grid.origin_mm[axis] - 0.5 * spacing;
        let extent = to_mm[axis] - from_mm[axis];
        *a = Axis { count, stride, ..Axis::default() };
        stride *= count;
        if extent == 0.0 {
            let place = ((from_mm[axis] - low) / spacing).floor();
            if !(0.0..count as f64).contains(&place) {
                return Segments { end: 0.0, ..line };
            }
            a.place = place as usize;
            a.next = f64::INFINITY;
            continue;
        }
        a.first = (low - from_mm[axis]) / extent;
        a.step = spacing / extent;
        let last = a.first + count as f64 * a.step;
        line.at = line.at.max(a.first.min(last));
        line.end = line.end.min(a.first.max(last));
    }
    for a in &mut line.axes {
        if a.next.is_finite() {
            let place = ((line.at - a.first) / a.step).floor();
            a.place = (place.max(0.0) as usize).min(a.count.saturating_sub(1));
            a.next = a.leaves_at();
        }
        line.voxel += a.place * a.stride;
    }
    line
}

/// The iterator of [`segments`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Segments {
    axes: [Axis; 3],
    voxel: usize,
    at: f64,
    end: f64,
}

/// One axis: the line meets its plane number `i` at `first + i * step`.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    first: f64,
    step: f64,
    next: f64,
    place: usize,
    count: usize,
    stride: usize,
}

impl Axis {
    /// Where the line leaves the voxel at `place` along this axis.
    fn leaves_at(&self) -> f64 {
        let plane = if self.step > 0.0 { self.place + 1 } else { self.place };
        self.first + plane as f64 * self.step
    }
}

impl Iterator for Segments {
    type Item = Segment;

    fn next(&mut self) -> Option<Segment> {
        while self.at < self.end {
            let [x, y, z] = self.axes.map(|axis| axis.next);
            let nearest = if x <= y && x <= z {
                0
            } else if y <= z {
                1
            } else {
                2
            };
            let segment =
                Segment { voxel: self.voxel, begin: self.at, end: self.axes[nearest].next.min(self.end) };
            let axis = &mut self.axes[nearest];
            if axis.step > 0.0 && axis.place + 1 < axis.count {
                axis.place += 1;
                self.voxel += axis.stride;
            } else if axis.step < 0.0 && axis.place > 0 {
                axis.place -= 1;
                self.voxel -= axis.stride;
            } else {
                self.end = self.at;
            }
            axis.next = axis.leaves_at();
            self.at = self.at.max(segment.end);
            if segment.begin < segment.end {
                return Some(segment);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GRID: Grid = Grid { counts: [4, 3, 5], spacing_mm: [2.0, 3.0, 1.0], origin_mm: [-3.0, 1.0, 10.0] };

    #[test]
    fn line_along_an_axis_crosses_each_voxel_of_its_row_once() {
        let line: Vec<_> = segments(&GRID, [-14.0, 1.0, 12.0], [16.0, 1.0, 12.0]).collect();
        assert_eq!(
            line.iter().map(|s| s.voxel).collect::<Vec<_>>(),
            [0, 1, 2, 3].map(|x| GRID.index([x, 0, 2]))
        );
        assert!(line.iter().all(|s| ((s.end - s.begin) * 30.0 - 2.0).abs() < 1e-12));
        let back: Vec<_> = segments(&GRID, [16.0, 1.0, 12.0], [-14.0, 1.0, 12.0]).map(|s| s.voxel).collect();
        assert_eq!(back, [3, 2, 1, 0].map(|x| GRID.index([x, 0, 2])));
    }

    #[test]
    fn line_beside_or_before_the_volume_crosses_nothing() {
        assert_eq!(segments(&GRID, [-14.0, 20.0, 12.0], [16.0, 20.0, 12.0]).count(), 0);
        assert_eq!(segments(&GRID, [-14.0, 1.0, 12.0], [-5.0, 1.0, 12.0]).count(), 0);
    }

    proptest! {
        /// Against a walk in small steps, and against the length of the line in the box.
        #[test]
        fn segments_follow_each_other_and_lie_in_their_voxels(
            from in prop::array::uniform3(-20.0..30.0f64), to in prop::array::uniform3(-20.0..30.0f64),
        ) {
            let mut at = None;
            for s in segments(&GRID, from, to) {
                prop_assert!(s.begin < s.end && s.begin >= 0.0 && s.end <= 1.0);
                prop_assert!(at.is_none_or(|end: f64| (end - s.begin).abs() < 1e-12));
                at = Some(s.end);
                let voxel = GRID.voxel(s.voxel);
                for part in [0.001, 0.5, 0.999] {
                    let along = s.begin + part * (s.end - s.begin);
                    for axis in 0..3 {
                        let place = from[axis] + along * (to[axis] - from[axis]);
                        let away = (place - GRID.centre_mm(voxel)[axis]).abs();
                        prop_assert!(away <= 0.5 * GRID.spacing_mm[axis] + 1e-9);
                    }
                }
            }
            let inside = |along: f64| (0..3).all(|axis| {
                let low = GRID.origin_mm[axis] - 0.5 * GRID.spacing_mm[axis];
                let place = from[axis] + along * (to[axis] - from[axis]);
                place > low && place < low + GRID.counts[axis] as f64 * GRID.spacing_mm[axis]
            });
            let walked = (0..20_000).filter(|i| inside((*i as f64 + 0.5) / 20_000.0)).count() as f64 / 20_000.0;
            let crossed: f64 = segments(&GRID, from, to).map(|s| s.end - s.begin).sum();
            prop_assert!((walked - crossed).abs() < 2e-4, "{} walked, {} crossed", walked, crossed);
        }
    }
}
