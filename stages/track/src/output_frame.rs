//! The frame in which a pose is given, from that of the face it is found in.

use stillpoint_operator::Setup;
use stillpoint_operator::SetupError;
use stillpoint_operator::frames::Rigid;

/// What brings points of the first input's frame into the frame of the first output. Nothing to do where neither, or
/// only the input, is in a frame.
pub fn output_from_face(setup: &Setup<'_>) -> Result<Rigid, SetupError> {
    let from = setup.input_frames.first().and_then(Option::as_deref);
    let to = setup.output_frames.first().and_then(Option::as_deref);
    match (to, from) {
        (Some(to), Some(from)) if to != from => setup.transform(to, from).ok_or_else(|| {
            SetupError(format!("place `{from}` and `{to}` in `frames` so that both hang on one root"))
        }),
        (Some(to), None) => Err(SetupError(format!(
            "its face is in no frame, so it cannot be brought into `{to}`: remove `frame`"
        ))),
        _ => Ok(Rigid::IDENTITY),
    }
}
