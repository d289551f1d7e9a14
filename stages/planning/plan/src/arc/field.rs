//! The dose of what leaves can open along an arc: cells of a half bixel along the travel and a row of leaves across it.
//!
//! Cells are narrower along the travel than bixels, since a tip that stands within a cell opens a part of it, which moves the
//! edge of the dose by up to half a cell.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::ops::Range;

use super::ArcError;
use super::spec::ArcSpec;
use super::window::{lit_cells, windows, within_reach};
use crate::dose::{BeamAngles, BixelSpec, Collimator, DoseEngine};
use crate::fluence::{DoseChange, Goals};
use crate::threads::on_threads;

/// Neighbouring leaf pairs that move together.
#[derive(Clone, Debug, PartialEq)]
pub struct LeafRow {
    /// Numbers of the pairs.
    pub pairs: Range<usize>,
    /// Lower and upper edge across the travel, mm.
    pub edges_mm: [f64; 2],
    /// Numbers of its cells: cell `j` lies around `j` widths.
    pub cells: Range<i32>,
}

impl LeafRow {
    /// Whether a cell of this width around a place across the travel lies partly in the row.
    pub fn is_over(&self, z_mm: f64, width_mm: f64) -> bool {
        let half = 0.5 * width_mm;
        z_mm + half > self.edges_mm[0] + 1e-6 && z_mm - half < self.edges_mm[1] - 1e-6
    }
}

/// Dose of the cells at a gantry angle.
#[derive(Clone, Debug)]
pub struct CellDoses {
    /// Gantry angle, degrees.
    pub gantry_deg: f64,
    /// Where the entries of each cell start, row by row; one more at the end.
    starts: Vec<usize>,
    /// Row of the goals of each entry.
    row: Vec<u32>,
    /// Gray for a weight of 1.
    value: Vec<f32>,
}

/// A stretch between two control points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The control point at its beginning; the next one is at its end.
    pub from: usize,
    /// What the gantry turns by, degrees.
    pub degrees: f64,
    /// The cell doses at a quarter and at three quarters of it.
    pub doses: [usize; PARTS],
}

/// A control point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlAngle {
    /// Number of its arc.
    pub arc: usize,
    /// Gantry angle, degrees; it runs on beyond 0 and 360.
    pub gantry_deg: f64,
    /// The interval that ends here.
    pub before: Option<usize>,
    /// The interval that begins here.
    pub after: Option<usize>,
}

/// Angles in an interval of which its dose is made: midpoints of its halves.
pub const PARTS: usize = 2;

/// How far the part is on the way from the first control point of an interval to the second.
pub fn part(number: usize) -> f64 {
    (number as f64 + 0.5) / PARTS as f64
}

/// The arcs of a plan with the doses of their cells.
#[derive(Clone, Debug)]
pub struct ArcField {
    /// Width of a cell along the travel, mm.
    pub width_mm: f64,
    /// Fluence behind a leaf, relative to the open one.
    pub transmission: f64,
    /// Rows of leaves.
    pub rows: Vec<LeafRow>,
    /// Control points of all arcs, one arc after the other.
    pub points: Vec<ControlAngle>,
    /// Intervals of all arcs.
    pub intervals: Vec<Interval>,
    /// Doses at each angle that is used.
    pub doses: Vec<CellDoses>,
    /// For each control point and row of leaves the cells that its tips may open: those that every angle lights in whose dose
    /// they have a part. Nothing where there are none.
    pub windows: Vec<Vec<Option<Range<i32>>>>,
    /// The first column of each row of leaves in the doses.
    offsets: Vec<usize>,
    /// Rows of the goals.
    goal_rows: usize,
}

impl ArcField {
    /// Computes the doses of the cells for the points of an engine; any number of threads gives the same bytes. Rows of leaves
    /// are at most a bixel of the engine wide, cells half as wide.
    ///
    /// # Errors
    /// A dose cannot be computed, or the target is beyond the leaves.
    pub fn new(
        engine: &DoseEngine,
        goals: &Goals,
        collimator: &Collimator,
        arcs: &[ArcSpec],
        threads: NonZeroUsize,
    ) -> Result<Self, ArcError> {
        let bixel_mm = engine.params().bixels.width_mm;
        let width_mm = 0.5 * bixel_mm;
        let fine = engine.with_bixels(BixelSpec { width_mm, ..engine.params().bixels });
        let (points, intervals, angles) = schedule(arcs);
        let lit = on_threads(&angles, threads, |angle| fine.bixels_mm(*angle))?;
        let rows = leaf_rows(collimator, bixel_mm, width_mm, &lit)?;
        let lit: Vec<_> = lit.iter().map(|lit| lit_cells(&rows, width_mm, lit)).collect();
        let windows = windows(&points, &intervals, &lit);
        for cells in windows.iter().flatten().flatten() {
            within_reach(collimator, around_mm(width_mm, cells))?;
        }
        let mut offsets = vec![0];
        for row in &rows {
            offsets.push(offsets[offsets.len() - 1] + row.cells.len());
        }
        let goal_row = goal_rows(goals);
        let cells = Cells { rows: &rows, width_mm, goal_row: &goal_row };
        let doses = on_threads(&angles, threads, |angle| cells.doses(&fine, *angle))?;
        let transmission = collimator.transmission;
        let goal_rows = goals.voxels().len();
        Ok(Self { width_mm, transmission, rows, points, intervals, doses, windows, offsets, goal_rows })
    }

    /// Entries of all doses.
    pub fn entries(&self) -> usize {
        self.doses.iter().map(|doses| doses.value.len()).sum()
    }

    /// Rows of the goals.
    pub fn goal_rows(&self) -> usize {
        self.goal_rows
    }

    /// Rows of the goals and gray of a cell of a row of leaves; nothing beside the cells.
    #[inline]
    pub fn cell(&self, doses: usize, row: usize, cell: i32) -> (&[u32], &[f32]) {
        let cells = &self.rows[row].cells;
        if !cells.contains(&cell) {
            return (&[], &[]);
        }
        let doses = &self.doses[doses];
        let column = self.offsets[row] + (cell - cells.start) as usize;
        let range = doses.starts[column]..doses.starts[column + 1];
        (&doses.row[range.clone()], &doses.value[range])
    }

    /// Adds the dose of a cell times a weight.
    #[inline]
    pub fn add_cell(&self, at: (usize, usize, i32), weight: f64, change: &mut DoseChange) {
        let (rows, values) = self.cell(at.0, at.1, at.2);
        for (row, value) in rows.iter().zip(values) {
            change.add(*row, weight * f64::from(*value));
        }
    }

    /// Slopes of the cost in the weight of each cell at an angle, row by row of leaves, by its slopes in the doses.
    pub fn slopes(&self, doses: usize, pull: &[f64]) -> Vec<f64> {
        let doses = &self.doses[doses];
        let of = |range: &[usize]| {
            let range = range[0]..range[1];
            let both = doses.row[range.clone()].iter().zip(&doses.value[range]);
            both.map(|(row, value)| pull[*row as usize] * f64::from(*value)).sum()
        };
        doses.starts.windows(2).map(of).collect()
    }

    /// The slopes of a row of leaves among those of all.
    pub fn of_row<'a>(&self, row: usize, slopes: &'a [f64]) -> &'a [f64] {
        &slopes[self.offsets[row]..self.offsets[row + 1]]
    }

    /// Adds the dose of tips of all rows at an angle, the transmission of the leaves included.
    pub fn add_open(&self, doses: usize, tips: impl Fn(usize) -> [f64; 2], weight: f64, dose: &mut [f64]) {
        for (row, leaves) in self.rows.iter().enumerate() {
            let tips = tips(row);
            for cell in leaves.cells.clone() {
                let passed = self.transmission + (1.0 - self.transmission) * self.open(cell, tips);
                let (rows, values) = self.cell(doses, row, cell);
                for (at, value) in rows.iter().zip(values) {
                    dose[*at as usize] += weight * passed * f64::from(*value);
                }
            }
        }
    }

    /// The part of a cell that tips leave open.
    #[inline]
    pub fn open(&self, cell: i32, [low, high]: [f64; 2]) -> f64 {
        let [from, to] = self.edges_mm(cell);
        (high.min(to) - low.max(from)).max(0.0) / self.width_mm
    }

    /// Edges of a cell, mm.
    #[inline]
    pub fn edges_mm(&self, cell: i32) -> [f64; 2] {
        [(f64::from(cell) - 0.5) * self.width_mm, (f64::from(cell) + 0.5) * self.width_mm]
    }

    /// The lowest and the highest edge of the cells of a row, mm.
    pub fn ends_mm(&self, row: usize) -> [f64; 2] {
        self.around_mm(&self.rows[row].cells)
    }

    /// The lowest and the highest edge of these cells, mm.
    pub fn around_mm(&self, cells: &Range<i32>) -> [f64; 2] {
        around_mm(self.width_mm, cells)
    }
}

/// The lowest and the highest edge of cells of this width, mm.
fn around_mm(width_mm: f64, cells: &Range<i32>) -> [f64; 2] {
    [(f64::from(cells.start) - 0.5) * width_mm, (f64::from(cells.end - 1) + 0.5) * width_mm]
}

/// Control points, intervals, and the angles of their doses.
fn schedule(arcs: &[ArcSpec]) -> (Vec<ControlAngle>, Vec<Interval>, Vec<BeamAngles>) {
    let (mut points, mut intervals, mut angles) = (Vec::new(), Vec::new(), Vec::new());
    // In micro-degrees: arcs over the same angles share their doses.
    let mut numbers: BTreeMap<i64, usize> = BTreeMap::new();
    for (arc, spec) in arcs.iter().enumerate() {
        let control = spec.control_points_deg();
        for (number, gantry_deg) in control.iter().enumerate() {
            let from = points.len();
            let before = (number > 0).then(|| intervals.len() - 1);
            let after = control.get(number + 1).map(|next| {
                let doses = std::array::from_fn(|at| {
                    let degrees = (gantry_deg + part(at) * (next - gantry_deg)).rem_euclid(360.0);
                    *numbers.entry(libm::round(1e6 * degrees) as i64).or_insert_with(|| {
                        angles.push(degrees.into());
                        angles.len() - 1
                    })
                });
                intervals.push(Interval { from, degrees: (next - gantry_deg).abs(), doses });
                intervals.len() - 1
            });
            points.push(ControlAngle { arc, gantry_deg: *gantry_deg, before, after });
        }
    }
    (points, intervals, angles)
}

/// Rows of leaf pairs over all places that are lit from any angle; each row has the cells that any angle needs.
fn leaf_rows(
    collimator: &Collimator,
    most_mm: f64,
    width_mm: f64,
    lit: &[Vec<[f64; 2]>],
) -> Result<Vec<LeafRow>, ArcError> {
    let places = || lit.iter().flatten();
    let half = 0.5 * width_mm;
    let low = places().map(|[_, z]| z - half).fold(f64::INFINITY, f64::min);
    let high = places().map(|[_, z]| z + half).fold(f64::NEG_INFINITY, f64::max);
    let edges = &collimator.leaf_edges_mm;
    let (first, last) = (edges[0], edges[collimator.pairs()]);
    if low < first || high > last {
        return Err(ArcError::Beyond { low_mm: low, high_mm: high, first_mm: first, last_mm: last });
    }
    let mut rows: Vec<LeafRow> = Vec::new();
    let mut pair = edges.partition_point(|edge| *edge <= low).saturating_sub(1);
    while pair < collimator.pairs() && edges[pair] < high {
        let mut end = pair + 1;
        while end < collimator.pairs() && edges[end + 1] - edges[pair] <= most_mm + 1e-6 {
            end += 1;
        }
        let mut row = LeafRow { pairs: pair..end, edges_mm: [edges[pair], edges[end]], cells: 0..0 };
        let cells = places().filter(|[_, z]| row.is_over(*z, width_mm));
        let cells = cells.map(|[x, _]| libm::round(x / width_mm) as i32);
        if let (Some(from), Some(to)) = (cells.clone().min(), cells.max()) {
            row.cells = from..to + 1;
            rows.push(row);
        }
        pair = end;
    }
    match rows.is_empty() {
        true => Err(ArcError::Dark),
        false => Ok(rows),
    }
}

/// The row of the goals of each row of an engine; none where no objective needs it.
fn goal_rows(goals: &Goals) -> Vec<Option<u32>> {
    let mut of = vec![None; goals.rows()];
    goals.voxels().iter().enumerate().for_each(|(row, voxel)| of[*voxel as usize] = Some(row as u32));
    of
}

/// The cells whose doses are computed.
struct Cells<'a> {
    rows: &'a [LeafRow],
    width_mm: f64,
    goal_row: &'a [Option<u32>],
}

impl Cells<'_> {
    /// A cell is a stack of squares, of which the engine knows the dose.
    fn doses(&self, engine: &DoseEngine, angles: BeamAngles) -> Result<CellDoses, ArcError> {
        let mut squares = Vec::new();
        let mut stacks: Vec<(usize, f64)> = Vec::new();
        for row in self.rows {
            let [low, high] = row.edges_mm;
            let count = libm::round((high - low) / self.width_mm).max(1.0);
            let height_mm = (high - low) / count;
            for cell in row.cells.clone() {
                let x_mm = f64::from(cell) * self.width_mm;
                squares.extend((0..count as u32).map(|at| [x_mm, low + (f64::from(at) + 0.5) * height_mm]));
                stacks.push((count as usize, height_mm / self.width_mm));
            }
        }
        let beam = engine.squares_of(angles, squares)?;
        let matrix = beam.dose.view();
        let mut found =
            CellDoses { gantry_deg: angles.gantry_deg, starts: vec![0], row: Vec::new(), value: Vec::new() };
        let mut sum = vec![0.0_f32; self.goal_row.iter().flatten().count()];
        let mut touched: Vec<u32> = Vec::new();
        let mut square = 0;
        for (count, weight) in stacks {
            for column in square..square + count {
                let (rows, values) = matrix.column(column);
                for (row, value) in rows.iter().zip(values) {
                    let Some(row) = self.goal_row[*row as usize] else { continue };
                    if sum[row as usize] == 0.0 {
                        touched.push(row);
                    }
                    sum[row as usize] += weight as f32 * value;
                }
            }
            square += count;
            touched.sort_unstable();
            for row in touched.drain(..) {
                found.row.push(row);
                found.value.push(std::mem::take(&mut sum[row as usize]));
            }
            found.starts.push(found.row.len());
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arc::{Bounds, Trajectory};
    use crate::dose::ArcLimits;
    use crate::recipe::{PlanSetup, PointScheme, SetupSpec};
    use stillpoint_patient::case::phantom;

    #[test]
    fn leaves_that_stand_still_over_an_arc_give_the_dose_of_static_beams_of_the_same_angles() {
        let spec = SetupSpec {
            grid_mm: 10.0,
            bixel_mm: 20.0,
            points: PointScheme::Thinned,
            ..SetupSpec::shipped().unwrap()
        };
        let setup = PlanSetup::new(phantom(0).unwrap(), spec).unwrap();
        let open = Collimator { transmission: 0.0, ..Collimator::generic() };
        let arcs = ["100..124cw".parse().unwrap()];
        let field = ArcField::new(setup.engine(), &setup.goals, &open, &arcs, NonZeroUsize::MIN).unwrap();
        // A window that ends within cells.
        let window = [-27.0, 31.5];
        let trajectory = Trajectory {
            tips_mm: vec![vec![window; field.rows.len()]; field.points.len()],
            weights: (0..field.intervals.len()).map(|at| 1.0 + 0.1 * at as f64).collect(),
        };
        let dose = trajectory.dose(&field);
        let engine = setup.engine();
        let fine = engine.with_bixels(BixelSpec { width_mm: 10.0, ..engine.params().bixels });
        let mut expected = vec![0.0; setup.goals.voxels().len()];
        for interval in 0..field.intervals.len() {
            for degrees in [1.0, 3.0] {
                let mut squares = Vec::new();
                for z in [-60.0, -50.0, -40.0, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0] {
                    squares.extend((-8..=8).map(|x| [10.0 * f64::from(x), z]));
                }
                let weight = |x: f64| {
                    0.05 * (1.0 + 0.1 * interval as f64)
                        * (window[1].min(x + 5.0) - window[0].max(x - 5.0)).max(0.0)
                };
                let beam = fine.squares_of(100.0 + 4.0 * interval as f64 + degrees, squares.clone()).unwrap();
                for (column, [x, z]) in squares.iter().enumerate() {
                    let is_row = field.rows.iter().any(|row| row.edges_mm[0] < *z && *z < row.edges_mm[1]);
                    let (rows, values) = beam.dose.view().column(column);
                    for (row, value) in rows.iter().zip(values).filter(|_| is_row) {
                        let Ok(at) = setup.goals.voxels().binary_search(row) else { continue };
                        expected[at] += weight(*x) * f64::from(*value);
                    }
                }
            }
        }
        let largest = expected.iter().fold(0.0, |a, b| f64::max(a, *b));
        let off = dose.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Entries are single precision numbers.
        assert!(largest > 1.0 && off < 1e-6 * largest, "{off} of {largest}");
        let bounds = Bounds::new(&field, &ArcLimits::generic(), &open, 1.0).unwrap();
        assert_eq!(trajectory.fault(&field, &bounds), None);
    }

    #[test]
    fn arcs_over_the_same_angles_share_their_doses() {
        let arcs = ArcSpec::list("2").unwrap();
        let (points, intervals, angles) = schedule(&arcs);
        assert_eq!((points.len(), intervals.len(), angles.len()), (180, 178, 178));
        assert!(points[89].after.is_none() && points[90].before.is_none());
        assert_eq!(points[90].after, Some(89));
        assert!(intervals.iter().all(|interval| interval.degrees <= 4.0));
    }
}
