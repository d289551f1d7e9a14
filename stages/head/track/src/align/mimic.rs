//! Whether the movable part of a face is where it was: a smile, a yawn, a swallow.
//!
//! The cells of the patches that move by themselves are compared with where they were in the first frames, as seen from
//! the skull. What stays elsewhere for long is the face at rest from then on: a jaw sinks when a person falls asleep.

use nalgebra::Vector3;

use crate::buckets::Buckets;
use crate::surface::Surface;

/// Width of the cells, m.
const CELL: f64 = 0.015;
/// Points of a cell that a frame needs.
const POINTS_LEAST: f64 = 12.0;
/// Frames whose mean is the face at rest.
const FIRST: u32 = 4;
/// A cell has moved by this, m, or by this part of the noise of a point.
const MOVED: f64 = 0.6e-3;
const NOISE: f64 = 1.0;
/// The same in multiples of its scatter from frame to frame, and at most, m: neighbouring points of a camera err alike.
const SCATTERS: f64 = 4.0;
const MOVED_MOST: f64 = 1.5e-3;
/// Frames in which the scatter is measured.
const SCATTER_FRAMES: u32 = 15;
/// Part of the seen points of the movable face that must have moved.
const PART: f64 = 0.12;
/// What stays for so long is at rest, ns.
const RESTS: u64 = 5_000_000_000;
/// A face farther off is a hand before it, m.
pub(super) const REACH: f64 = 0.015;

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    points: f64,
    distances: f64,
    start: f64,
    frames: u32,
    /// Where it stays, m, and since when, ns.
    stays: f64,
    since: u64,
    scatter: Scatter,
}

/// Scatter of a place from frame to frame, by second differences, to which a steady movement adds nothing.
#[derive(Debug, Clone, Copy, Default)]
struct Scatter {
    last: [f64; 2],
    frames: u32,
    squares: f64,
}

impl Scatter {
    fn add(&mut self, now: f64) {
        let [before, last] = self.last;
        if self.frames >= SCATTER_FRAMES {
            return;
        }
        if self.frames >= 2 {
            let second = now - 2.0 * last + before;
            self.squares += second * second / 6.0;
        }
        self.frames += 1;
        self.last = [last, now];
    }

    /// Its standard deviation, m; 0 before three frames.
    fn sd(&self) -> f64 {
        if self.frames < 3 { 0.0 } else { (self.squares / f64::from(self.frames - 2)).sqrt() }
    }
}

/// The movable part of a surface, in all frames so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Mimic {
    cell_of_patch: Vec<u32>,
    cells: Vec<Cell>,
}

impl Mimic {
    /// Of a surface, before its first frame.
    pub fn of(surface: &Surface) -> Self {
        if !surface.has_face() {
            return Self::default();
        }
        let positions: Vec<Vector3<f64>> = surface.patches().iter().map(|p| p.position).collect();
        let (cell_of_patch, count) = Buckets::new(&positions, CELL).numbers();
        Self { cell_of_patch, cells: vec![Cell::default(); count] }
    }

    /// Adds a point of the frame over a patch that moves by itself.
    pub fn add(&mut self, patch: usize, distance: f64) {
        let cell = self.cell_of_patch.get(patch).and_then(|cell| self.cells.get_mut(*cell as usize));
        if let Some(cell) = cell {
            cell.points += 1.0;
            cell.distances += distance;
        }
    }

    /// Ends a frame of points with this noise, m, acquired at `time`, ns. Says whether the face has moved.
    pub fn end(&mut self, noise: f64, time: u64) -> bool {
        let (mut all, mut moved) = (0.0, 0.0);
        let least = MOVED.max(NOISE * noise);
        for cell in &mut self.cells {
            let (points, distances) = (cell.points, cell.distances);
            (cell.points, cell.distances) = (0.0, 0.0);
            if points < POINTS_LEAST {
                continue;
            }
            let now = distances / points;
            let limit = least.max(SCATTERS * cell.scatter.sd()).min(MOVED_MOST.max(least));
            if (now - cell.start).abs() <= limit || cell.frames < FIRST {
                cell.scatter.add(now);
            }
            if cell.frames < FIRST {
                cell.frames += 1;
                cell.start += (now - cell.start) / f64::from(cell.frames);
                (cell.stays, cell.since) = (cell.start, time);
                continue;
            }
            if (now - cell.stays).abs() > limit {
                (cell.stays, cell.since) = (now, time);
            }
            if time.saturating_sub(cell.since) > RESTS {
                cell.start = cell.stays;
            }
            all += points;
            if (now - cell.start).abs() > limit {
                moved += points;
            }
        }
        moved > PART * all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten cells of twenty points, of which `part` is off by a millimetre for `frames` frames of 0.1 s after a second.
    fn after(part: usize, frames: u64) -> Vec<bool> {
        let mut mimic = Mimic { cell_of_patch: (0..10).collect(), cells: vec![Cell::default(); 10] };
        let step = |frame: u64| {
            let is_off = (10..10 + frames).contains(&frame);
            for patch in 0..10 {
                let off = if is_off && patch < part { 1e-3 } else { 0.0 };
                (0..20).for_each(|_| mimic.add(patch, off));
            }
            mimic.end(0.2e-3, 100_000_000 * frame)
        };
        (0..100).map(step).collect()
    }

    #[test]
    fn a_smile_is_seen_until_it_ends_and_a_twitch_of_an_eye_is_none() {
        let smile = after(4, 20);
        assert!(smile.iter().enumerate().all(|(frame, moves)| *moves == (10..30).contains(&frame)));
        assert!(after(1, 20).iter().all(|moves| !moves));
    }

    #[test]
    fn a_jaw_that_sank_for_good_is_the_face_at_rest_after_five_seconds() {
        let sunk = after(4, 100);
        assert!(sunk[20] && sunk[59] && !sunk[65] && !sunk[99], "{sunk:?}");
    }
}
