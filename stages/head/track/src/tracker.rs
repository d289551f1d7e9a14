//! Follows a head against a reference surface, frame by frame.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use thiserror::Error;

use crate::align::{AlignParams, Aligner, Alignment, Effort, Robust, misfit};
use crate::movable::Movable;
use crate::observability::Observability;
use crate::quaternion::{PairedPose, pose_of_pairs};
use crate::search::{best_start, onto_centroid, search};
use crate::surface::{Surface, SurfaceError, SurfaceParams};
use crate::three_points::{ThreePoints, same_three_points, three_points};

/// The first iterations use few points, the next ones more, and the last ones, of which mostly one is needed, all that
/// are asked for.
const ROUGH: Effort = Effort { points: 1000, iterations: 30, step: 0.05, scale: 5e-3, robust: Robust::Huber };
const NEARER: Effort = Effort { points: 2000, iterations: 15, step: 0.02, scale: 0.0, robust: Robust::Tukey };
const FINE_ITERATIONS: u32 = 15;
/// The error that a step leaves is far smaller than the step.
const FINE_STEP: f64 = 0.03;
/// A fit whose distances scatter this many times more than the last one's, or whose overlap is this much smaller, may
/// be the wrong one: another is looked for.
const WORSE_SCATTER: f64 = 1.3;
const WORSE_OVERLAP: f64 = 0.04;
/// Points by which two fits are compared.
const JUDGED: usize = 2000;
/// Points within this distance of where the surface is expected may be the head's, m.
const EXPECTED: f64 = 0.01;

/// How a head is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackParams {
    /// How the reference becomes a surface.
    pub surface: SurfaceParams,
    /// How frames are aligned with it.
    pub align: AlignParams,
    /// Points of a frame that are used at most.
    pub points: usize,
    /// Points that a frame needs.
    pub min_points: usize,
    /// Part of a frame's points that must lie on the reference.
    pub min_overlap: f64,
}

impl Default for TrackParams {
    /// The defaults of `track.head`: a head of any size, seen from 0.5 to 1 m.
    fn default() -> Self {
        Self {
            surface: SurfaceParams { spacing: 0.004, smoothing: 0.008 },
            align: AlignParams { tolerance: 0.005, least_sensitivity: 0.005 },
            points: 6000,
            min_points: 500,
            min_overlap: 0.5,
        }
    }
}

/// How a pose was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseSource {
    /// From the last pose.
    Tracked,
    /// By a search, after a loss.
    Found,
}

/// The pose of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedPose {
    /// The head's motion since the capture, in the camera's frame.
    pub current_from_reference: Isometry3<f64>,
    /// The fit.
    pub alignment: Alignment,
    /// How it was found.
    pub source: PoseSource,
}

/// Why a frame has no pose.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Loss {
    /// No reference was captured.
    #[error("there is no reference: capture one")]
    NoReference,
    /// The frame has too few points.
    #[error("the frame has {found} points, a pose needs {needed}")]
    TooFewPoints {
        /// Finite points of the frame.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// The frame lies elsewhere than the reference wherever it is turned.
    #[error("{:.0} % of the frame match the reference (required: {:.0} %)", 100.0 * alignment.overlap, 100.0 * needed)]
    NoFit {
        /// The best fit.
        alignment: Box<Alignment>,
        /// Part of the points that must lie on the reference.
        needed: f64,
    },
}

/// A reference, and where the head was last.
struct Reference {
    surface: Surface,
    three: Option<ThreePoints>,
    /// Into the surface's coordinates, at the last frame with a pose, and the time of that frame, ns.
    last: (Isometry3<f64>, u64),
    /// The same of the frame before it.
    before: Option<(Isometry3<f64>, u64)>,
    lost: bool,
    /// Scatter (m) and overlap of the last fit.
    fit: Option<(f64, f64)>,
}

/// Follows a head.
pub struct HeadTracker {
    params: TrackParams,
    /// Into the axes of the couch, where they are known.
    couch_from_face: Option<UnitQuaternion<f64>>,
    aligner: Aligner,
    reference: Option<Reference>,
}

impl Default for HeadTracker {
    /// A tracker without a reference, with the defaults of `track.head`.
    fn default() -> Self {
        Self::new(TrackParams::default())
    }
}

impl HeadTracker {
    /// A tracker without a reference.
    #[must_use]
    pub fn new(params: TrackParams) -> Self {
        Self { params, couch_from_face: None, aligner: Aligner::default(), reference: None }
    }

    /// Says how the axes of the clouds are turned into those of the couch: then the parts of a face are found by their place.
    pub fn lies_on(&mut self, couch_from_face: UnitQuaternion<f64>) {
        self.couch_from_face = Some(couch_from_face);
    }

    /// Makes a cloud (m, finite, seen from the origin) the reference. `time` is its acquisition, ns.
    ///
    /// # Errors
    /// A cloud that makes no reference; the one before stays.
    pub fn capture(&mut self, cloud: &[Vector3<f64>], time: u64) -> Result<(), SurfaceError> {
        let surface = self.surface_of(cloud)?;
        self.capture_surface(surface, cloud, time);
        Ok(())
    }

    /// The surface of a cloud (m, finite, seen from the origin), as a capture makes it.
    ///
    /// # Errors
    /// A cloud that makes no reference.
    pub fn surface_of(&self, cloud: &[Vector3<f64>]) -> Result<Surface, SurfaceError> {
        let whole = Surface::new(cloud, &self.params.surface)?;
        let Some(couch_from_face) = &self.couch_from_face else { return Ok(whole) };
        let Some(movable) = Movable::on(&whole, couch_from_face) else { return Ok(whole) };
        let (normal, begins) = movable.neck();
        let is_head = |p: &&Vector3<f64>| normal.dot(&(*p - whole.centre())) <= begins;
        let head: Vec<Vector3<f64>> = cloud.iter().filter(is_head).copied().collect();
        let Ok(mut surface) = Surface::new(&head, &self.params.surface) else { return Ok(whole) };
        surface.part_of(whole.whole());
        surface.lay(&movable.about(&(surface.centre() - whole.centre())));
        Ok(surface)
    }

    /// The directions that a surface holds, as the cloud (m) from which it was made shows it.
    pub fn observability(&mut self, surface: &Surface, cloud: &[Vector3<f64>]) -> Observability {
        let start = Isometry3::from(-surface.centre());
        let effort = Effort { points: self.params.points, iterations: 1, ..ROUGH };
        self.aligner.align(surface, cloud, &start, &self.params.align, &effort).observability
    }

    /// Whether a head that is captured with this observability is held: none of the six directions is as free as a
    /// turn of a ball, and noise hides at most one of them.
    #[must_use]
    pub fn is_held(&self, observability: &Observability) -> bool {
        let least = self.params.align.least_sensitivity;
        observability.constrained >= 5 && observability.sensitivity.iter().all(|s| *s >= least)
    }

    /// Makes a surface the reference, and the cloud (m) from which it was made. `time` is its acquisition, ns.
    pub fn capture_surface(&mut self, surface: Surface, cloud: &[Vector3<f64>], time: u64) {
        let identity = Isometry3::from(-surface.centre());
        self.reference = Some(Reference {
            three: three_points(cloud),
            surface,
            last: (identity, time),
            before: None,
            lost: false,
            fit: None,
        });
    }

    /// Puts the surface of a larger cloud, in the frame of the capture, in the reference's place; the pose stays.
    ///
    /// # Errors
    /// A cloud that makes no reference; the one before stays.
    pub fn refine(&mut self, cloud: &[Vector3<f64>]) -> Result<(), SurfaceError> {
        if self.reference.is_none() {
            return Ok(());
        }
        let mut surface = self.surface_of(cloud)?;
        let Some(reference) = &mut self.reference else { return Ok(()) };
        surface.part_of(reference.surface.whole());
        let shift = Translation3::from(reference.surface.centre() - surface.centre());
        reference.last.0 = shift * reference.last.0;
        reference.before = None;
        reference.surface = surface;
        Ok(())
    }

    /// Forgets where the head is: the next frame is searched for it.
    pub fn lose(&mut self) {
        if let Some(reference) = &mut self.reference {
            reference.lost = true;
        }
    }

    /// The dissertation's three points of the reference, m.
    #[must_use]
    pub fn three_points_of_reference(&self) -> Option<[Vector3<f64>; 3]> {
        self.reference.as_ref()?.three.map(|three| three.points)
    }

    /// Whether a place of the capture, m, is not below the line from chin to occiput.
    #[must_use]
    pub fn is_head(&self, place: &Vector3<f64>) -> bool {
        self.surface().is_none_or(|surface| !surface.is_neck(&(place - surface.centre())))
    }

    /// The reference surface.
    #[must_use]
    pub fn surface(&self) -> Option<&Surface> {
        self.reference.as_ref().map(|r| &r.surface)
    }

    /// The pose of a frame (m, finite, seen from the origin) acquired at `time`, ns.
    ///
    /// # Errors
    /// Why there is none. The next frame is searched for the head.
    pub fn track(&mut self, cloud: &[Vector3<f64>], time: u64) -> Result<TrackedPose, Loss> {
        let Self { params, aligner, reference, .. } = self;
        let reference = reference.as_mut().ok_or(Loss::NoReference)?;
        let Some(centroid) = mean(cloud).filter(|_| cloud.len() >= params.min_points) else {
            reference.lost = true;
            return Err(Loss::TooFewPoints { found: cloud.len(), needed: params.min_points });
        };
        let follow = |start: Isometry3<f64>, aligner: &mut Aligner| {
            settled(aligner, &reference.surface, cloud, &start, params)
        };
        let near = if reference.lost { None } else { reference.near(cloud, &centroid, time) };
        let tracked = near.map(|start| follow(start, aligner));
        let fits = |alignment: &Alignment| alignment.overlap >= params.min_overlap;
        if let Some(alignment) = tracked.filter(|a| fits(a) && !reference.is_worse(a)) {
            return Ok(reference.accept(alignment, time, PoseSource::Tracked));
        }
        let rotations = [reference.last.0.rotation, UnitQuaternion::identity()];
        let start = search(aligner, &reference.surface, cloud, &centroid, &rotations, &params.align);
        let found = follow(start, aligner);
        let cost = |a: &Alignment| {
            misfit(&reference.surface, cloud, &a.surface_from_cloud, params.align.tolerance, JUDGED)
        };
        let (best, source) = match tracked {
            Some(alignment) if cost(&alignment) <= cost(&found) => (alignment, PoseSource::Tracked),
            _ => (found, PoseSource::Found),
        };
        if fits(&best) {
            return Ok(reference.accept(best, time, source));
        }
        reference.lost = true;
        Err(Loss::NoFit { alignment: Box::new(best), needed: params.min_overlap })
    }

    /// Takes the points of a whole frame (m, seen from the origin) that lie where the surface is expected at `time`, ns.
    pub fn expected(
        &self,
        frame: impl Iterator<Item = Vector3<f64>>,
        time: u64,
        points: &mut Vec<Vector3<f64>>,
    ) {
        points.clear();
        let Some(reference) = &self.reference else { return };
        let pose = reference.predicted(time).unwrap_or(reference.last.0);
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let reach = reference.surface.reach() + EXPECTED;
        let is_expected = |point: &Vector3<f64>| {
            let at = rotation * point + pose.translation.vector;
            at.norm_squared() < reach * reach
                && reference
                    .surface
                    .partner(&at)
                    .is_some_and(|p| p.over && p.sightline.distance.abs() < EXPECTED)
        };
        points.extend(frame.filter(is_expected));
    }

    /// The pose of such points. `None` where less than `least` of the reference lies under them: nothing is searched, and
    /// where the head was last stays known.
    pub fn follow(&mut self, points: &[Vector3<f64>], time: u64, least: f64) -> Option<TrackedPose> {
        let Self { params, aligner, reference, .. } = self;
        let reference = reference.as_mut()?;
        let centroid = mean(points).filter(|_| points.len() >= params.min_points)?;
        let start = reference.near(points, &centroid, time)?;
        let alignment = settled(aligner, &reference.surface, points, &start, params);
        (alignment.overlap >= least).then(|| reference.accept(alignment, time, PoseSource::Tracked))
    }

    /// The motion since the capture by the dissertation's three points, in the camera's frame. `None` without a
    /// reference, or where the points are not found or determine no rotation.
    pub fn three_points(&self, cloud: &[Vector3<f64>]) -> Option<PairedPose> {
        let model = self.reference.as_ref()?.three?;
        let measured = same_three_points(cloud, &model.axes)?;
        pose_of_pairs(&measured.points, &model.points).ok()
    }
}

/// Where a cloud settles on a surface, from a start: roughly, nearer, and finely.
fn settled(
    aligner: &mut Aligner,
    surface: &Surface,
    cloud: &[Vector3<f64>],
    start: &Isometry3<f64>,
    params: &TrackParams,
) -> Alignment {
    let fine = Effort {
        points: params.points,
        iterations: FINE_ITERATIONS,
        step: FINE_STEP,
        scale: 0.0,
        robust: Robust::Tukey,
    };
    let rough = aligner.approach(surface, cloud, start, &params.align, &ROUGH);
    let effort = Effort { scale: rough.sd, ..NEARER };
    let nearer = aligner.approach(surface, cloud, &rough.surface_from_cloud, &params.align, &effort);
    let effort = Effort { scale: nearer.sd, ..fine };
    let mut found = aligner.align(surface, cloud, &nearer.surface_from_cloud, &params.align, &effort);
    found.iterations += rough.iterations + nearer.iterations;
    found
}

impl Reference {
    /// The best start near the last pose: there, moved on, or with the centroids on each other.
    fn near(&self, cloud: &[Vector3<f64>], centroid: &Vector3<f64>, time: u64) -> Option<Isometry3<f64>> {
        let last = self.last.0;
        let centred = onto_centroid(&self.surface, centroid, &last.rotation);
        let starts = [Some(last), self.predicted(time), Some(centred)];
        best_start(&self.surface, cloud, starts.into_iter().flatten())
    }

    /// Whether a fit is so much worse than the last one that it may be the wrong one.
    fn is_worse(&self, alignment: &Alignment) -> bool {
        self.fit.is_some_and(|(sd, overlap)| {
            alignment.sd > WORSE_SCATTER * sd || alignment.overlap < overlap - WORSE_OVERLAP
        })
    }

    fn accept(&mut self, alignment: Alignment, time: u64, source: PoseSource) -> TrackedPose {
        self.before = (source == PoseSource::Tracked).then_some(self.last);
        self.last = (alignment.surface_from_cloud, time);
        self.fit = Some((alignment.sd, alignment.overlap));
        self.lost = false;
        let surface_from_reference = Translation3::from(-self.surface.centre());
        let current_from_reference = alignment.surface_from_cloud.inverse() * surface_from_reference;
        TrackedPose { current_from_reference, alignment, source }
    }

    /// Where the head would be at `time` had it moved on as between the last two frames.
    fn predicted(&self, time: u64) -> Option<Isometry3<f64>> {
        let (before, then) = self.before?;
        let (last, since) = self.last;
        let step = since.checked_sub(then).filter(|ns| *ns > 0)?;
        let part = time.checked_sub(since)? as f64 / step as f64;
        // Farther than two steps ahead it is a guess.
        let part = part.min(2.0);
        let motion = last * before.inverse();
        let moved = Isometry3::from_parts(
            Translation3::from(motion.translation.vector * part),
            UnitQuaternion::from_scaled_axis(motion.rotation.scaled_axis() * part),
        );
        Some(moved * last)
    }
}

fn mean(cloud: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let first = cloud.first()?;
    let sum: Vector3<f64> = cloud.iter().map(|p| p - first).sum();
    Some(first + sum / cloud.len() as f64)
}
