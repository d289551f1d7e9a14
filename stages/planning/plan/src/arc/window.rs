//! Where tips may be: between what every angle of a control point lights, as far as the leaves reach and are quick enough.

use std::ops::Range;

use super::ArcError;
use super::field::{ControlAngle, Interval, LeafRow};
use super::trajectory::GRID_PER_MM;
use crate::dose::Collimator;

/// The cells of each row of leaves from the first to the last that an angle lights.
pub fn lit_cells(rows: &[LeafRow], width_mm: f64, lit: &[[f64; 2]]) -> Vec<Option<Range<i32>>> {
    let of = |row: &LeafRow| {
        let cells = lit.iter().filter(|[_, z]| row.is_over(*z, width_mm));
        let cells = cells.map(|[x, _]| libm::round(x / width_mm) as i32);
        Some(cells.clone().min()?..cells.max()? + 1)
    };
    rows.iter().map(of).collect()
}

/// For each control point and row the cells that every angle lights in whose dose its tips have a part; nothing where there are
/// none. `lit` has those of each angle.
pub fn windows(
    points: &[ControlAngle],
    intervals: &[Interval],
    lit: &[Vec<Option<Range<i32>>>],
) -> Vec<Vec<Option<Range<i32>>>> {
    let both = |a: &Option<Range<i32>>, b: &Option<Range<i32>>| {
        let (a, b) = (a.as_ref()?, b.as_ref()?);
        let cells = a.start.max(b.start)..a.end.min(b.end);
        (!cells.is_empty()).then_some(cells)
    };
    let of = |point: &ControlAngle| {
        let near = point.before.into_iter().chain(point.after);
        let angles = near.flat_map(|interval| intervals[interval].doses);
        let cells = angles.map(|angle| lit[angle].clone());
        cells.reduce(|a, b| a.iter().zip(&b).map(|(a, b)| both(a, b)).collect()).unwrap_or_default()
    };
    points.iter().map(of).collect()
}

/// Refuses a window (mm) that the tips of leaves cannot open.
///
/// # Errors
/// The window is beyond the reach of leaves, or on the other side of their over-travel.
pub fn within_reach(collimator: &Collimator, window_mm: [f64; 2]) -> Result<(), ArcError> {
    let ([low, high], reach, over) = (window_mm, collimator.reach_mm, collimator.over_travel_mm);
    match low < -reach || high > reach || low > over || high < -over {
        true => Err(aside(collimator, window_mm)),
        false => Ok(()),
    }
}

fn aside(collimator: &Collimator, [low_mm, high_mm]: [f64; 2]) -> ArcError {
    let Collimator { reach_mm, over_travel_mm, .. } = *collimator;
    ArcError::Aside { low_mm, high_mm, reach_mm, over_travel_mm }
}

/// What the ends of tips depend on.
pub struct Room<'a> {
    /// Control points.
    pub points: &'a [ControlAngle],
    /// Reach and over-travel.
    pub collimator: &'a Collimator,
    /// Least distance of the tips of a pair in whole micrometres, mm.
    pub gap_mm: f64,
    /// Longest way of a tip in each interval in whole micrometres, mm.
    pub travel_mm: &'a [f64],
}

impl Room<'_> {
    /// The lowest and the highest place of each tip of a row at each control point, in whole micrometres, for windows in mm.
    /// `middle_mm` is where a row is closed that no window of an arc opens.
    ///
    /// Where nothing may open, a row is closed between the windows before and after. Windows that move faster than leaves are
    /// narrower before and after: the lower edges become the least places at or above them between which a leaf can move, the
    /// upper edges the greatest at or below them; where these cross, the row is closed halfway. So a tip within its ends at a
    /// control point reaches its ends at the next. A closed row is as open as the gap.
    ///
    /// # Errors
    /// A window is out of reach.
    pub fn ends(
        &self,
        windows_mm: &[Option<[f64; 2]>],
        middle_mm: f64,
    ) -> Result<Vec<[[f64; 2]; 2]>, ArcError> {
        let (reach, over) = (self.collimator.reach_mm, self.collimator.over_travel_mm);
        windows_mm.iter().flatten().try_for_each(|window| within_reach(self.collimator, *window))?;
        let mut edges = self.filled(windows_mm, middle_mm);
        for point in 0..edges.len() {
            if let Some(interval) = self.points[point].after {
                edges[point + 1] = within(edges[point + 1], edges[point], self.travel_mm[interval]);
            }
        }
        for point in (0..edges.len()).rev() {
            if let Some(interval) = self.points[point].before {
                edges[point - 1] = within(edges[point - 1], edges[point], self.travel_mm[interval]);
            }
        }
        let half = down(0.5 * self.gap_mm);
        let most = over.min(reach - self.gap_mm).max(0.0);
        let ends = |[low, high]: [f64; 2]| {
            let middle = down((0.5 * (low + high)).max(-most).min(most));
            let low = nearest(low.min(middle - half));
            let high = nearest(high.max(middle - half + self.gap_mm));
            let banks = [
                [low.max(up(-reach)), nearest(high - self.gap_mm).min(down(over))],
                [nearest(low + self.gap_mm).max(up(-over)), high.min(down(reach))],
            ];
            if banks.iter().all(|[least, most]| least <= most) {
                Ok(banks)
            } else {
                Err(aside(self.collimator, [low, high]))
            }
        };
        edges.into_iter().map(ends).collect()
    }

    /// Windows in whole micrometres; where there are none, a place on the line between the middles of the nearest ones of the arc.
    fn filled(&self, windows_mm: &[Option<[f64; 2]>], middle_mm: f64) -> Vec<[f64; 2]> {
        let middle = |at: usize| windows_mm[at].map(|[low, high]| (at as f64, 0.5 * (low + high)));
        let closed = |point: usize| {
            let arc = |at: &usize| self.points[*at].arc == self.points[point].arc;
            let before = (0..point).rev().take_while(arc).find_map(middle);
            let after = (point + 1..windows_mm.len()).take_while(arc).find_map(middle);
            let mm = match (before, after) {
                (Some((a, from)), Some((b, to))) => from + (point as f64 - a) / (b - a) * (to - from),
                (Some((_, mm)), None) | (None, Some((_, mm))) => mm,
                (None, None) => middle_mm,
            };
            [down(mm); 2]
        };
        let of = |(point, window): (usize, &Option<[f64; 2]>)| match window {
            Some([low, high]) => [up(*low), down(*high)],
            None => closed(point),
        };
        windows_mm.iter().enumerate().map(of).collect()
    }
}

/// Edges from which other edges are reached by this way.
fn within([low, high]: [f64; 2], other: [f64; 2], travel_mm: f64) -> [f64; 2] {
    [low.max(other[0] - travel_mm), high.min(other[1] + travel_mm)]
}

/// The next whole micrometre downwards, mm; what is a rounding below one is there.
pub fn down(mm: f64) -> f64 {
    libm::floor(mm * GRID_PER_MM + 1e-6) / GRID_PER_MM
}

/// The next whole micrometre upwards, mm.
fn up(mm: f64) -> f64 {
    -down(-mm)
}

/// The nearest whole micrometre, mm.
pub fn nearest(mm: f64) -> f64 {
    libm::round(mm * GRID_PER_MM) / GRID_PER_MM
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(count: usize) -> Vec<ControlAngle> {
        let point = |at: usize| ControlAngle {
            arc: 0,
            gantry_deg: 4.0 * at as f64,
            before: at.checked_sub(1),
            after: (at + 1 < count).then_some(at),
        };
        (0..count).map(point).collect()
    }

    fn ends(
        collimator: &Collimator,
        gap_mm: f64,
        windows_mm: &[Option<[f64; 2]>],
    ) -> Result<Vec<[[f64; 2]; 2]>, ArcError> {
        let travel_mm = vec![5.0; windows_mm.len() - 1];
        let points = points(windows_mm.len());
        Room { points: &points, collimator, gap_mm, travel_mm: &travel_mm }.ends(windows_mm, 0.0)
    }

    #[test]
    fn tips_within_their_ends_reach_those_of_the_next_control_point_with_the_gap_kept() {
        let windows =
            [Some([-20.0, 20.0]), None, Some([31.0, 33.0]), None, None, None, Some([-9.375, 3.125])];
        for gap_mm in [0.0, 3.001] {
            let found = ends(&Collimator::generic(), gap_mm, &windows).unwrap();
            for pair in found.windows(2) {
                for bank in 0..2 {
                    let off = |end: usize| (pair[0][bank][end] - pair[1][bank][end]).abs();
                    assert!(off(0) <= 5.0 + 1e-9 && off(1) <= 5.0 + 1e-9, "{pair:?}");
                }
            }
            for (banks, window) in found.iter().zip(&windows) {
                let [low, high] = banks;
                assert!(high[0] - low[0] >= gap_mm - 1e-9 && high[1] - low[1] >= gap_mm - 1e-9, "{banks:?}");
                // Nothing but the gap is open beside a window, and where there is none.
                let open = high[1] - low[0];
                match window {
                    Some([from, to]) => assert!(
                        open <= gap_mm + 2e-3 || low[0] >= from - 1e-9 && high[1] <= to + 1e-9,
                        "{banks:?} {window:?}"
                    ),
                    None => assert!(open <= gap_mm + 1e-9, "{banks:?}"),
                }
            }
        }
        // Leaves that are too slow for a window open a part of it.
        let found = ends(&Collimator::generic(), 0.0, &[Some([-20.0, 20.0]), None]).unwrap();
        assert_eq!(found, [[[-5.0, 5.0]; 2], [[0.0, 0.0]; 2]]);
    }

    #[test]
    fn ends_are_whole_micrometres_within_the_windows() {
        let found = ends(&Collimator::generic(), 0.0, &[Some([-10.0 / 3.0, 20.0 / 3.0]); 2]).unwrap();
        assert_eq!(found[0], [[-3.333, 6.666], [-3.333, 6.666]]);
        let found = ends(&Collimator::generic(), 0.0, &[Some([-1.5625, 4.6875]); 2]).unwrap();
        assert_eq!(found[1], [[-1.562, 4.687], [-1.562, 4.687]]);
    }

    #[test]
    fn windows_out_of_reach_are_refused_and_so_is_a_gap_that_no_leaf_leaves() {
        let short = Collimator { reach_mm: 60.0, over_travel_mm: 20.0, ..Collimator::generic() };
        let refused = |collimator: &Collimator, gap_mm: f64, window: [f64; 2]| {
            matches!(ends(collimator, gap_mm, &[Some(window); 3]), Err(ArcError::Aside { .. }))
        };
        assert!(!refused(&short, 0.0, [-60.0, 60.0]));
        assert!(refused(&short, 0.0, [-61.0, 10.0]) && refused(&short, 0.0, [-10.0, 61.0]));
        assert!(refused(&short, 0.0, [40.0, 55.0]) && refused(&short, 0.0, [-55.0, -40.0]));
        let least = Collimator { reach_mm: 1.0, over_travel_mm: 0.0, ..Collimator::generic() };
        assert!(!refused(&least, 0.0, [-1.0, 1.0]) && refused(&least, 20.0, [-1.0, 1.0]));
    }

    #[test]
    fn a_window_is_what_every_angle_of_a_control_point_lights() {
        let intervals = [0, 1].map(|from| Interval { from, degrees: 4.0, doses: [2 * from, 2 * from + 1] });
        let lit = [Some(-3..4), Some(-2..5), None, Some(-1..6)].map(|cells| vec![cells, Some(0..2)]);
        let found = windows(&points(3), &intervals, &lit);
        assert_eq!(
            found,
            vec![vec![Some(-2..4), Some(0..2)], vec![None, Some(0..2)], vec![None, Some(0..2)]]
        );
        let rows = [LeafRow { pairs: 0..2, edges_mm: [0.0, 10.0], cells: -9..9 }];
        assert_eq!(lit_cells(&rows, 5.0, &[[-10.0, 2.5], [15.0, 7.5], [40.0, 12.5]]), vec![Some(-2..4)]);
        assert_eq!(lit_cells(&rows, 5.0, &[[40.0, 12.5]]), vec![None]);
    }
}
