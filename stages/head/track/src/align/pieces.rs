//! Whether each piece of a surface still moves with the rest of it. A hand or a tube in the reference that does not
//! move with the head is a piece that does not.
//!
//! A piece and the rest of the surface are fitted apart. How far the piece lies off in the first frames is an error of
//! the reference. A later change is a movement against the rest. Until the head is proven, the movements of both are
//! compared, too (see [`super::together`]), and those of all patches (see [`super::mixture`]).

use nalgebra::{Cholesky, Const, Isometry3, Matrix3, Matrix3x6, Matrix6, Point3, Vector3, Vector6};

use super::equations::Sums;
use super::mimic::Mimic;
use super::mixture::Mixture;
use super::together::{Together, Verdict};
use crate::buckets::Buckets;
use crate::surface::Surface;

/// Width of the cells of which pieces are made, and radius of a piece, m. A piece is about as large as a fist.
const CELL: f64 = 0.02;
const RADIUS: f64 = 0.035;
/// Part of the mean information that holds the directions which the piece, or the rest, does not constrain.
const HOLD: f64 = 1e-2;
const HOLD_REST: f64 = 1e-3;
/// Points that a piece needs at least. The rest needs three times as many.
const POINTS_LEAST: u32 = 60;
/// Number of frames whose mean is the place from which movements count, and weight of a new frame in the mean of the
/// later ones.
const FIRST: u32 = 4;
const NEW: f64 = 0.25;
/// Limits of the movement in one frame and of the mean movement: in multiples of the movement that independent noise of
/// the points feigns in one frame, of its scatter, at least and at most, m.
const ONCE: [f64; 4] = [10.0, 6.0, 0.6e-3, 2.0e-3];
const LASTING: [f64; 4] = [5.0, 4.5, 0.3e-3, 1.0e-3];
/// Frames in which the scatter of the pieces is measured.
const JITTER_FRAMES: u32 = 14;
/// Part of the patches of a piece that lie on a face, where it is one of the face.
const ON_FACE: f64 = 0.7;

/// Sums over the points of a frame that lie in a cell, or in several.
#[derive(Debug, Clone)]
struct Part {
    information: Matrix6<f64>,
    right: Vector6<f64>,
    points: u32,
}

impl Part {
    fn empty() -> Self {
        Self { information: Matrix6::zeros(), right: Vector6::zeros(), points: 0 }
    }

    fn sum<'a>(parts: impl Iterator<Item = &'a Self>) -> Self {
        parts.fold(Self::empty(), |sum, part| Self {
            information: sum.information + part.information,
            right: sum.right + part.right,
            points: sum.points + part.points,
        })
    }

    fn without(&self, other: &Self) -> Self {
        Self {
            information: self.information - other.information,
            right: self.right - other.right,
            points: self.points - other.points,
        }
    }

    /// The information on translations alone.
    fn along(&self) -> Matrix3<f64> {
        self.information.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Where this part fits best.
    fn fit(&self) -> Option<Fit> {
        let hold = HOLD_REST * self.information.trace() / 6.0;
        let held = self.information + Matrix6::from_diagonal_element(hold.max(f64::MIN_POSITIVE));
        let information = held.cholesky()?;
        let movement = information.solve(&self.right);
        Some(Fit { information, movement })
    }

    /// The translation (m) that brings this part onto the surface where the `rest` fits best.
    fn off(&self, rest: &Fit) -> Option<Vector3<f64>> {
        let left = self.right - self.information * rest.movement;
        let along = self.along();
        let hold = HOLD * along.trace() / 3.0;
        let held = (along + Matrix3::from_diagonal_element(hold.max(f64::MIN_POSITIVE))).cholesky()?;
        Some(held.solve(&left.fixed_rows::<3>(0).into_owned()))
    }
}

/// Where a part of the surface fits best.
struct Fit {
    information: Cholesky<f64, Const<6>>,
    /// The movement that brings it there: translation, m, and turn times the length of the surface, m.
    movement: Vector6<f64>,
}

impl Fit {
    /// How far the part lies off at a place of the surface, m, and its covariance for points of unit noise.
    fn at(&self, place: &Vector3<f64>, length: f64) -> (Vector3<f64>, Matrix3<f64>) {
        let turn = -place.cross_matrix() / length;
        let mut of = Matrix3x6::identity();
        of.fixed_view_mut::<3, 3>(0, 3).copy_from(&turn);
        (-of * self.movement, of * self.information.solve(&of.transpose()))
    }
}

/// How much the place of a piece scatters from frame to frame: cameras smooth their noise, so that neighbouring points err
/// alike. Of the first frames, by second differences, to which a steady movement adds nothing.
#[derive(Debug, Clone, Copy, Default)]
struct Jitter {
    last: [Vector3<f64>; 2],
    frames: u32,
    squares: f64,
    count: f64,
}

impl Jitter {
    /// Adds a frame in which the piece lies off by so much, m, of the shape `along` its normals for so many points.
    fn add(&mut self, off: &Vector3<f64>, along: &Matrix3<f64>, points: f64) {
        let [before, last] = self.last;
        if self.frames >= 2 && self.frames < JITTER_FRAMES {
            let second = off - 2.0 * last + before;
            self.squares += second.dot(&(along * second)).max(0.0) / (6.0 * points);
            self.count += 1.0;
        }
        self.frames += 1;
        self.last = [last, *off];
    }

    /// Its standard deviation along the normals, m; 0 before three frames.
    fn sd(&self) -> f64 {
        if self.count > 0.0 { (self.squares / self.count).sqrt() } else { 0.0 }
    }
}

/// A part of the surface, in all frames so far.
#[derive(Debug, Clone)]
struct Piece {
    cells: Vec<u32>,
    middle: Vector3<f64>,
    /// How far it lies off in the mean of the first frames, and in that of the last ones, m.
    start: Vector3<f64>,
    now: Vector3<f64>,
    frames: u32,
    jitter: Jitter,
    /// Nearly all of it lies on a face: it may be a brow that rises.
    is_face: bool,
    together: Together,
    /// What the last frame and those before it tell.
    known: Known,
}

/// What a frame, and those before it, tell of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Known {
    /// Whether enough points of the frame lie on it.
    pub is_seen: bool,
    /// Whether it was seen to move as the rest does.
    pub verdict: Verdict,
    /// How far it has moved against the rest since the first frames, m, along the axes of the surface.
    pub moved: Vector3<f64>,
    /// The larger of its movements, that of the frame and the mean one, over its limit.
    pub over: f64,
}

impl Piece {
    /// Adds a frame in which the piece lies off by so much, m; a `face` that moves is not where it starts, and a piece of
    /// a face that moves with it, or that `is_raised` alone, has no part in the mean: what lasts is judged at rest. Returns
    /// its movement in this frame and the mean one, m. `None` in the first frames.
    fn add(&mut self, off: &Vector3<f64>, face: bool, is_raised: bool) -> Option<[Vector3<f64>; 2]> {
        if face && self.frames < FIRST {
            return None;
        }
        if self.frames < FIRST {
            self.frames += 1;
            self.start += (off - self.start) / f64::from(self.frames);
            self.now = self.start;
            return None;
        }
        if !(self.is_face && (face || is_raised)) {
            self.now += NEW * (off - self.now);
        }
        Some([off - self.start, self.now - self.start])
    }
}

/// What a frame tells of the pieces of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moves {
    /// Largest movement of a piece against the rest since the first frames, over its limit: of pieces that are no part of a
    /// face, and of those that are.
    pub most: f64,
    /// See `most`.
    pub skin: f64,
    /// The largest of the movements that last, of any piece, over its limit.
    pub lasting: f64,
    /// Share of the points in pieces that were seen to move with the rest, and in pieces that were seen not to.
    pub with: f64,
    /// See `with`.
    pub against: f64,
    /// Whether the patches of the surface move alike, wherever they are; `Open` once the question is settled.
    pub alike: Verdict,
    /// Whether they surely do not, whatever later frames show.
    pub mixed: bool,
    /// Whether the movable part of a face is elsewhere than at rest, seen from the skull.
    pub face: bool,
}

/// The overlapping pieces of a surface.
#[derive(Debug, Clone)]
pub struct Pieces {
    cell_of_patch: Vec<u32>,
    sums: Vec<(Sums, u32)>,
    cells: Vec<Part>,
    pieces: Vec<Piece>,
    /// Buffer: which groups of patches have points in a frame.
    pub(super) hits: Vec<bool>,
    mixture: Mixture,
    mimic: Mimic,
    /// A table of movements lies on the surface: limits follow the scatter of each piece.
    has_face: bool,
    length: f64,
    /// Where the first frame lay on the surface.
    first: Option<Isometry3<f64>>,
    /// Whether it is still to be seen that the pieces move together.
    is_open: bool,
}

impl Pieces {
    /// The pieces of a surface, before its first frame.
    #[must_use]
    pub fn of(surface: &Surface) -> Self {
        let positions: Vec<_> = surface.patches().iter().map(|p| p.position).collect();
        let (cell_of_patch, count) = Buckets::new(&positions, CELL).numbers();
        let mut on_face = vec![(0.0, 0.0); count];
        for (patch, cell) in cell_of_patch.iter().enumerate() {
            let (face, all) = &mut on_face[*cell as usize];
            *face += f64::from(u8::from(surface.is_on_face(patch)));
            *all += 1.0;
        }
        let mut middles = vec![(Vector3::zeros(), 0.0); count];
        for (position, cell) in positions.iter().zip(&cell_of_patch) {
            let (sum, patches) = &mut middles[*cell as usize];
            *sum += position;
            *patches += 1.0;
        }
        let middles: Vec<Vector3<f64>> = middles.into_iter().map(|(sum, patches)| sum / patches).collect();
        let about = |middle: &Vector3<f64>| {
            let near = (0..).zip(&middles).filter(|(_, other)| (*other - middle).norm() < RADIUS);
            let [start, now] = [Vector3::zeros(); 2];
            let cells: Vec<u32> = near.map(|(cell, _)| cell).collect();
            let on = cells.iter().filter_map(|cell| on_face.get(*cell as usize));
            let (face, all) = on.fold((0.0, 0.0), |(a, b), (face, all)| (a + face, b + all));
            let is_face = face > ON_FACE * all;
            let (jitter, together) = (Jitter::default(), Together::default());
            let known = Known::default();
            Piece { cells, middle: *middle, start, now, frames: 0, jitter, is_face, together, known }
        };
        let pieces = middles.iter().map(about).collect();
        Self {
            cell_of_patch,
            sums: vec![(Sums::default(), 0); count],
            cells: vec![Part::empty(); count],
            pieces,
            hits: Vec::new(),
            mixture: Mixture::of(surface.patches().len()),
            mimic: Mimic::of(surface),
            has_face: surface.has_face(),
            length: surface.length(),
            first: None,
            is_open: true,
        }
    }

    /// The middle of each piece on the surface, m, and what is known of it.
    pub fn known(&self) -> impl ExactSizeIterator<Item = (Vector3<f64>, Known)> {
        self.pieces.iter().map(|piece| (piece.middle, piece.known))
    }

    /// Notes that the question whether the pieces move together is settled: their movements are compared no more.
    pub fn settle(&mut self) {
        self.is_open = false;
    }

    /// Begins a frame.
    pub(super) fn begin(&mut self) {
        self.sums.fill((Sums::default(), 0));
    }

    /// Adds a point of the frame that lies on a patch.
    pub(super) fn add(&mut self, patch: usize, row: &Vector6<f64>, distance: f64) {
        let cell = self.cell_of_patch.get(patch).and_then(|cell| self.sums.get_mut(*cell as usize));
        if let Some((sums, points)) = cell {
            sums.add(row, distance, 1.0);
            *points += 1;
        }
        if self.is_open {
            self.mixture.add(patch, distance);
        }
    }

    /// Adds a point of the frame that lies over a patch that moves by itself.
    pub(super) fn add_mimic(&mut self, patch: usize, distance: f64) {
        self.mimic.add(patch, distance);
    }

    /// Ends a frame, acquired at `time`, ns, whose points have this noise (standard deviation along the normals, m), where all of them fit best.
    pub(super) fn end(
        &mut self,
        noise: f64,
        time: u64,
        surface: &Surface,
        surface_from_cloud: &Isometry3<f64>,
    ) -> Moves {
        let face = self.mimic.end(noise, time);
        let Self { sums, cells, pieces, mixture, length, first, is_open, has_face, .. } = self;
        for (cell, (sums, points)) in cells.iter_mut().zip(sums.iter()) {
            *cell = Part { information: sums.information(), right: sums.right, points: *points };
        }
        let since = *first.get_or_insert(*surface_from_cloud) * surface_from_cloud.inverse();
        let moved = |at: &Vector3<f64>| (since * Point3::from(*at)).coords - at;
        let (mut alike, mut mixed) = (Verdict::Open, false);
        if face {
            mixture.skip();
        } else if *is_open {
            mixture.end(surface.patches().iter().map(|p| moved(&p.position).dot(&p.normal)));
            (alike, mixed) = (mixture.verdict(), mixture.is_mixed());
        }
        let whole = Part::sum(cells.iter());
        let (mut most, mut skin, mut lasting): (f64, f64, f64) = (0.0, 0.0, 0.0);
        let (mut all, mut with, mut against) = (0.0, 0.0, 0.0);
        for piece in pieces.iter_mut() {
            piece.known.is_seen = false;
            let own = Part::sum(piece.cells.iter().filter_map(|cell| cells.get(*cell as usize)));
            let rest = whole.without(&own);
            if own.points < POINTS_LEAST || rest.points < 3 * POINTS_LEAST {
                continue;
            }
            let Some(rest) = rest.fit() else { continue };
            let Some(off) = own.off(&rest) else { continue };
            let (along, points) = (own.along(), f64::from(own.points));
            piece.known.is_seen = true;
            if *is_open && !face {
                let (rest_off, covariance) = rest.at(&piece.middle, *length);
                let moved = moved(&piece.middle) + rest_off;
                piece.together.add(&along, &moved, &(moved - off), &(noise * noise * covariance));
                all += points;
                piece.known.verdict = piece.together.verdict(noise);
                match piece.known.verdict {
                    Verdict::Open => {}
                    Verdict::With => with += points,
                    Verdict::Against => against += points,
                }
            }
            if !face {
                piece.jitter.add(&off, &along, points);
            }
            // Three unknowns are fitted to the points of the piece.
            let feigned = noise * (3.0 / points).sqrt();
            let (has_face, jitter) = (*has_face, piece.jitter.sd());
            let part = |movement: &Vector3<f64>, [times, scatters, least, greatest]: [f64; 4]| {
                let size = (movement.dot(&(along * movement)).max(0.0) / points).sqrt();
                let scatter = if has_face { scatters * jitter } else { 0.0 };
                let greatest = if has_face { greatest } else { f64::INFINITY };
                size / (times * feigned).max(scatter).max(least).min(greatest)
            };
            let is_raised = piece.is_face && part(&(off - piece.start), ONCE) > 1.0;
            let Some(movements) = piece.add(&off, face, is_raised) else { continue };
            piece.known.moved = movements[0];
            piece.known.over = 0.0;
            for (kind, (movement, limits)) in movements.iter().zip([ONCE, LASTING]).enumerate() {
                let part = part(movement, limits);
                piece.known.over = piece.known.over.max(part);
                if piece.is_face {
                    skin = skin.max(part);
                } else {
                    most = most.max(part);
                }
                if kind == 1 {
                    lasting = lasting.max(part);
                }
            }
        }
        let share = |points: f64| if all > 0.0 { points / all } else { 0.0 };
        Moves { most, skin, lasting, with: share(with), against: share(against), alike, mixed, face }
    }
}
