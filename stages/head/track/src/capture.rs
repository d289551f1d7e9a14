//! When a face becomes the reference, and of how many frames one is made.

use nalgebra::{Isometry3, Vector3};
use thiserror::Error;

use crate::observability::Observability;
use crate::planned::{Foreign, Planned};
use crate::sightings::{Sightings, middle};
use crate::surface::SurfaceError;
use crate::tracker::HeadTracker;

/// Why a face did not become the reference. The one before stays, and the next face is tried.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CaptureError {
    /// It has too few points.
    #[error("the face has {found} points, a reference needs {needed}")]
    TooFewPoints {
        /// Finite points.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// It makes no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Too few of the last frames show a face where it lies.
    #[error("the last frames show {seen} faces at its place, a capture needs {needed}")]
    Unsteady {
        /// Faces at its place.
        seen: usize,
        /// Faces needed.
        needed: usize,
    },
    /// A capture was asked for longer ago than it holds. It has to be asked for again.
    #[error("no face became the reference within {} ms of the command", .within / 1_000_000)]
    Lapsed {
        /// How long a command holds, ns.
        within: u64,
    },
    /// Its surface does not hold every direction of a movement.
    #[error("the face holds {} of 6 directions of a movement: too little of the head is seen, or it is round like a ball", .0.constrained)]
    Loose(Box<Observability>),
    /// It is not the patient of the known surface.
    #[error(transparent)]
    Foreign(#[from] Foreign),
}

/// What an offered face was needed for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Offer {
    /// It became the reference, or the first frame of one.
    Taken,
    /// None was awaited.
    NotAwaited,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    /// The next face is to be the reference.
    Awaited,
    /// A person has asked for a reference; with the time of the first frame since, ns.
    Asked(Option<u64>),
    /// So many frames are still to be added to it.
    Gathering(u32),
    /// It is complete and has not been sent.
    Complete,
}

/// When a face is taken that a person has asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Asking {
    /// So many of the last frames, with it, show a face where it lies.
    pub seen: usize,
    /// For so long from the first frame after it a command holds, ns.
    pub within: u64,
}

/// Makes references. The first frame is one at once; those that follow are brought onto it and make its surface finer.
#[derive(Debug, Clone)]
pub struct Capture {
    frames: u32,
    most: usize,
    needs_all: bool,
    asking: Asking,
    sightings: Sightings,
    state: State,
    /// Frames behind the surface; 0 where it is known without one.
    behind: u32,
    number: u32,
    cloud: Vec<Vector3<f64>>,
    centroid: Vector3<f64>,
    centre: Vector3<f64>,
}

impl Capture {
    /// References of `frames` frames and at most `most` points. If it `needs_all` directions, a face whose surface does not
    /// hold each of the six directions of a movement is refused.
    #[must_use]
    pub fn new(frames: u32, most: usize, needs_all: bool, asking: Asking) -> Self {
        let nowhere = Vector3::zeros();
        Self {
            frames: frames.max(1),
            most,
            needs_all,
            asking,
            sightings: Sightings::default(),
            state: State::Idle,
            behind: 0,
            number: 0,
            cloud: Vec::new(),
            centroid: nowhere,
            centre: nowhere,
        }
    }

    /// The next face that is fit for it becomes the reference.
    pub fn take_next(&mut self) {
        self.state = State::Awaited;
    }

    /// A person asks for a reference: a face becomes it that is fit for it and was seen in the frames before. What comes
    /// later than the command holds has to be asked for again.
    pub fn command(&mut self) {
        self.state = State::Asked(None);
    }

    /// Notes what a new frame shows: the points of its face, m, if it has one. A frame that is the one before again is none.
    pub fn note(&mut self, face: Option<&[Vector3<f64>]>) {
        self.sightings.note(face.and_then(middle));
    }

    /// A frame was acquired at `time`, ns.
    ///
    /// # Errors
    /// A command lapsed with this frame, which is told once.
    pub fn pass(&mut self, time: u64) -> Result<(), CaptureError> {
        let State::Asked(first) = &mut self.state else { return Ok(()) };
        let within = self.asking.within;
        if time.saturating_sub(*first.get_or_insert(time)) < within {
            return Ok(());
        }
        self.state = State::Idle;
        Err(CaptureError::Lapsed { within })
    }

    /// Starts with a reference from elsewhere, in the frame of the faces. Where the head is, a search finds.
    ///
    /// # Errors
    /// A cloud that makes no reference.
    pub fn start_with(
        &mut self,
        tracker: &mut HeadTracker,
        cloud: Vec<Vector3<f64>>,
    ) -> Result<(), SurfaceError> {
        self.cloud = cloud;
        thin(&mut self.cloud, self.most);
        tracker.capture(&self.cloud, 0)?;
        tracker.lose();
        self.settle(tracker);
        self.behind = 1;
        self.state = State::Complete;
        Ok(())
    }

    /// Offers a face (m, finite, seen from the origin), acquired at `time`, ns.
    ///
    /// # Errors
    /// Why a face that was awaited did not become the reference.
    pub fn offer(
        &mut self,
        tracker: &mut HeadTracker,
        cloud: &[Vector3<f64>],
        time: u64,
        needed: usize,
    ) -> Result<Offer, CaptureError> {
        if !self.awaits() {
            return Ok(Offer::NotAwaited);
        }
        if cloud.len() < needed {
            return Err(CaptureError::TooFewPoints { found: cloud.len(), needed });
        }
        if let State::Asked(_) = self.state {
            let seen = middle(cloud).map_or(0, |place| self.sightings.at(&place));
            let needed = self.asking.seen;
            if seen < needed {
                return Err(CaptureError::Unsteady { seen, needed });
            }
        }
        let surface = tracker.surface_of(cloud)?;
        let observability = tracker.observability(&surface, cloud);
        if self.needs_all && !tracker.is_held(&observability) {
            return Err(CaptureError::Loose(Box::new(observability)));
        }
        tracker.capture_surface(surface, cloud, time);
        self.settle(tracker);
        self.behind = 1;
        self.cloud.clear();
        self.cloud.extend(cloud.iter().filter(|p| tracker.is_head(p)));
        thin(&mut self.cloud, self.most / self.frames as usize);
        self.state = if self.frames > 1 { State::Gathering(self.frames) } else { State::Complete };
        Ok(Offer::Taken)
    }

    /// Offers a face, as [`offer`](Self::offer), that has to show a known surface: what the camera sees of the surface
    /// becomes the reference. Returns where the surface is, in the frame of the face.
    ///
    /// # Errors
    /// Why a face that was awaited did not become the reference.
    pub fn offer_known(
        &mut self,
        tracker: &mut HeadTracker,
        known: &Planned,
        cloud: &[Vector3<f64>],
        time: u64,
        needed: usize,
    ) -> Result<Option<Isometry3<f64>>, CaptureError> {
        if !self.awaits() {
            return Ok(None);
        }
        if cloud.len() < needed {
            return Err(CaptureError::TooFewPoints { found: cloud.len(), needed });
        }
        let found = known.register(cloud)?;
        tracker.capture(&found.seen, time)?;
        self.settle(tracker);
        self.behind = 0;
        self.cloud = found.seen;
        self.cloud.retain(|p| tracker.is_head(p));
        thin(&mut self.cloud, self.most);
        self.state = State::Complete;
        Ok(Some(found.camera_from_model))
    }

    /// Adds a face that was tracked, if the reference is to have more frames. The first face itself counts as one. Says
    /// whether that changed the surface.
    pub fn add(
        &mut self,
        tracker: &mut HeadTracker,
        cloud: &[Vector3<f64>],
        current_from_reference: &Isometry3<f64>,
    ) -> bool {
        let State::Gathering(left) = self.state else { return false };
        if left < self.frames {
            let most = self.most / self.frames as usize;
            let count = cloud.len().min(most);
            let back = current_from_reference.inverse();
            let picked = (0..count).map(|k| &cloud[k * cloud.len() / count]);
            let moved = picked.map(|p| (back * nalgebra::Point3::from(*p)).coords);
            self.cloud.extend(moved.filter(|p| tracker.is_head(p)));
        }
        self.state = State::Gathering(left - 1);
        if left == 1 {
            // A surface of more points can fail only where that of the first frame fails; then that one stays.
            if tracker.refine(&self.cloud).is_ok() {
                self.behind = self.frames;
            }
            self.state = State::Complete;
        }
        left == 1
    }

    /// The points of a reference that has become complete, once.
    pub fn completed(&mut self) -> Option<&[Vector3<f64>]> {
        if self.state != State::Complete {
            return None;
        }
        self.state = State::Idle;
        Some(&self.cloud)
    }

    /// Number of the reference, from 1; 0 where there is none.
    #[must_use]
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Variance of the reference's error over that of a frame: the surface of so many frames errs by the noise of their
    /// mean. A surface of the planning CT has none of this noise.
    #[must_use]
    pub fn variance(&self) -> f64 {
        if self.behind == 0 { 0.0 } else { 1.0 / f64::from(self.behind) }
    }

    /// Mean of the points of the reference's first frame, m.
    #[must_use]
    pub fn centroid(&self) -> Vector3<f64> {
        self.centroid
    }

    /// The point nearest to the normals of the reference's first frame, m.
    #[must_use]
    pub fn centre(&self) -> Vector3<f64> {
        self.centre
    }

    fn awaits(&self) -> bool {
        matches!(self.state, State::Awaited | State::Asked(_))
    }

    fn settle(&mut self, tracker: &HeadTracker) {
        self.number += 1;
        if let Some(surface) = tracker.surface() {
            (self.centroid, self.centre) = (surface.centroid(), surface.centre());
        }
    }
}

/// Keeps at most `most` points, spread evenly.
fn thin(cloud: &mut Vec<Vector3<f64>>, most: usize) {
    let all = cloud.len();
    if all > most {
        for k in 0..most {
            cloud[k] = cloud[k * all / most];
        }
        cloud.truncate(most);
    }
}
