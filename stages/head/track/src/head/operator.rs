//! `track.head` as an operator.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, Vector3};
use stillpoint_operator::{Activation, Operator, Outputs, Setup};
use stillpoint_operator::{FrameRule, Input, Kind, Output, Policy, Role, SetupError, StepError, Timer};
use stillpoint_patient::outline::read_surface;
use stillpoint_samples::{
    CloudShape, ConsoleCommand, Health, Point, PointCloud, Pose, PoseElement, PoseReport, PoseReportElement,
    PoseStatus, Proof, Rejection, Sample, SurfacePieces, Unproven, Verb,
};

use super::camera_sets::CameraSets;
use super::params::{
    CaptureBy, Confirm, Directions, HeadParams, Method, Origin, Reference, ReferenceParams, SendPieces,
    SoftTissue,
};
use super::{pieces, report};
use crate::capture::{Asking, Capture, CaptureError, Offer};
use crate::identity::{ENOUGH, Identity, Needed, SeenFrame};
use crate::output_frame::output_from_face;
use crate::planned::{Limits, Planned};
use crate::quaternion::PairedPose;
use crate::surface::Surface;
use crate::tracker::{HeadTracker, Loss, TrackedPose};
use crate::uncertainty::{Uncertainty, of_three_points};

/// The frame in whose axes a patient lies.
const COUCH: &str = "couch";
const FACE: usize = 0;
const COMMAND: usize = 1;
const REJECTION: usize = 2;
const CONFIRM: usize = 3;
const FRAME: usize = 4;
const CAMERAS: usize = 5;
const POSE: usize = 0;
const THREE_POINTS: usize = 1;
const REFERENCE: usize = 2;
const REPORT: usize = 3;
const PIECES: usize = 4;
/// A head that is not cut out is followed where it is expected, for at most so long after it was cut out, ns.
const FOLLOWED: u64 = 10_000_000_000;
/// Part of the overlap that a pose needs otherwise, where an arm may hide the rest: the beam is off.
const FOLLOWED_OVERLAP: f64 = 0.7;
/// Less of the reference under the points, over the least that a pose needs, and the head was hardly cut out.
const HARDLY: f64 = 0.1;

/// Sends the pose of each face against the reference, and a report on each.
///
/// The face of the frame before again, to the bit, has the same pose and report, as long as the reference is the same: so
/// filters see that a camera is frozen.
///
/// The head's frame is that of the capture: its axes are those of the pose's frame, its origin is `origin`. So the pose
/// at the capture is a translation, and a pose's rotation is the head's since. The pose is that of `point`, a place in
/// this frame: all that follows judges there, the gate too.
///
/// With `reference: { surface: FILE }` the head's frame is that of the plan: its origin is the isocentre, its axes are those
/// of the couch in the planned position. So a pose is the absolute set-up error: its position less `isocentre`, and its
/// rotation.
pub struct TrackHead {
    method: Method,
    sends_pieces: bool,
    origin: Origin,
    /// Whose pose is sent, in the head's frame, m.
    point: Translation3<f64>,
    three_points_sd: f64,
    min_points: usize,
    tracker: HeadTracker,
    capture: Capture,
    /// The surface of the planning CT.
    known: Option<Planned>,
    /// Of a known surface: where the isocentre and the axes of the couch that belong to it were in the reference, in the
    /// face's frame.
    face_from_head: Option<Isometry3<f64>>,
    confirm: Confirm,
    /// Number of the reference that a person has confirmed.
    confirmed: u32,
    /// Of the reference of that number.
    identity: Option<(u32, Identity)>,
    min_overlap: f64,
    tolerance: f64,
    /// From the face's frame into that of the pose.
    output_from_face: Isometry3<f64>,
    /// The finite points of the frame, and of the one before.
    cloud: Vec<Vector3<f64>>,
    before: Vec<Vector3<f64>>,
    /// The points of a whole frame that lie where the head is expected.
    near: Vec<Vector3<f64>>,
    /// The cameras of the newest frames.
    cameras: CameraSets,
    /// When the head was last cut out and had a pose, ns.
    cut_out: Option<u64>,
    /// What was found in the frame before, against the reference that there is.
    found: Option<Found>,
}

/// How points came to be the head's.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Cut {
    /// They were cut out of the frame.
    Out,
    /// They lie where the head was expected.
    Expected,
}

/// What was found in a frame.
struct Found {
    tracked: Result<TrackedPose, Loss>,
    dense: Option<PoseElement>,
    three_points: Option<PoseElement>,
    report: PoseReportElement,
    /// The frame fits the reference, and the checks of its identity fail.
    doubted: bool,
    /// The face moves: its skull has the pose, or the face is why it has none.
    is_face: bool,
    /// The pose is that of the points where the head was expected.
    is_followed: bool,
}

impl Operator for TrackHead {
    type Params = HeadParams;
    const KIND: Kind = Kind {
        name: "track.head",
        about: "Measures the pose of a head against a captured reference, with the directions that the surface constrains.",
        role: Role::Operator,
        inputs: &[
            Input {
                name: "face",
                sample: PointCloud::KIND,
                policy: Policy::Queue(1),
                required: true,
                about: "The points of the face, seen from the origin of their frame.",
            },
            Input {
                name: "command",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(8),
                required: false,
                about: "`capture` makes the next face the reference that is fit for it; other commands are ignored.",
            },
            Input {
                name: "rejection",
                sample: Rejection::KIND,
                policy: Policy::Queue(1),
                required: false,
                about: "Frames without a face: each causes a report. If it is not connected, such frames cause no report.",
            },
            Input {
                name: "confirm",
                sample: ConsoleCommand::KIND,
                policy: Policy::Queue(8),
                required: false,
                about: "`confirm` says that the present reference shows the head: a person has looked. Another reference needs another.",
            },
            Input {
                name: "cloud",
                sample: PointCloud::KIND,
                policy: Policy::Latest,
                required: false,
                about: "The points of the whole frame, in the frame of `face`. If it is connected, a head that is not cut out, behind an arm for example, is followed where it is expected.",
            },
            Input {
                name: "cameras",
                sample: Health::KIND,
                policy: Policy::Latest,
                required: false,
                about: "Which cameras each frame is of, from `ingest.merge`: a camera that is left out takes its points with it, which does not cast doubt on the rest.",
            },
        ],
        outputs: &[
            Output {
                name: "pose",
                sample: Pose::KIND,
                frame: FrameRule::KeyOr("face"),
                about: "The pose of the head, couch_from_head; no sample if the head is lost.",
            },
            Output {
                name: "three_points",
                sample: Pose::KIND,
                frame: FrameRule::KeyOr("face"),
                about: "The pose by three points and the quaternion of their cross-covariance.",
            },
            Output {
                name: "reference",
                sample: PointCloud::KIND,
                frame: FrameRule::SameAs("face"),
                about: "The reference, sent once when it is complete.",
            },
            Output {
                name: "report",
                sample: PoseReport::KIND,
                frame: FrameRule::KeyOr("face"),
                about: "For each frame: how the pose was found or why there is none, its fit, and the directions that the surface constrains.",
            },
            Output {
                name: "pieces",
                sample: SurfacePieces::KIND,
                frame: FrameRule::SameAs("face"),
                about: "For each frame that was found on the reference: where its pieces are, and whether each still moves with the rest.",
            },
        ],
        timer: Timer::No,
    };

    fn new(params: HeadParams, setup: &Setup<'_>) -> Result<Self, SetupError> {
        let (start, surface) = match &params.reference {
            None => (None, None),
            Some(Reference::Cloud(name)) => (Some(name), None),
            Some(Reference::Given(given)) => match (&given.cloud, &given.surface) {
                (Some(name), None) => (Some(name), None),
                (None, Some(name)) => (None, Some((name, given))),
                _ => return Err(SetupError("`reference` needs one of `cloud` and `surface`".into())),
            },
        };
        let awaited = params.capture == CaptureBy::Command && start.is_none();
        if awaited && !setup.is_connected(COMMAND) {
            return Err(SetupError(
                "no command can reach it: connect `command`, name a `reference`, or say `capture: first`"
                    .into(),
            ));
        }
        let output_from_face = stillpoint_pose::of_frame(&output_from_face(setup)?);
        let known = match surface {
            Some((name, given)) => Some(known(name, given, &params, &output_from_face, setup)?),
            None => None,
        };
        let mut tracker = HeadTracker::new(params.tracking());
        let frame_of = |port: usize| setup.input_frames.get(port).and_then(Option::as_deref);
        let face_frame = frame_of(FACE);
        if setup.is_connected(FRAME) && frame_of(FRAME) != face_frame {
            return Err(SetupError(format!(
                "`cloud` is in the frame {}, `face` in {}: connect the cloud of which the face is a part",
                frame_of(FRAME).unwrap_or("(none)"),
                face_frame.unwrap_or("(none)")
            )));
        }
        if params.soft_tissue == SoftTissue::Weighted
            && let Some(couch_from_face) = face_frame.and_then(|frame| setup.transform(COUCH, frame))
        {
            tracker.lies_on(stillpoint_pose::of_frame(&couch_from_face).rotation);
        }
        let mut capture = Capture::new(
            params.capture_frames,
            params.max_points as usize,
            params.directions == Directions::All,
            Asking { seen: params.capture_seen as usize, within: params.capture_within },
        );
        match start {
            Some(name) => {
                let cloud = reference_file(name, setup)?;
                capture.start_with(&mut tracker, cloud).map_err(|e| SetupError(format!("{name}: {e}")))?;
            }
            None if params.capture == CaptureBy::First => capture.take_next(),
            None => {}
        }
        Ok(Self {
            method: params.method,
            sends_pieces: params.pieces == SendPieces::Sent,
            origin: params.origin,
            point: Translation3::from(params.point),
            three_points_sd: params.three_points_sd,
            min_points: params.min_points as usize,
            tracker,
            capture,
            known,
            face_from_head: None,
            confirm: params.confirm,
            confirmed: 0,
            identity: None,
            min_overlap: params.min_overlap,
            tolerance: params.tolerance,
            output_from_face,
            cloud: Vec::new(),
            before: Vec::new(),
            near: Vec::new(),
            cameras: CameraSets::default(),
            cut_out: None,
            found: None,
        })
    }

    fn capacities(params: &HeadParams) -> Vec<usize> {
        vec![1, 1, params.max_points as usize, 1, pieces::MOST]
    }

    fn step(&mut self, activation: &Activation<'_>, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        if let Some(cameras) = activation.fresh::<Health>(CAMERAS) {
            self.cameras.note(cameras.header.origin, cameras.elements);
        }
        if let Some(command) = activation.fresh::<ConsoleCommand>(COMMAND)
            && command.first().is_some_and(|c| c.verb == Verb::Capture as u32)
        {
            match self.known {
                // The surface itself says whose face it is.
                Some(_) => self.capture.take_next(),
                None => self.capture.command(),
            }
        }
        if let Some(command) = activation.fresh::<ConsoleCommand>(CONFIRM)
            && command.first().is_some_and(|c| c.verb == Verb::Confirm as u32)
        {
            self.confirmed = self.capture.number();
        }
        if let Some(rejection) = activation.fresh::<Rejection>(REJECTION) {
            if let Some((_, identity)) = &mut self.identity {
                identity.pass(rejection.header.origin);
            }
            self.capture.note(None);
            let standing = self.capture.pass(rejection.header.origin);
            if standing.is_ok()
                && let Some(found) = self.followed(activation, rejection.header.origin)
            {
                return self.send_followed(found, outputs);
            }
            // Where the head was last stays the best guess of where it is.
            let report = self.without_a_face();
            let report = if standing.is_err() { report::of_lapsed(report) } else { report };
            return outputs.send::<PoseReport>(REPORT, &report);
        }
        let Some(face) = activation.fresh::<PointCloud>(FACE) else { return Ok(()) };
        let finite = |p: &&Point| p.xyz.iter().all(|c| c.is_finite());
        std::mem::swap(&mut self.cloud, &mut self.before);
        self.cloud.clear();
        self.cloud.extend(face.elements.iter().filter(finite).map(|p| Vector3::from(p.xyz.map(f64::from))));
        let time = face.header.origin;
        let is_same = self.cloud == self.before;
        if !is_same {
            self.capture.note(Some(&self.cloud));
        }
        let captured = self.capture.pass(time).and_then(|()| self.offer(time));
        let is_repeated = is_same && captured != Ok(Offer::Taken);
        // The search begins at the last pose and ends a little nearer: with the same face again it would be another pose
        // each time, and nobody would notice that the camera is frozen.
        let repeated = self.found.take().filter(|_| is_repeated);
        let found = repeated.unwrap_or_else(|| self.find(activation, time));
        if let Some((_, identity)) = &mut self.identity {
            identity.pass(time);
        }
        if let Some(pose) = &found.three_points {
            outputs.send::<Pose>(THREE_POINTS, pose)?;
        }
        let pose = match self.method {
            Method::Dense => &found.dense,
            Method::ThreePoints => &found.three_points,
        };
        if let Some(pose) = pose {
            outputs.send::<Pose>(POSE, pose)?;
        }
        let report = PoseReportElement {
            status: report::status(&captured, &found.tracked) as u32,
            not_finite: (face.elements.len() - self.cloud.len()) as u32,
            reference: self.capture.number(),
            ..self.standing(found.report)
        };
        let report = match &captured {
            Err(CaptureError::Foreign(why)) => report::of_foreign(report, why),
            Err(CaptureError::Loose(held)) => report::of_loose(report, held),
            _ => report,
        };
        let report = match found.doubted {
            true if report.status != PoseStatus::CaptureRefused as u32 => {
                let status = if found.is_face { PoseStatus::FaceUnsure } else { PoseStatus::Doubted };
                PoseReportElement { status: status as u32, ..report }
            }
            false if found.is_followed && report::has_moved_pose(report.status) => {
                PoseReportElement { status: PoseStatus::Followed as u32, ..report }
            }
            false if found.is_face && report::has_moved_pose(report.status) => {
                PoseReportElement { status: PoseStatus::FaceMoves as u32, ..report }
            }
            _ => report,
        };
        self.send_pieces(&found, outputs)?;
        let is_refined = found.tracked.as_ref().is_ok_and(|tracked| {
            self.capture.add(&mut self.tracker, &self.cloud, &tracked.current_from_reference)
        });
        if is_refined
            && let (Some((_, identity)), Some(surface)) = (&mut self.identity, self.tracker.surface())
        {
            identity.refine(surface);
        }
        self.found = Some(found).filter(|_| !is_refined);
        if let Some(cloud) = self.capture.completed() {
            send_cloud(cloud, outputs)?;
        }
        outputs.send::<PoseReport>(REPORT, &report)
    }
}

impl TrackHead {
    /// Offers the face as the reference that may be awaited.
    fn offer(&mut self, time: u64) -> Result<Offer, CaptureError> {
        let Self { capture, tracker, known, cloud, min_points, face_from_head, .. } = self;
        let Some(known) = known else { return capture.offer(tracker, cloud, time, *min_points) };
        match capture.offer_known(tracker, known, cloud, time, *min_points)? {
            Some(place) => {
                *face_from_head = Some(place);
                Ok(Offer::Taken)
            }
            None => Ok(Offer::NotAwaited),
        }
    }

    fn without_a_face(&self) -> PoseReportElement {
        let (status, reference) = (PoseStatus::NoFace as u32, self.capture.number());
        PoseReportElement { status, reference, ..self.standing(report::empty()) }
    }

    /// A report with what holds of the reference, whatever the frame shows.
    fn standing(&self, report: PoseReportElement) -> PoseReportElement {
        let number = self.capture.number();
        let is_confirmed = number > 0 && (self.confirm == Confirm::Waived || self.confirmed == number);
        let identity = self.identity.as_ref().map(|(_, identity)| identity);
        PoseReportElement {
            confirmed: u32::from(is_confirmed),
            proof: identity.map_or(Proof::Waiting, Identity::proof) as u32,
            moved: identity.map_or(f64::NAN, Identity::moved),
            unproven: identity.map_or(Unproven::None, Identity::unproven) as u32,
            face: u32::from(number > 0 && self.tracker.surface().is_some_and(Surface::has_face)),
            ..report
        }
    }

    /// The head's origin at the capture, in the face's frame, m.
    fn origin(&self) -> Vector3<f64> {
        match self.origin {
            Origin::Centroid => self.capture.centroid(),
            Origin::Centre => self.capture.centre(),
        }
    }

    /// The pose of the point after a motion of the head in the face's frame since the capture.
    fn output_from_head(&self, motion: &Isometry3<f64>) -> Isometry3<f64> {
        if let Some(face_from_head) = &self.face_from_head {
            return self.output_from_face * motion * face_from_head * self.point;
        }
        let origin = self.output_from_face * Translation3::from(self.origin());
        let moved = self.output_from_face * motion * self.output_from_face.inverse();
        moved * Translation3::from(origin.translation.vector) * self.point
    }

    /// Looks for the head in the frame, which was acquired at `time`, ns.
    fn find(&mut self, activation: &Activation<'_>, time: u64) -> Found {
        let tracked = self.tracker.track(&self.cloud, time);
        let least = self.min_overlap + HARDLY;
        let is_cut_out = tracked.as_ref().is_ok_and(|tracked| tracked.alignment.overlap >= least);
        if !is_cut_out && let Some(followed) = self.expected(activation, time) {
            let overlap = tracked.as_ref().map_or(0.0, |tracked| tracked.alignment.overlap);
            let is_better = followed.alignment.overlap > overlap;
            let found = is_better.then(|| self.found(Ok(followed), time, Cut::Expected));
            // The face is compared with that of the next frame.
            std::mem::swap(&mut self.cloud, &mut self.near);
            if let Some(found) = found {
                return found;
            }
        }
        let found = self.found(tracked, time, Cut::Out);
        if is_cut_out && !found.doubted {
            self.cut_out = Some(time);
        }
        found
    }

    /// The pose of the points of the whole frame that lie where the head is expected, and these points in `cloud`. `None`
    /// where the cloud is not connected, of another frame, or too little of the head is seen; then `cloud` stays.
    fn expected(&mut self, activation: &Activation<'_>, time: u64) -> Option<TrackedPose> {
        let since = self.cut_out?;
        let whole = activation.input::<PointCloud>(FRAME).filter(|whole| whole.header.origin == time)?;
        if time.saturating_sub(since) > FOLLOWED {
            return None;
        }
        let finite = |p: &&Point| p.xyz.iter().all(|c| c.is_finite());
        let points = whole.elements.iter().filter(finite).map(|p| Vector3::from(p.xyz.map(f64::from)));
        self.tracker.expected(points, time, &mut self.near);
        let followed = self.tracker.follow(&self.near, time, FOLLOWED_OVERLAP * self.min_overlap)?;
        std::mem::swap(&mut self.cloud, &mut self.near);
        Some(followed)
    }

    /// What a frame without a face shows where the head is expected; `None` where that is not the head.
    fn followed(&mut self, activation: &Activation<'_>, time: u64) -> Option<Found> {
        let followed = self.expected(activation, time)?;
        self.found = None;
        // A camera that is frozen gives the same points again: they have no pose, as no face is in them.
        let is_same = self.cloud == self.before;
        self.before.clone_from(&self.cloud);
        if is_same {
            return None;
        }
        let found = self.found(Ok(followed), time, Cut::Expected);
        (!found.doubted).then_some(found)
    }

    fn send_followed(&self, found: Found, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let pose = match self.method {
            Method::Dense => &found.dense,
            Method::ThreePoints => &found.three_points,
        };
        if let Some(pose) = pose {
            outputs.send::<Pose>(POSE, pose)?;
        }
        self.send_pieces(&found, outputs)?;
        let (status, reference) = (PoseStatus::Followed as u32, self.capture.number());
        let report = PoseReportElement { status, reference, ..self.standing(found.report) };
        outputs.send::<PoseReport>(REPORT, &report)
    }

    fn send_pieces(&self, found: &Found, outputs: &mut Outputs<'_>) -> Result<(), StepError> {
        let (Some((_, identity)), Ok(tracked), true) = (&self.identity, &found.tracked, self.sends_pieces)
        else {
            return Ok(());
        };
        pieces::send(PIECES, identity, &tracked.alignment.surface_from_cloud.inverse(), outputs)
    }

    /// What the points in `cloud` tell of the head that was tracked in them.
    fn found(&mut self, tracked: Result<TrackedPose, Loss>, time: u64, cut: Cut) -> Found {
        let mut report = report::empty();
        let three_points = self.three_points(&mut report);
        let dense = match &tracked {
            Ok(tracked) => Some(self.dense(tracked, &mut report)),
            Err(loss) => {
                report::of_loss(&mut report, loss);
                None
            }
        };
        let (doubted, is_face) = match &tracked {
            Ok(tracked) => self.is_doubted(tracked, time, cut, &mut report),
            Err(_) => (false, false),
        };
        let trusted = |pose: Option<PoseElement>| pose.filter(|_| !doubted);
        Found {
            tracked,
            dense: trusted(dense),
            three_points: trusted(three_points),
            report,
            doubted,
            is_face,
            is_followed: cut == Cut::Expected,
        }
    }

    /// Judges whether a frame with a pose does not show what was captured, and whether its face moves: where it is doubted,
    /// whether that is why.
    fn is_doubted(
        &mut self,
        tracked: &TrackedPose,
        time: u64,
        cut: Cut,
        report: &mut PoseReportElement,
    ) -> (bool, bool) {
        let Some(surface) = self.tracker.surface() else { return (false, false) };
        let number = self.capture.number();
        if self.identity.as_ref().is_none_or(|(of, _)| *of != number) {
            self.identity = Some((number, Identity::new(surface, self.known.is_some())));
        }
        let Some((_, identity)) = &mut self.identity else { return (false, false) };
        let frame = SeenFrame {
            cloud: &self.cloud,
            alignment: &tracked.alignment,
            motion: &tracked.current_from_reference,
            time,
            cameras: self.cameras.of(time),
        };
        let may_hide = cut == Cut::Expected;
        let part = if may_hide { FOLLOWED_OVERLAP } else { 1.0 };
        let needed = Needed { overlap: part * self.min_overlap, tolerance: self.tolerance, may_hide };
        let judged = identity.judge(surface, &frame, &needed);
        report::of_identity(report, &judged);
        let is_doubted = judged.confidence() < ENOUGH;
        (is_doubted, if is_doubted { judged.explained } else { judged.faces })
    }

    fn dense(&self, tracked: &TrackedPose, report: &mut PoseReportElement) -> PoseElement {
        let pose = self.output_from_head(&tracked.current_from_reference);
        let now = self.output_from_face * tracked.alignment.surface_from_cloud.inverse();
        let length = self.tracker.surface().map_or(f64::NAN, |s| s.length());
        let at = &pose.translation.vector;
        let known = Uncertainty::new(&tracked.alignment, length, &now, at, self.capture.variance());
        report::of_alignment(report, &tracked.alignment);
        report::of_uncertainty(report, &known, length);
        element(&pose, &known.covariance)
    }

    fn three_points(&self, report: &mut PoseReportElement) -> Option<PoseElement> {
        let PairedPose { model_from_measured, gap, .. } = self.tracker.three_points(&self.cloud)?;
        report.three_points_gap = gap;
        let motion = model_from_measured.inverse();
        let pose = self.output_from_head(&motion);
        let points = self.tracker.three_points_of_reference()?;
        let now = points.map(|p| (self.output_from_face * motion * Point3::from(p)).coords);
        let covariance = of_three_points(&now, self.three_points_sd, &pose.translation.vector);
        Some(element(&pose, &covariance))
    }
}

fn send_cloud(cloud: &[Vector3<f64>], outputs: &mut Outputs<'_>) -> Result<(), StepError> {
    let count = cloud.len();
    let mut writer = outputs.open::<PointCloud>(REFERENCE, count)?;
    *writer.body() = CloudShape { width: count as u32, height: 1, reserved: 0, length: count as u32 };
    for (slot, point) in writer.elements().iter_mut().zip(cloud) {
        *slot = Point { xyz: [point.x as f32, point.y as f32, point.z as f32] };
    }
    writer.finish(count)
}

/// The surface of the planning CT, and where the plan has it.
fn known(
    name: &str,
    given: &ReferenceParams,
    params: &HeadParams,
    output_from_face: &Isometry3<f64>,
    setup: &Setup<'_>,
) -> Result<Planned, SetupError> {
    let fault = |e: &dyn std::fmt::Display| SetupError(format!("{name}: {e}"));
    let bytes = setup.file(name)?;
    let planned_mm = given.planned_isocentre.map(|place| place.map(|c| 1e3 * c));
    let surface = read_surface(&bytes, planned_mm, None).map_err(|e| fault(&e))?;
    let region = [[-given.region; 3], [given.region; 3]];
    let points = surface.about_isocentre(region[0], region[1]);
    let place = output_from_face.inverse() * Translation3::from(given.isocentre);
    let limits = Limits { tolerance: params.tolerance, most_rms: given.max_misfit, ..Limits::default() };
    Planned::new(&points, region, place, params.tracking().surface, limits).map_err(|e| fault(&e))
}

/// The finite points of a PCD file.
fn reference_file(name: &str, setup: &Setup<'_>) -> Result<Vec<Vector3<f64>>, SetupError> {
    let bytes = setup.file(name)?;
    let cloud = stillpoint_ingest::pcd::read(&bytes).map_err(|e| SetupError(format!("{name}: {e}")))?;
    let finite = |p: &&[f32; 3]| p.iter().all(|c| c.is_finite());
    Ok(cloud.points.iter().filter(finite).map(|p| Vector3::from(p.map(f64::from))).collect())
}

fn element(pose: &Isometry3<f64>, covariance: &Matrix6<f64>) -> PoseElement {
    stillpoint_pose::element(pose, core::array::from_fn(|i| covariance[(i / 6, i % 6)]))
}
