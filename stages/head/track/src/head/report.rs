//! What `track.head` says about a frame.

use stillpoint_samples::{PoseReportElement, PoseStatus};

use crate::align::Alignment;
use crate::capture::{CaptureError, Offer};
use crate::identity::Judged;
use crate::observability::Observability;
use crate::planned::Foreign;
use crate::tracker::{Loss, PoseSource, TrackedPose};
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
        unproven: 0,
        face: 0,
    }
}

/// Says how sure it is that the frame shows what was captured.
pub fn of_identity(element: &mut PoseReportElement, judged: &Judged) {
    element.confidence = judged.confidence();
    element.certainty = judged.certainty;
    element.scale = judged.agreement.scale;
    element.apart = judged.agreement.apart;
}

/// Says how a face lies on the surface of a patient that it does not show.
pub fn of_foreign(element: PoseReportElement, why: &Foreign) -> PoseReportElement {
    match why.fit() {
        Some(fit) => {
            PoseReportElement { overlap: fit.near, residual_rms: fit.misfit, scale: fit.scale, ..element }
        }
        None => element,
    }
}

/// Says that nobody waits for a capture any more.
pub fn of_lapsed(element: PoseReportElement) -> PoseReportElement {
    PoseReportElement { status: PoseStatus::CaptureLapsed as u32, ..element }
}

/// Says which directions a face does not hold that was refused for it.
pub fn of_loose(element: PoseReportElement, held: &Observability) -> PoseReportElement {
    let refused = (held.constrained..6).fold(0, |bits, i| bits | 1 << i);
    PoseReportElement { sensitivity: held.sensitivity, refused, ..element }
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
        (_, Ok(pose)) if pose.source == PoseSource::Tracked => PoseStatus::Tracked,
        (_, Ok(_)) => PoseStatus::Found,
        (_, Err(Loss::NoReference)) => PoseStatus::NoReference,
        (_, Err(Loss::TooFewPoints { .. })) => PoseStatus::TooFewPoints,
        (_, Err(Loss::NoFit { .. })) => PoseStatus::Lost,
    }
}

/// Says how the frame fits.
pub fn of_alignment(element: &mut PoseReportElement, alignment: &Alignment) {
    let observability = &alignment.observability;
    element.sensitivity = observability.sensitivity;
    element.refused = (observability.constrained..6).fold(0, |bits, i| bits | 1 << i);
    element.residual_rms = alignment.rms;
    element.residual_sd = alignment.sd;
    element.overlap = alignment.overlap;
    element.iterations = alignment.iterations;
    element.points = alignment.points as u32;
}

/// Says what is known of the pose.
pub fn of_uncertainty(element: &mut PoseReportElement, known: &Uncertainty, length: f64) {
    element.directions = core::array::from_fn(|i| known.directions[(i % 6, i / 6)]);
    element.direction_sd = known.direction_sd;
    element.centre = known.centre;
    element.length = length;
}

/// Says what was tried where there is no pose.
pub fn of_loss(element: &mut PoseReportElement, loss: &Loss) {
    if let Loss::NoFit { alignment, .. } = loss {
        of_alignment(element, alignment);
    }
}
