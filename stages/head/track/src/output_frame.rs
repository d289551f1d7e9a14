//! The transform from the frame of the face to the frame of the pose.

use stillpoint_operator::Setup;
use stillpoint_operator::SetupError;
use stillpoint_operator::frames::Rigid;

/// The transform from the frame of the first input to the frame of the first output. It is the identity if the frames
/// are the same, if neither port has a frame, or if only the input has one.
///
/// # Errors
/// The two frames are not connected, or only the output has a frame.
pub fn output_from_face(setup: &Setup<'_>) -> Result<Rigid, SetupError> {
    let from = setup.input_frames.first().and_then(Option::as_deref);
    let to = setup.output_frames.first().and_then(Option::as_deref);
    match (to, from) {
        (Some(to), Some(from)) if to != from => setup.transform(to, from).ok_or_else(|| {
            SetupError(format!("place `{from}` and `{to}` in `frames` so that both have the same root"))
        }),
        (Some(to), None) => Err(SetupError(format!(
            "its face is in no frame, so it cannot be brought into `{to}`: remove `frame`"
        ))),
        _ => Ok(Rigid::IDENTITY),
    }
}
