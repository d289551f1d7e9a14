//! The pieces of the reference as `track.head` sends them.

use nalgebra::{Isometry3, Point3};
use stillpoint_operator::{Outputs, StepError};
use stillpoint_samples::{PieceState, SurfacePiece, SurfacePieces, SurfacePiecesShape};

use crate::align::{Known, Verdict};
use crate::identity::Identity;

/// Pieces of a reference that are sent at most: a face has about a hundred, a surface of a CT a few hundred.
pub const MOST: usize = 512;

/// Sends what a frame tells of the pieces, on an output. `cloud_from_surface` leads to where the frame shows them.
///
/// # Errors
/// The output takes no sample.
pub fn send(
    output: usize,
    identity: &Identity,
    cloud_from_surface: &Isometry3<f64>,
    outputs: &mut Outputs<'_>,
) -> Result<(), StepError> {
    let all = identity.pieces();
    let found = all.len();
    let count = found.min(MOST);
    let mut writer = outputs.open::<SurfacePieces>(output, count)?;
    *writer.body() = SurfacePiecesShape { found: found as u32, length: count as u32 };
    for (slot, (middle, known)) in writer.elements().iter_mut().zip(all) {
        let place = cloud_from_surface * Point3::from(middle);
        *slot = SurfacePiece {
            xyz: place.coords.map(|c| c as f32).into(),
            moved: known.moved.map(|c| c as f32).into(),
            over: known.over as f32,
            state: state(&known) as u32,
        };
    }
    writer.finish(count)
}

fn state(known: &Known) -> PieceState {
    match known.verdict {
        _ if !known.is_seen => PieceState::Unseen,
        Verdict::Open => PieceState::Open,
        Verdict::With => PieceState::With,
        Verdict::Against => PieceState::Against,
    }
}
