//! What a config may say of a phantom.

use stillpoint_operator::{ParamConflict, Params};

use crate::camera_view::refusal;
use crate::phantom::{Phantom, PhantomError, PhantomMove};

/// A move of a phantom at constant speed, from where it is.
#[derive(Clone, Copy, Debug, Params)]
pub struct PhantomParams {
    /// When it begins, after the rig's start.
    #[param(unit = "ns")]
    pub at: u64,
    /// How long it takes; 0 s for a jump.
    #[param(unit = "ns", default = "0 s", max = "1 h")]
    pub over: u64,
    /// Where to along x, y and z, from rest.
    #[param(unit = "m", default = "[0 mm, 0 mm, 0 mm]", min = "-100 mm", max = "100 mm")]
    pub shift: [f64; 3],
    /// Where to about x, y and z (pitch, roll, yaw), from rest.
    #[param(unit = "rad", default = "[0 deg, 0 deg, 0 deg]", min = "-45 deg", max = "45 deg")]
    pub turn: [f64; 3],
}

/// The phantom of these moves, if there is one.
///
/// # Errors
/// Moves that overlap.
pub fn phantom(moves: Option<&[PhantomParams]>) -> Result<Option<Phantom>, PhantomError> {
    let to_move = |m: &PhantomParams| PhantomMove { at: m.at, over: m.over, shift: m.shift, turn: m.turn };
    moves.map(|moves| Phantom::new(moves.iter().map(to_move).collect())).transpose()
}

/// Refuses moves that overlap.
///
/// # Errors
/// The move and its times.
pub fn check(moves: Option<&[PhantomParams]>) -> Result<(), ParamConflict> {
    phantom(moves).map(drop).map_err(|why| ParamConflict::inside(&["phantom"], refusal(why.to_string())))
}
