//! Whether what is followed is still what was captured: size, overlap, residual, place, and the agreement of the parts
//! of the surface; and whether the parts were seen to move together since the capture.

use nalgebra::{Isometry3, Vector3};
use stillpoint_samples::{IdentityPart, Proof, Unproven};

use crate::align::{Agreement, Alignment, Known, PartAxes, Pieces, Verdict, agreement};
use crate::surface::Surface;

/// A part of the confidence at its limit. Below it the frame has no pose.
pub const ENOUGH: f64 = 0.5;
/// Points that the parts are judged by; and until it is known whether they move together, which is sooner the more there
/// are.
const POINTS: usize = 3000;
const POINTS_UNPROVEN: usize = 12_000;
/// Relative deviation of the size: its limit.
const SIZE: f64 = 0.05;
/// Over the least overlap that a pose needs: how far from there to full certainty.
const OVERLAP: f64 = 0.15;
/// Density of points on the surface over that after the capture: its limit, and how far above it is full certainty. A
/// perforated mask that stays where the head was has about two thirds of the points.
const DENSITY: f64 = 0.78;
const DENSITY_RANGE: f64 = 0.1;
/// Robust deviation of the distances: its limit, in multiples of the noise of the reference, and at least, m.
const RESIDUAL: f64 = 3.0;
const RESIDUAL_LEAST: f64 = 1.5e-3;
/// How far the head may be from where it was captured, m, and turned, rad.
const REGION: f64 = 0.15;
const REGION_TURN: f64 = 0.9;
/// Greatest relative movement of two halves of the surface, in multiples of the noise of the reference, at least and at most, m.
const APART: f64 = 0.5;
const APART_LEAST: f64 = 0.3e-3;
const APART_MOST: f64 = 0.8e-3;
/// The same in multiples of what it is in the middle of the first frames, where a table of movements lies on the surface:
/// neighbouring points of a camera err alike, and the noise of the reference does not show it.
const APART_TIMES: f64 = 2.2;
const APART_FRAMES: usize = 15;
/// While a face moves, for at most so long, ns, its parts may be farther apart by this: brows and lids. The beam is off.
const EASED: f64 = 3.0;
const EASED_TIME: u64 = 5_000_000_000;
/// A face explains doubts for so long after it was last seen to move, ns, and movements of what is no face, which the pose
/// makes that follows a face, up to this multiple of their limit.
const RECENT: u64 = 1_000_000_000;
const ASIDE_FACE: f64 = 2.0;
/// Least part of a quarter's points that must lie on the surface.
const QUARTER: f64 = 0.35;
/// Share of the points in pieces that have to be seen to move with the rest, and greatest share in pieces that were seen
/// not to.
const WITH: f64 = 0.85;
const AGAINST: f64 = 0.05;
/// Until then no piece may ever have moved against the rest by this part of the limit that holds later. On a surface from a
/// CT pieces do so by its misfit when the head is brought to its set-up, and then nearly all are seen to move with it. A
/// mask with a head behind it moves as a whole, too, but it is no surface of a CT.
const MOVED_BEFORE: f64 = 0.5;
/// The same of movements that last, where a table of movements lies on the surface.
const MOVED_FOR_LONG: f64 = 0.7;
const NEARLY_ALL: f64 = 0.95;
/// Frames whose mean density of points is that of the captured surface.
const FIRST: u32 = 4;
/// How long the parts have after the capture to be seen to move together, ns.
const PROOF_TIME: u64 = 10_000_000_000;
/// Causes for which there is no proof.
const CAUSES: usize = Unproven::ALL.len();

/// A frame that has a pose.
#[derive(Debug, Clone, Copy)]
pub struct SeenFrame<'a> {
    /// Its points, m, finite, seen from the origin.
    pub cloud: &'a [Vector3<f64>],
    /// How they lie on the reference.
    pub alignment: &'a Alignment,
    /// The head's motion since the capture, in the cloud's frame.
    pub motion: &'a Isometry3<f64>,
    /// When it was acquired, ns.
    pub time: u64,
    /// The cameras whose clouds it is of, a bit each; 0 where that is not known.
    pub cameras: u32,
}

/// What a pose needs.
#[derive(Debug, Clone, Copy)]
pub struct Needed {
    /// Part of the points that must lie on the reference.
    pub overlap: f64,
    /// A point within this distance lies on it, m.
    pub tolerance: f64,
    /// Whether half of the surface may be hidden. Otherwise a pose needs all halves.
    pub may_hide: bool,
}

/// What the checks said of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    /// Certainties in the order of [`IdentityPart`].
    pub certainty: [f64; 5],
    /// How the parts agree.
    pub agreement: Agreement,
    /// The face moves by itself.
    pub faces: bool,
    /// If the frame is doubted, a face that moves explains it: what is no face moves by little, and size, overlap, residual
    /// and place are right.
    pub explained: bool,
}

impl Judged {
    /// The least of the certainties.
    #[must_use]
    pub fn confidence(&self) -> f64 {
        self.certainty.iter().copied().fold(1.0, f64::min)
    }
}

/// Sets of cameras whose densities are measured apart: those of the first four.
const CAMERA_SETS: usize = 16;
/// For how long after the last frame of a set whose density is known that of another set may be measured, ns. Later, nobody
/// knows whether what the other set sees is still the whole head.
const MEASURED_WITHIN: u64 = 500_000_000;

/// Mean density of points on the surface in the first frames with enough confidence, and the number of these frames.
#[derive(Debug, Clone, Copy, Default)]
struct Density {
    mean: f64,
    frames: u32,
}

impl Density {
    fn add(&mut self, density: f64) {
        if self.frames < FIRST && density.is_finite() {
            self.frames += 1;
            self.mean += (density - self.mean) / f64::from(self.frames);
        }
    }

    fn is_known(&self) -> bool {
        self.frames >= FIRST
    }

    /// The certainty that no part of the captured surface is gone.
    fn complete(&self, density: f64) -> f64 {
        if self.frames == 0 {
            return 1.0;
        }
        let certainty = 0.5 + 0.5 * (density / self.mean - DENSITY) / DENSITY_RANGE;
        if certainty.is_finite() { certainty.clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Watches what is followed, from a capture on.
#[derive(Debug, Clone)]
pub struct Identity {
    axes: PartAxes,
    pieces: Pieces,
    /// Whether the reference is a surface from a CT.
    is_planned: bool,
    /// When the head was first found after the capture, ns.
    since: Option<u64>,
    proof: Proof,
    moved: f64,
    /// Why there is no proof, of the newest frame that was judged; and how many frames had each cause.
    why: Unproven,
    causes: [u32; CAUSES],
    /// Largest movement of a piece against the rest since the capture, over its limit.
    most: f64,
    /// Whether the patches were once seen not to move alike: a mask over a face.
    is_mixed: bool,
    /// Of each set of cameras: one that is left out takes its points with it.
    densities: [Density; CAMERA_SETS],
    /// The last frame with enough confidence of a set whose density is known, ns.
    sure: Option<u64>,
    /// Sets whose density was known before the proof was complete, a bit each.
    proven_sets: u32,
    /// The newest frame is of such a set, or no density is known yet.
    is_of_proven: bool,
    /// A table of movements lies on the surface.
    has_face: bool,
    /// Since when the face moves, ns.
    face: Option<u64>,
    /// When the face was last seen to move, ns.
    moved_face: Option<u64>,
    /// Movements of the halves against each other in the first frames with a face at rest, m.
    apart: Vec<f64>,
}

impl Identity {
    /// Of a reference, before its first frame; it `is_planned` where it is a surface from a CT.
    #[must_use]
    pub fn new(surface: &Surface, is_planned: bool) -> Self {
        Self {
            axes: PartAxes::of(surface),
            pieces: Pieces::of(surface),
            has_face: surface.has_face(),
            is_planned,
            since: None,
            proof: Proof::Waiting,
            moved: 0.0,
            why: Unproven::None,
            causes: [0; CAUSES],
            most: 0.0,
            is_mixed: false,
            densities: [Density::default(); CAMERA_SETS],
            sure: None,
            proven_sets: 0,
            is_of_proven: true,
            face: None,
            moved_face: None,
            apart: Vec::with_capacity(APART_FRAMES),
        }
    }

    /// The factor of the limits between parts in a frame of this time, ns.
    fn eased(&mut self, is_face: bool, time: u64) -> f64 {
        if !is_face {
            self.face = None;
            return 1.0;
        }
        let since = *self.face.get_or_insert(time);
        if time.saturating_sub(since) < EASED_TIME { EASED } else { 1.0 }
    }

    /// Judges a frame that has a pose.
    pub fn judge(&mut self, surface: &Surface, frame: &SeenFrame<'_>, needed: &Needed) -> Judged {
        let SeenFrame { cloud, alignment, motion, .. } = *frame;
        let set = frame.cameras as usize % CAMERA_SETS;
        let tolerance = needed.tolerance;
        let middle = surface.centroid();
        let noise = surface.noise_sd();
        let pieces = Some((&mut self.pieces, noise.max(alignment.sd), frame.time));
        let pose = &alignment.surface_from_cloud;
        let points = if self.proof == Proof::Waiting { POINTS_UNPROVEN } else { POINTS };
        let seen = agreement(surface, &self.axes, pieces, cloud, pose, tolerance, points);
        let shift = (motion * nalgebra::Point3::from(middle)).coords - middle;
        let mut certainty = [0.0; 5];
        // A size that the surface does not tell is no reason to doubt.
        let size = if seen.scale.is_nan() { 0.0 } else { (seen.scale - 1.0).abs() };
        certainty[IdentityPart::Size as usize] = below(size, SIZE);
        let overlap = (0.5 + (alignment.overlap - needed.overlap) / (2.0 * OVERLAP)).clamp(0.0, 1.0);
        let complete = self.complete(set, seen.density, needed.may_hide, frame.time);
        certainty[IdentityPart::Overlap as usize] = overlap.min(complete);
        certainty[IdentityPart::Residual as usize] =
            below(alignment.sd, (RESIDUAL * noise).max(RESIDUAL_LEAST));
        certainty[IdentityPart::Region as usize] =
            below(shift.norm(), REGION).min(below(motion.rotation.angle(), REGION_TURN));
        // A brow that rises is a piece of the face that moves against the rest, and a little.
        let is_skin = seen.moves.skin > 1.0 && seen.moves.skin < EASED;
        let eased = self.eased(seen.moves.face || is_skin, frame.time);
        let faces = seen.moves.face || (is_skin && eased > 1.0);
        let apart = if needed.may_hide { seen.apart_seen } else { seen.apart };
        let apart = below(apart, eased * self.apart_limit(apart, noise, faces));
        let quarter = (0.5 + (seen.least_overlap - QUARTER) / QUARTER).clamp(0.0, 1.0);
        certainty[IdentityPart::Agreement as usize] =
            apart.min(quarter).min(below(seen.moves.most, 1.0)).min(below(seen.moves.skin, eased));
        let others =
            |part: IdentityPart| part != IdentityPart::Agreement && certainty[part as usize] < ENOUGH;
        if self.has_face && (seen.moves.face || seen.moves.skin > 1.0) {
            self.moved_face = Some(frame.time);
        }
        let is_face = self.moved_face.is_some_and(|at| frame.time.saturating_sub(at) <= RECENT);
        let explained = is_face
            && seen.moves.most <= ASIDE_FACE
            && quarter >= ENOUGH
            && !IdentityPart::ALL.iter().any(|(_, part)| others(*part));
        let judged = Judged { certainty, agreement: seen, faces, explained };
        if judged.confidence() >= ENOUGH {
            self.densities[set].add(seen.density);
            if self.densities[set].is_known() {
                self.sure = Some(frame.time);
                if self.proven_sets == 0 || self.proof == Proof::Waiting {
                    self.proven_sets |= 1 << set;
                }
            }
        }
        self.is_of_proven = self.proven_sets == 0 || self.proven_sets >> set & 1 == 1;
        self.prove(&judged, frame.time);
        judged
    }

    /// The certainty that no part of the captured surface is gone from a frame of this set of cameras. While that of another
    /// set is known and its own is not, a frame counts only right after one of a known set, and with the whole head in it:
    /// what changes with the cameras may be the head.
    fn complete(&self, set: usize, density: f64, may_hide: bool, time: u64) -> f64 {
        let own = &self.densities[set];
        let is_first = own.is_known() || !self.densities.iter().any(Density::is_known);
        let is_near = self.sure.is_some_and(|sure| time.saturating_sub(sure) <= MEASURED_WITHIN);
        if is_first || (is_near && !may_hide) { own.complete(density) } else { 0.0 }
    }

    /// Limit of the movement of the halves against each other, m, in a frame where it is `apart`.
    fn apart_limit(&mut self, apart: f64, noise: f64, faces: bool) -> f64 {
        if !self.has_face {
            return (APART * noise).max(APART_LEAST);
        }
        if self.apart.len() < APART_FRAMES && apart.is_finite() && !faces {
            let place = self.apart.partition_point(|before| *before < apart);
            self.apart.insert(place, apart);
        }
        let usual = self.apart.get(self.apart.len() / 2).copied().unwrap_or(0.0);
        (APART * noise).max(APART_TIMES * usual).clamp(APART_LEAST, APART_MOST)
    }

    /// Notes that the surface has been fitted to more frames. Its patches are others, so their density is measured
    /// anew, and movements of its pieces count from now on.
    pub fn refine(&mut self, surface: &Surface) {
        self.densities = [Density::default(); CAMERA_SETS];
        (self.proven_sets, self.is_of_proven) = (0, true);
        self.pieces = Pieces::of(surface);
        self.has_face = surface.has_face();
        self.apart.clear();
        if self.proof != Proof::Waiting {
            self.pieces.settle();
        }
    }

    fn prove(&mut self, judged: &Judged, time: u64) {
        self.since.get_or_insert(time);
        let moves = &judged.agreement.moves;
        if judged.faces {
            self.note(Unproven::FaceMoves);
            return;
        }
        self.most = self.most.max(if self.has_face { moves.lasting } else { moves.most });
        // Where a table of movements lies on the surface, fewer patches are judged, and the first frames are less sure.
        self.is_mixed |= if self.has_face { moves.mixed } else { moves.alike == Verdict::Against };
        let by_misfit = self.is_planned && moves.with >= NEARLY_ALL;
        let limit = if self.has_face { MOVED_FOR_LONG } else { MOVED_BEFORE };
        let has_moved = self.most > limit && !by_misfit;
        let has_apart = moves.against > AGAINST || has_moved;
        let is_doubted = judged.confidence() < ENOUGH;
        self.note(match () {
            () if is_doubted && judged.explained => Unproven::FaceMoves,
            () if self.is_mixed || moves.alike == Verdict::Against => Unproven::Mixed,
            () if has_apart => Unproven::PieceApart,
            () if is_doubted => Unproven::Doubted,
            () => Unproven::TooLittleMotion,
        });
        if is_doubted || self.proof != Proof::Waiting {
            return;
        }
        let is_apart = has_apart || self.is_mixed || moves.alike != Verdict::With;
        self.moved = if is_apart { 0.0 } else { moves.with / WITH };
        if self.moved >= 1.0 {
            self.proof = Proof::Proven;
            self.pieces.settle();
        }
    }

    /// Notes why a frame is no proof, while there is none.
    fn note(&mut self, why: Unproven) {
        if self.proof == Proof::Waiting {
            self.why = why;
            self.causes[why as usize] += 1;
        }
    }

    /// Why the proof failed: what bars it for good, or the cause of most frames.
    fn failed_by(&self) -> Unproven {
        if matches!(self.why, Unproven::Mixed | Unproven::PieceApart) {
            return self.why;
        }
        let causes = Unproven::ALL.iter().map(|(_, cause)| *cause);
        causes.max_by_key(|cause| self.causes[*cause as usize]).unwrap_or(Unproven::None)
    }

    /// Notes that it is `time`, ns, whatever the frame shows: the time for the proof may be over.
    pub fn pass(&mut self, time: u64) {
        let is_over = self.since.is_some_and(|since| time.saturating_sub(since) > PROOF_TIME);
        if self.proof == Proof::Waiting && is_over {
            self.why = self.failed_by();
            self.proof = Proof::Failed;
            self.pieces.settle();
        }
    }

    /// The middle of each piece of the reference, m, and what is known of it.
    pub fn pieces(&self) -> impl ExactSizeIterator<Item = (Vector3<f64>, Known)> {
        self.pieces.known()
    }

    /// Whether the parts were seen to move together. A frame of other cameras than those with which they were is not proven:
    /// how many points these see of the head was measured without a proof.
    #[must_use]
    pub fn proof(&self) -> Proof {
        match self.proof {
            Proof::Proven if !self.is_of_proven => Proof::Waiting,
            proof => proof,
        }
    }

    /// Why there is no proof: of the newest frame that was judged, or what failed the proof.
    #[must_use]
    pub fn unproven(&self) -> Unproven {
        match self.proof {
            Proof::Proven if self.is_of_proven => Unproven::None,
            Proof::Proven => Unproven::OtherCameras,
            _ => self.why,
        }
    }

    /// Share of the points in pieces that were seen to move with the rest, over the share that proves the head; zero while
    /// too many lie in pieces that were seen not to, if one has moved against the rest, and unless all patches are seen to
    /// move alike. Of the last frame before the proof was complete or failed.
    #[must_use]
    pub fn moved(&self) -> f64 {
        self.moved
    }
}

/// 1 at zero, 0.5 at the limit, 0 at twice the limit and for NaN.
fn below(value: f64, limit: f64) -> f64 {
    let certainty = 1.0 - 0.5 * value / limit;
    if certainty.is_nan() { 0.0 } else { certainty.clamp(0.0, 1.0) }
}
