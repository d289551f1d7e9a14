//! What a capture proposes as a reference, for the person who confirms it: its numbers, and its picture as a file.

use std::collections::VecDeque;
use std::io::Write;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use stillpoint_operator::Registry;
use stillpoint_report::proposal::{PictureError, image, picture};
use stillpoint_report::unproven::cause;
use stillpoint_samples::{
    AlignedBytes, IdentityPart, PointCloud, PoseReport, PoseReportElement, PoseStatus, Proof, Rejection,
    Sample, SampleKind, Verb,
};

use crate::answer::{LOOK, answering};
use crate::attach::{Attached, Which};
use crate::exit::Failure;
use crate::private;
use crate::tap::Tap;
use crate::upstream::{image_behind, input_of};

/// Time within which a tracker has to report on a frame.
const PATIENCE: Duration = Duration::from_secs(1);
/// Time that a capture may take: a command lapses after `capture_within`, and a registration with a planning CT takes long.
const CAPTURE: Duration = Duration::from_secs(4);
/// Frames that are kept until the tracker has reported on them.
const RETAINED: usize = 8;

/// What a person reads of a reference whose face has no parts.
const NO_FACE: &str = "  no face was found on it, or `soft_tissue` is `ignored`: all of it is taken for rigid, and a smile \
                       lets go of the head";

/// Watches a tracker from before a person captures.
pub struct Proposal {
    report: Tap,
    rejection: Option<Tap>,
    shown: Option<Shown>,
    /// The last report before the command; none if the tracker was silent.
    before: Option<PoseReportElement>,
    /// The last report since, the last that refused a face, and why the last frame without one had none.
    last: Option<PoseReportElement>,
    refused: Option<PoseReportElement>,
    reason: Option<String>,
    /// Root folder of the run's domain.
    root: PathBuf,
    /// The session, or what stands for it: pictures are written beside it.
    side_by_side: PathBuf,
}

/// The topics from which the picture is made, and their last samples with the times of their images.
struct Shown {
    image: (Tap, &'static SampleKind),
    face: Tap,
    image_from_face: Option<stillpoint_operator::frames::Rigid>,
    images: VecDeque<(u64, AlignedBytes)>,
    faces: VecDeque<(u64, AlignedBytes)>,
}

/// What became of a capture or a confirmation.
pub struct Outcome {
    /// What a person reads.
    pub text: String,
    /// Whether the tracker did as was asked.
    pub is_done: bool,
}

impl Outcome {
    fn done(text: String) -> Self {
        Self { text, is_done: true }
    }

    fn refused(text: String) -> Self {
        Self { text, is_done: false }
    }
}

/// Watches each tracker that takes the command of a console, before it is sent.
pub fn watch(
    registry: &Registry,
    which: &Which,
    console: &str,
    verb: Verb,
) -> Result<Vec<Proposal>, Failure> {
    let attached = which.attach(registry)?;
    let mut trackers = Vec::new();
    for (operator, output) in answering(&attached.graph, console, verb, PoseReport::KIND) {
        trackers.push(Proposal::open(&attached, operator, output)?);
    }
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE && trackers.iter().any(|tracker| tracker.before.is_none()) {
        for tracker in &mut trackers {
            tracker.collect()?;
            if let Some((_, report)) = tracker.next_report()? {
                tracker.before = Some(report);
            }
        }
        std::thread::sleep(LOOK);
    }
    Ok(trackers)
}

/// What became of the capture, or of the confirmation, at each tracker since it was sent.
pub fn outcomes(trackers: &mut [Proposal], which: &Which, verb: Verb) -> Result<Vec<Outcome>, Failure> {
    let patience = if verb == Verb::Capture { CAPTURE } else { PATIENCE };
    let mut outcomes: Vec<Option<Outcome>> = trackers.iter().map(|_| None).collect();
    let begun = Instant::now();
    while begun.elapsed() < patience && outcomes.iter().any(Option::is_none) {
        for (tracker, outcome) in trackers.iter_mut().zip(&mut outcomes) {
            if !which.is_going_on(&tracker.root) {
                return Err(Failure::failed("the run ended before the tracker answered"));
            }
            // All are read, so that none falls behind.
            tracker.collect()?;
            while let Some((origin, report)) = tracker.next_report()? {
                if outcome.is_none() {
                    *outcome = tracker.look(verb, origin, report)?;
                }
            }
        }
        std::thread::sleep(LOOK);
    }
    let given_up = |(tracker, outcome): (&Proposal, Option<Outcome>)| {
        outcome.unwrap_or_else(|| Outcome::refused(tracker.given_up(verb)))
    };
    Ok(trackers.iter().zip(outcomes).map(given_up).collect())
}

impl Proposal {
    fn open(attached: &Attached, operator: usize, output: usize) -> Result<Self, Failure> {
        let graph = &attached.graph;
        let input = |kind: &SampleKind| input_of(graph, operator, kind);
        let rejection = match input(Rejection::KIND) {
            Some((operator, output)) => Some(Tap::open(attached, operator, output)?),
            None => None,
        };
        let shown = match input(PointCloud::KIND) {
            Some(face) => Shown::open(attached, face)?,
            None => None,
        };
        // Without a session: beside nothing, in the folder of the person who asks.
        let side_by_side = attached.session.clone().unwrap_or_else(|| PathBuf::from(&graph.name));
        Ok(Self {
            report: Tap::open(attached, operator, output)?,
            rejection,
            shown,
            before: None,
            last: None,
            refused: None,
            reason: None,
            root: attached.root.clone(),
            side_by_side,
        })
    }

    /// The topic of the tracker's reports.
    pub fn topic(&self) -> &str {
        &self.report.name
    }

    /// What a report tells of the capture, or of the confirmation; `None`: nothing yet.
    fn look(
        &mut self,
        verb: Verb,
        origin: u64,
        report: PoseReportElement,
    ) -> Result<Option<Outcome>, Failure> {
        let Some(before) = self.before else { return Ok(None) };
        self.last = Some(report);
        if verb == Verb::Confirm {
            let message =
                || Outcome::done(format!("reference {} is confirmed; {}", report.reference, proof(&report)));
            return Ok((report.confirmed == 1).then(message));
        }
        let status = PoseStatus::from_number(report.status);
        if report.reference != 0 && report.reference != before.reference {
            return Ok(Some(Outcome::done(match status {
                Some(PoseStatus::Captured) => self.proposed(&report, origin),
                _ => format!(
                    "proposed as reference {}; its frame passed unread: `stillpoint report` shows it",
                    report.reference
                ),
            })));
        }
        match status {
            Some(PoseStatus::CaptureRefused) => self.refused = Some(report),
            Some(PoseStatus::CaptureLapsed) => return Ok(Some(Outcome::refused(self.not_captured(&report)))),
            _ => {}
        }
        Ok(None)
    }

    /// What is said when the time for an answer is over.
    fn given_up(&self, verb: Verb) -> String {
        let Some(last) = self.last.or(self.before).filter(|_| self.before.is_some()) else { return silent() };
        if verb == Verb::Capture {
            return format!("{}; a face that comes may still be captured", self.not_captured(&last));
        }
        if last.reference == 0 {
            return "there is no reference to confirm: capture one first".into();
        }
        format!(
            "the reference was not confirmed within {} s; `stillpoint echo {}` shows `confirmed`",
            PATIENCE.as_secs(),
            self.topic()
        )
    }

    /// Why nothing was captured.
    fn not_captured(&self, last: &PoseReportElement) -> String {
        let why = match &self.refused {
            Some(report) if report.refused != 0 => format!(
                "faces were refused: their surface leaves {} of the six directions of a movement open",
                report.refused.count_ones()
            ),
            Some(report) if report.overlap.is_finite() => format!(
                "faces were refused: {:.0} % of their points are on the planned surface, and they differ by {:.2} mm",
                100.0 * report.overlap,
                1e3 * report.residual_rms
            ),
            Some(_) => "faces were refused".into(),
            None => match &self.reason {
                Some(reason) if last.status != PoseStatus::Tracked as u32 => {
                    format!("no face was found in enough frames: {reason}")
                }
                _ => "no face was found in enough frames".into(),
            },
        };
        format!("nothing was captured: {why}")
    }

    /// The numbers of a proposal, and where its picture is.
    fn proposed(&self, report: &PoseReportElement, origin: u64) -> String {
        let mut lines = vec![format!("proposed as reference {}: {}", report.reference, self.size(origin))];
        lines.extend(numbers(report).map(|line| format!("  {line}")));
        if report.face == 0 {
            lines.push(NO_FACE.to_owned());
        }
        lines.push(match self.write_picture(report, origin) {
            Ok(Some(path)) => format!("  picture: {}", path.display()),
            Ok(None) => "  no picture: the tracker's faces do not come from images of a camera".into(),
            Err(reason) => format!("  no picture: {reason}"),
        });
        lines.join("\n")
    }

    /// Points and extent of the captured face.
    fn size(&self, origin: u64) -> String {
        let face = self.shown.as_ref().and_then(|shown| of(&shown.faces, origin));
        let extent = face.and_then(|bytes| {
            let pieces = stillpoint_samples::Pieces::split(PointCloud::KIND, bytes).ok()?;
            let points = pieces.view::<PointCloud>().ok()?;
            let [x, y, z] = [0, 1, 2].map(|axis| {
                let along = points.elements.iter().map(|p| p.xyz[axis]);
                1e3 * (along.clone().fold(f32::NEG_INFINITY, f32::max) - along.fold(f32::INFINITY, f32::min))
            });
            let count = points.elements.len();
            Some(format!("a face of {count} points, {x:.0} x {y:.0} x {z:.0} mm along the camera's axes"))
        });
        extent.unwrap_or_else(|| "a face".into())
    }

    fn write_picture(
        &self,
        report: &PoseReportElement,
        origin: u64,
    ) -> Result<Option<PathBuf>, ProposalError> {
        let Some(shown) = &self.shown else { return Ok(None) };
        let (Some(bytes), Some(face)) = (of(&shown.images, origin), of(&shown.faces, origin)) else {
            return Err(ProposalError::Passed);
        };
        let png = picture(image(shown.image.1, bytes)?, face, shown.image_from_face.as_ref())?;
        let tracker = self.topic().split('.').next().unwrap_or_default();
        let path =
            self.side_by_side.with_added_extension(format!("{tracker}-reference-{}.png", report.reference));
        let written = private::create(&path).and_then(|mut file| file.write_all(&png));
        match written {
            Ok(()) => Ok(Some(path)),
            Err(error) => Err(ProposalError::File { path, error }),
        }
    }

    fn next_report(&self) -> Result<Option<(u64, PoseReportElement)>, Failure> {
        let Some(sample) = self.report.next()? else { return Ok(None) };
        let view = sample.pieces().view::<PoseReport>().map_err(Failure::failed)?;
        Ok(view.first().map(|report| (view.header.origin, *report)))
    }

    /// Keeps the last images and faces, and why the last frame without a face had none.
    fn collect(&mut self) -> Result<(), Failure> {
        if let Some(tap) = &self.rejection {
            while let Some(sample) = tap.next()? {
                let message = sample.pieces().view::<Rejection>().map_err(Failure::failed)?;
                self.reason = message.first().map(|r| r.reason().to_owned());
            }
        }
        let Some(Shown { image, face, images, faces, .. }) = &mut self.shown else { return Ok(()) };
        for (tap, retained) in [(&image.0, images), (&*face, faces)] {
            while let Some(sample) = tap.next()? {
                let pieces = sample.pieces();
                if retained.len() == RETAINED {
                    retained.pop_front();
                }
                retained
                    .push_back((pieces.header().origin, AlignedBytes::joined(pieces.meta, pieces.payload)));
            }
        }
        Ok(())
    }
}

/// Why a face has no picture.
#[derive(Debug, thiserror::Error)]
enum ProposalError {
    #[error("its image passed before it was read")]
    Passed,
    #[error(transparent)]
    Picture(#[from] PictureError),
    #[error("{}: {error}", path.display())]
    File { path: PathBuf, error: std::io::Error },
}

impl Shown {
    /// The topics behind a face; `None` where there is no image.
    fn open(attached: &Attached, face: (usize, usize)) -> Result<Option<Self>, Failure> {
        let graph = &attached.graph;
        let Some((image, kind)) = image_behind(graph, face) else { return Ok(None) };
        let frame =
            |(operator, output): (usize, usize)| graph.operators[operator].outputs[output].frame.clone();
        let image_from_face = match (frame(image), frame(face)) {
            (Some(to), Some(from)) if to != from => graph.frames.transform(&to, &from),
            _ => None,
        };
        Ok(Some(Self {
            image: (Tap::open(attached, image.0, image.1)?, kind),
            face: Tap::open(attached, face.0, face.1)?,
            image_from_face,
            images: VecDeque::new(),
            faces: VecDeque::new(),
        }))
    }
}

/// The sample of the image of this time.
fn of(retained: &VecDeque<(u64, AlignedBytes)>, origin: u64) -> Option<&AlignedBytes> {
    retained.iter().find(|(of, _)| *of == origin).map(|(_, bytes)| bytes)
}

fn silent() -> String {
    format!("no answer: the tracker reported on no frame within {} s", PATIENCE.as_secs())
}

/// Whether the reference is proven, and else why not.
fn proof(report: &PoseReportElement) -> String {
    let because = cause(report.unproven).map_or_else(String::new, |cause| format!(": {cause}"));
    match Proof::from_number(report.proof) {
        Some(Proof::Proven) => "it is proven".to_owned(),
        Some(Proof::Failed) => format!("its proof failed{because}; capture it again"),
        _ => format!("it is not proven yet{because}"),
    }
}

fn numbers(report: &PoseReportElement) -> impl Iterator<Item = String> {
    let [x, y, z] = report.centre.map(|c| 1e3 * c);
    let parts = IdentityPart::ALL.iter().map(|(word, part)| {
        format!("{word} {:.2}", report.certainty.get(*part as usize).copied().unwrap_or(f64::NAN))
    });
    let parts: Vec<String> = parts.collect();
    let sd = report.direction_sd.iter().copied().fold(0.0, f64::max) * 1e3;
    [
        format!("centre of its surface at x {x:.1}, y {y:.1}, z {z:.1} mm"),
        format!("confidence {:.2} ({})", report.confidence, parts.join(", ")),
        format!("one frame tells its pose to {sd:.2} mm in the least certain direction"),
    ]
    .into_iter()
}
