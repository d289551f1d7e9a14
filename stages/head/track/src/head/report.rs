//! What `track.head` says about a frame.

use stillpoint_samples::{PoseReportElement, PoseStatus};

use crate::align::Alignment;
use crate::capture::{CaptureError, Offer};
use crate::identity::Judged;
use crate::observability::Observability;
use crate::planned::Foreign;
use crate::tracker::{Loss, TrackedPose, Way};
use crate::uncertainty::Uncertainty;

/// An empty report.
pub fn empty() -> PoseReportElement {
    PoseReportElement {
        sensitivity: [f64::NAN; 6],
        direction_sd: [f64::NAN; 6],
        directions: [f64::NAN; 36],
        centre: [f64::NAN; 3],
        length: f64::NAN,
        residual_rms: f64::NAN,
        residual_sd: f64::NAN,
        overlap: f64::NAN,
        three_points_gap: f64::NAN,
        confidence: f64::NAN,
        certainty: [f64::NAN; 5],
        scale: f64::NAN,
        apart: f64::NAN,
        moved: f64::NAN,
        status: 0,
        refused: 0,
        iterations: 0,
        points: 0,
        not_finite: 0,
        reference: 0,
        confirmed: 0,
        proof: 0,
    }
}

/// Says how sure it is that the frame shows what was captured.
pub fn of_identity(said: &mut PoseReportElement, judged: &Judged) {
    said.confidence = judged.confidence();
    said.certainty = judged.certainty;
    said.scale = judged.agreement.scale;
    said.apart = judged.agreement.apart;
}

/// Says how a face lies on the surface of a patient that it does not show.
pub fn of_foreign(said: PoseReportElement, why: &Foreign) -> PoseReportElement {
    match why.fit() {
        Some(fit) => {
            PoseReportElement { overlap: fit.near, residual_rms: fit.misfit, scale: fit.scale, ..said }
        }
        None => said,
    }
}

/// Says that nobody waits for a capture any more.
pub fn of_lapsed(said: PoseReportElement) -> PoseReportElement {
    PoseReportElement { status: PoseStatus::CaptureLapsed as u32, ..said }
}

/// Says which directions a face does not hold that was refused for it.
pub fn of_loose(said: PoseReportElement, held: &Observability) -> PoseReportElement {
    let refused = (held.constrained..6).fold(0, |bits, i| bits | 1 << i);
    PoseReportElement { sensitivity: held.sensitivity, refused, ..said }
}

/// Whether a status is that of a pose after the capture.
pub fn has_moved_pose(status: u32) -> bool {
    status == PoseStatus::Tracked as u32 || status == PoseStatus::Found as u32
}

/// What became of a frame.
pub fn status(captured: &Result<Offer, CaptureError>, tracked: &Result<TrackedPose, Loss>) -> PoseStatus {
    match (captured, tracked) {
        (Err(CaptureError::Lapsed { .. }), _) => PoseStatus::CaptureLapsed,
        (Err(_), _) => PoseStatus::CaptureRefused,
        (Ok(Offer::Taken), _) => PoseStatus::Captured,
        (_, Ok(pose)) if pose.way == Way::Tracked => PoseStatus::Tracked,
        (_, Ok(_)) => PoseStatus::Found,
        (_, Err(Loss::NoReference)) => PoseStatus::NoReference,
        (_, Err(Loss::TooFewPoints { .. })) => PoseStatus::TooFewPoints,
        (_, Err(Loss::NoFit { .. })) => PoseStatus::Lost,
    }
}

/// Says how the frame fits.
pub fn of_alignment(said: &mut PoseReportElement, alignment: &Alignment) {
    let observability = &alignment.observability;
    said.sensitivity = observability.sensitivity;
    said.refused = (observability.constrained..6).fold(0, |bits, i| bits | 1 << i);
    said.residual_rms = alignment.rms;
    said.residual_sd = alignment.sd;
    said.overlap = alignment.overlap;
    said.iterations = alignment.iterations;
    said.points = alignment.points as u32;
}

/// Says what is known of the pose.
pub fn of_uncertainty(said: &mut PoseReportElement, known: &Uncertainty, length: f64) {
    said.directions = core::array::from_fn(|i| known.directions[(i % 6, i / 6)]);
    said.direction_sd = known.direction_sd;
    said.centre = known.centre;
    said.length = length;
}

/// Says what was tried where there is no pose.
pub fn of_loss(said: &mut PoseReportElement, loss: &Loss) {
    if let Loss::NoFit { alignment, .. } = loss {
        of_alignment(said, alignment);
    }
}
